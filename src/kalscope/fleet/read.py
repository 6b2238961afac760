"""What SOURCE names as units of work, and how they are read: files, lists of files, and Parquet data sets.

A data set in the long form, id, time, value, is divided by its ids: a unit has a span of ids, and reads every row
group that contains one of them, so that each series is whole and no id is in two units. Where the rows are sorted
by id, a unit has the ids of a row group up to its largest. Where they are mixed, ids are cut into spans of about
equal size, each of which reads all. Stamps of one even step, the usual case, need no search for the sample rate.
"""

from __future__ import annotations

import glob
import hashlib
import json
import os
import stat
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from kalscope.common.numbers import Array, Indices
from kalscope.common.text import program
from kalscope.errors import BadFile, BadSetting, describe
from kalscope.estimation.request import Request
from kalscope.fleet.store import pa, pc, pq
from kalscope.recording import Recording
from kalscope.sources.containers.table import Table
from kalscope.sources.grammar.cells import SECONDS_PER_UNIT, UNIT_OF_WORD
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.reading.columns import named_column
from kalscope.sources.reading.recording_file import assemble, check_chosen_period, reading_of

ENDINGS = (".parquet", ".pq")
"""Endings of Parquet files."""
ID_NAMES = ("id", "series_id", "unique_id", "device_id", "sensor_id", "device", "sensor")
"""Names of the column that says which series a row belongs to, in lower case, the first that exists."""
WITHOUT = "rows without an id"
"""Name in the table of the rows that belong to no series."""
MAX_SAMPLED = 8
"""Row groups of a file whose ids say whether ids repeat."""
MAX_READINGS = 8
"""How often the bytes of a data set may be read in all, where its ids are mixed."""
SORTED_READINGS = 2
"""How often at most where they are sorted: a row group holds the end of one unit and the beginning of another."""
MIXED_BYTES = 64 << 20
"""Bytes of the rows of a unit of mixed ids, where the data set is not too large for that."""
MAX_UNIT_BYTES = 256 << 20
"""Most bytes of the rows of such a unit: a worker holds four copies of them."""


@dataclass(frozen=True, slots=True)
class Piece:
    """A file, or some of its row groups, as it was when the fleet was scanned."""

    path: str
    """Absolute path."""
    size: int = 0
    """Bytes of the file, or of its row groups."""
    stamp: int = 0
    """When the file was last written, ns since 1970."""
    groups: tuple[int, ...] = ()
    """Row groups, from 0; () = the whole file."""


@dataclass(frozen=True, slots=True)
class Unit:
    """What is read, fitted and kept together: the least that a rerun repeats."""

    id: str
    """Name in the table: the path below the folder that was given. Series of a Parquet data set have their ids."""
    pieces: tuple[Piece, ...]
    """What holds it; one file, or the files over which its series run."""
    reason: str = ""
    """Why it cannot be read, where that is known without opening it."""
    span: tuple[Any, Any] | None = None
    """Of a data set in the long form: its ids are above the first and up to the second; None = a recording."""
    data_set: str = ""
    """Folder of the data set in the table, with which the ids of its series begin."""

    @property
    def size(self) -> int:
        """Bytes on disk."""
        return sum(piece.size for piece in self.pieces)

    @property
    def source(self) -> str:
        """What `reopen` finds its recordings by: the path, or in JSON the data set and its files."""
        if self.span is None:
            return self.pieces[0].path
        return json.dumps([self.data_set, list(dict.fromkeys(piece.path for piece in self.pieces))])

    def key(self, fingerprint: str) -> str:
        """Hash of all that the result depends on, 32 hexadecimal digits; the fingerprint is that of the options."""
        text = f"{fingerprint} {self!r}"
        return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:32]


def _unit(path: str, base: str, reason: str) -> Unit:
    """The unit of one file, whatever it is: what cannot be read becomes a row with the reason.

    Args:
        path: Of the file, absolute.
        base: The folder that its name in the table is relative to, "" for none.
        reason: Why it cannot be read, "" where none is known.
    """
    name = Path(os.path.relpath(path, base) if base else path).as_posix()
    name, piece = name.encode("utf-8", "backslashreplace").decode(), Piece(path)
    try:
        state = os.stat(path)
        if not reason and stat.S_ISREG(state.st_mode):
            piece = Piece(path, state.st_size, state.st_mtime_ns)
        elif not reason:
            reason = "it must be a file (got a folder, a device or a pipe)"
    except (OSError, ValueError) as error:  # a NUL in the name
        reason = describe(error)
    return Unit(name, (piece,), reason)


def find_units(sources: Sequence[str], output: str | os.PathLike[str]) -> list[Unit]:
    """Everything that the sources name, each once, in the order of the names.

    A folder stands for everything below it except hidden names; a file that is not a recording becomes a row with
    the reason.

    Args:
        sources: Paths of files and folders, patterns such as "logs/*.csv", and @LIST.
        output: The folder of the results, which is not a source.

    Raises:
        BadSetting: A source names nothing, or all of them nothing.
        BadFile: A list names nothing.
        OSError: A list cannot be read.
    """
    roots = [path for one in sources for path in (read_list(one[1:]) if one.startswith("@") else _matches(one))]
    base, skipped = _base(roots), os.path.realpath(output)
    units: dict[str, Unit] = {}
    for path, reason in (pair for root in roots for pair in _below(root, skipped)):
        if path not in units:
            units[path] = _unit(path, base, reason)
    if not units:
        raise BadSetting(f"SOURCE must name at least one file (got {', '.join(map(repr, sources))}, all empty)")
    return sorted(_spread(units.values()), key=lambda unit: (unit.data_set, unit.id))


def _spread(units: Iterable[Unit]) -> Iterator[Unit]:
    """The units with those of Parquet data sets in place of their files; the files of a folder are one data set."""
    folders: dict[str, dict[str, Unit]] = {}
    for unit in units:
        path = unit.pieces[0].path
        if unit.reason or not path.lower().endswith(ENDINGS):
            yield unit
        else:
            folders.setdefault(os.path.dirname(path), {})[path] = unit
    for folder, by_path in folders.items():
        together = _long_files(by_path)
        yield from (unit for path, unit in by_path.items() if path not in together)
        if together:
            first = by_path[next(iter(together))].id
            name = os.path.dirname(first)
            label = first if len(together) == 1 else name or os.path.basename(folder)
            yield from _data_set_units(together, f"{name}/" if name else "", label)


def _matches(source: str) -> list[str]:
    """The paths that a source stands for."""
    paths = [source] if os.path.lexists(source) else sorted(glob.glob(source))
    if not paths or "**" in source:  # which would miss what lies deeper
        raise BadSetting(
            f"SOURCE must be a folder, a file, @LIST, or a pattern without ** that a file matches (got {source!r})"
        )
    return [os.path.abspath(path) for path in paths]


def _base(paths: Sequence[str]) -> str:
    """The folder that names are relative to: the only folder given, or the one that contains all."""
    try:
        return os.path.commonpath(
            paths if os.path.isdir(paths[0]) and len(paths) == 1 else map(os.path.dirname, paths)
        )
    except ValueError:  # two drives of Windows
        return ""


def _below(root: str, skipped: str) -> Iterator[tuple[str, str]]:
    """The files at or below a path, each with the reason why it cannot be read, "" where none is known."""
    if not os.path.isdir(root):
        yield root, ""
        return
    waiting = [root]  # folders may be nested deeper than Python calls
    while waiting:
        folder = waiting.pop()
        if os.path.basename(folder) == os.path.basename(skipped) and os.path.realpath(folder) == skipped:
            continue
        try:
            with os.scandir(folder) as entries:
                shown = [(one.path, one.is_dir(follow_symlinks=False)) for one in entries if one.name[0] != "."]
        except OSError as error:
            yield folder, describe(error)
            continue
        if not shown:
            yield folder, "the folder is empty"
        waiting += [path for path, is_folder in shown if is_folder]
        yield from ((path, "") for path, is_folder in shown if not is_folder)


def read_list(path: str) -> list[str]:
    """The files of a list, one a line, relative to its folder; empty lines and lines that begin with # are skipped.

    Raises:
        BadFile: The list names nothing.
        OSError: It cannot be read.
    """
    with open(path, encoding="utf-8-sig", errors="surrogateescape") as file:  # str.splitlines cuts at a form feed
        lines = [line.strip() for line in file if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise BadFile(f"the list {path!r} must name at least one file (got none)")
    return [os.path.abspath(os.path.join(os.path.dirname(path), line)) for line in lines]


@dataclass(frozen=True)
class _Group:
    """A row group and the ids in it."""

    piece: Piece
    """Its file and number, with its bytes in memory: a file holds equal values once."""
    id_column: str
    missing: int
    """Rows without an id."""
    first: Any
    """The least id, or less; None where there is none."""
    last: Any
    """The largest id, or more."""


def id_column(names: Sequence[str]) -> str | None:
    """The column that holds the ids; None where there is none."""
    lower = {name.lower(): name for name in reversed(names)}
    return next((lower[name] for name in ID_NAMES if name in lower), None)


def plain_ids(column: Any) -> Any:
    """The ids themselves where a column is dictionary-encoded."""
    return column.cast(column.type.value_type) if pa.types.is_dictionary(column.type) else column


def _ids(file: Any, i: int, name: str) -> Any:
    """The ids of a row group, each once, null and NaN left out: a pyarrow Table of `values` and `counts`."""
    table = pa.Table.from_struct_array(file.read_row_group(i, columns=[name])[name].value_counts())
    values = plain_ids(table["values"])
    return table.set_column(0, "values", values).filter(pc.invert(values.is_null(nan_is_null=True)))


def _parquet(path: str) -> Any:
    return pq.ParquetFile(path, memory_map=False)


def _counted(groups: Iterable[_Group]) -> Any:
    """The ids in ascending order and their rows; ArrowException where they are of several types."""
    read = (_ids(_parquet(one.piece.path), one.piece.groups[0], one.id_column) for one in groups)
    table = pa.concat_tables(read, promote_options="permissive")
    return table.group_by("values").aggregate([("counts", "sum")]).sort_by("values")


def _scan(path: str) -> list[_Group]:
    """The row groups of a file with their ids; none where it has no id or just numbers its rows, or is damaged."""
    try:
        file, stamp = _parquet(path), os.stat(path).st_mtime_ns
        name = id_column(file.schema_arrow.names)
        if name is None or len(file.schema_arrow.names) < 2 or not file.num_row_groups:
            return []
        values, counts = (column.to_numpy() for column in _ids(file, 0, name))
        whole = np.issubdtype(values.dtype, np.integer) and len(values) == counts.sum()
        if whole and np.all(np.diff(values.astype(np.float64)) == 1.0):
            return []
        groups: list[_Group] = []
        for i in range(file.num_row_groups):
            footer = file.metadata.row_group(i)
            piece = Piece(path, max(footer.total_byte_size, 8 * footer.num_rows * footer.num_columns), stamp, (i,))
            groups.append(_Group(piece, name, *_ends(file, i, name)))
    except (pa.ArrowException, OSError, ValueError, TypeError):
        return []
    return groups if any(group.first is not None for group in groups) else []


def _ends(file: Any, i: int, name: str) -> tuple[int, Any, Any]:
    """Rows of a row group without an id, the least and the largest id: by its footer where that has them."""
    footer = file.metadata.row_group(i)
    with suppress(AttributeError, ValueError, pa.ArrowException):  # a text may be cut within a character
        columns = map(footer.column, range(footer.num_columns))
        known = next(one.statistics for one in columns if one.path_in_schema == name)
        exact = not pa.types.is_floating(file.schema_arrow.field(name).type)  # footers do not count NaN
        if exact and known.has_min_max and known.has_null_count:
            return known.null_count, known.min, known.max
    ids = _ids(file, i, name)
    ends = pc.min_max(ids["values"])
    return footer.num_rows - (pc.sum(ids["counts"]).as_py() or 0), ends["min"].as_py(), ends["max"].as_py()


def _long_files(paths: Iterable[str]) -> dict[str, list[_Group]]:
    """The row groups of those Parquet files of a folder that are one data set in the long form.

    They are judged together: an id must have two rows or more, on average. A file of a day may hold each id once.
    """
    scanned, together = {path: groups for path in paths if (groups := _scan(path))}, dict[str, list[_Group]]()
    for name in {groups[0].id_column for groups in scanned.values()}:
        several = {path: groups for path, groups in scanned.items() if groups[0].id_column == name}
        try:
            for most in (MAX_SAMPLED, None):  # all are read only where some ids of the first repeat
                counted = _counted(one for groups in several.values() for one in groups[:most])
                rows, ids = pc.sum(counted["counts_sum"]).as_py(), len(counted)
                if rows == ids or rows >= 2 * ids:
                    break
            together |= several if rows >= 2 * ids else {}
        except pa.ArrowException:  # ids of several types
            together |= several
    return together


def _data_set_units(files: dict[str, list[_Group]], name: str, label: str) -> Iterator[Unit]:
    """The units of the files of one data set; one with the reason where it cannot be divided.

    Args:
        files: The row groups of each.
        name: Of the folder in the table, "" for none; the ids of its series follow.
        label: Name in the table for the whole data set.
    """
    groups = [group for several in files.values() for group in several]
    try:
        for i, (span, inside) in enumerate(_shares([group for group in groups if group.first is not None])):
            yield Unit(f"{name}{i:09d}", _pieces(inside), span=span, data_set=name)
    except (pa.ArrowException, TypeError, BadFile) as error:
        yield Unit(label, _pieces(groups), " ".join(str(error).split()))
    without = [group for group in groups if group.missing]
    if without:
        count = sum(group.missing for group in without)
        reason = f"{count} {'rows have' if count > 1 else 'row has'} no id, so that no series can take them"
        yield Unit(f"{name}{WITHOUT}", _pieces(without), reason, data_set=name)


def _pieces(groups: Sequence[_Group]) -> tuple[Piece, ...]:
    """Row groups in the order of their files."""
    return tuple(sorted((group.piece for group in groups), key=lambda piece: (piece.path, piece.groups)))


Share = tuple[tuple[Any, Any], list[_Group]]
"""A span of ids, above the first and up to the second, and the row groups that hold any of them."""


def _shares(groups: Sequence[_Group]) -> list[Share]:
    """The spans of ids that are read together.

    Raises:
        BadFile: the ids are of several types, or mixed over more bytes than may be read again and again.
    """
    kinds = sorted({type(group.first).__name__ for group in groups})
    if len(kinds) > 1:
        raise BadFile(
            f"the ids of a data set must be of one type in all files (got {' and '.join(kinds)}): move the files"
            " of each type into a folder of their own"
        )
    shares, whole = _cut(groups, sorted({group.last for group in groups})), _bytes(groups)
    read = sum(_bytes(inside) for _, inside in shares)
    if read <= SORTED_READINGS * whole and not any(_is_mixed(inside) for _, inside in shares):
        return shares
    if whole > MAX_READINGS * MAX_UNIT_BYTES:
        raise BadFile(
            f"a data set of more than {MAX_READINGS * MAX_UNIT_BYTES >> 30} GiB must be sorted by"
            f" {groups[0].id_column} (got {whole / 1e9:.3g} GB with mixed ids): DuckDB sorts files of any size"
        )
    counted = _counted(groups)
    upto, share = np.cumsum(counted["counts_sum"].to_numpy()), max(MIXED_BYTES / whole, 1.0 / MAX_READINGS)
    last_of_each = np.flatnonzero(np.diff(np.ceil(upto / (share * upto[-1])), append=np.inf))
    return _cut(groups, counted["values"].take(pa.array(last_of_each)).to_pylist())


def _bytes(groups: Sequence[_Group]) -> int:
    return sum(group.piece.size for group in groups)


def _is_mixed(groups: Sequence[_Group]) -> bool:
    """Whether row groups that are read together hold more than the end of a unit and the beginning of the next."""
    several = [group for group in groups if group.first != group.last]
    return len(several) > 2 and _bytes(several) > MIXED_BYTES


def _cut(groups: Sequence[_Group], ends: Sequence[Any]) -> list[Share]:
    """The spans up to these ids, ascending."""
    waiting = sorted(groups, key=lambda group: (group.first, group.last), reverse=True)
    active, low, shares = list[_Group](), None, list[Share]()
    for end in ends:
        while waiting and waiting[-1].first <= end:
            active.append(waiting.pop())
        shares.append(((low, end), active))
        active, low = [group for group in active if group.last > end], end
    return shares


FORMAT = 7
"""Raised when the same recording would give another row: rows of another format are not used."""
TIME_NAMES = ("time", "timestamp", "t", "ts", "ds", "datetime", "date", "time_s", "time_ms", "time_us", "time_ns")
"""Names of the time column, in lower case, the first that exists; a column of dates comes before all."""
EVEN = 1e-6
"""Steps that differ by less than this share are one step."""


@dataclass(frozen=True)
class FleetOptions:
    """What is to be done with each recording."""

    request: Request
    """What is wanted and known of each channel; a goal holds for the filter of all too."""
    gate: float | None = None
    """Outlier gate on v²/s; NaN = off, None = as estimated."""
    reading: ReadOptions = DEFAULTS
    """How files are read."""
    sample_period: float | None = None
    """Sample period in s in place of that of the recordings."""
    channel: str | None = None
    """The channel of each recording; None = the first that measures something."""
    every: bool = False
    """Whether all channels are fitted."""
    program: str = field(default_factory=program)
    """The program with its version: rows of another one are not the same."""

    def check_period(self, sample_period: float | None) -> None:
        """Raise BadSetting where the goal needs a sample period, and there is none."""
        if sample_period is None and self.request.target.keys() & {"lag_s", "cutoff_hz"}:
            goal = self.request.goal
            raise BadSetting(f"{goal} needs the time between two samples: give --sample-period (got none)")

    def fingerprint(self) -> str:
        """A text that differs where the rows would differ."""
        return f"{FORMAT} {self!r}"


@dataclass(frozen=True)
class Block:
    """The recordings of row groups, one below the other."""

    ids: list[str]
    """Their names in the table."""
    starts: Indices
    """First row of each, and one past the last of all, shape (k + 1,)."""
    table: Table
    """The rows."""

    def recording(self, i: int, options: ReadOptions, sample_period: float | None) -> Recording:
        """One of them, as a file with these rows would be read.

        Raises:
            BadSetting: an option does not suit it.
        """
        reading = ReadOptions(missing=options.missing, gaps=options.gaps, rate=options.rate)
        check_chosen_period(reading, sample_period)
        table = _taken(self.table, slice(int(self.starts[i]), int(self.starts[i + 1])))
        return assemble(reading_of(table, reading), reading, sample_period, self.ids[i])

    def even_steps(self) -> Array:
        """The step of each recording's stamps in s, shape (k,); NaN where they are uneven, or fewer than three."""
        first, sizes, time = self.starts[:-1], np.diff(self.starts), _time_of(self.table)
        if time is None or not len(first):
            return np.full(len(first), np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            period = (time[self.starts[1:] - 1] - time[first]) / (sizes - 1)
        apart = np.abs(np.append(np.diff(time), 0.0) / np.repeat(period, sizes) - 1.0)
        apart[self.starts[1:] - 1] = 0.0  # from one recording to the next
        even = (np.maximum.reduceat(apart, first) <= EVEN) & (sizes >= 3) & (period > 0.0)
        return np.where(even, period, np.nan)


def read_block(unit: Unit, reading: ReadOptions, only: str | None = None) -> Block:
    """The recordings of a data set in the span of a unit, or `only` the one of this name.

    Args:
        unit: The row groups; with `only` whole files will do.
        reading: How files are read. Of a numeric time column the unit is that of its name, or s.
        only: Name of the recording in the table; None = all of the span.

    Raises:
        BadFile: the row groups cannot be read, or hold no channel or none of these rows.
        BadSetting: there is no such time column.
    """
    try:
        tables = [_rows(piece, unit, only) for piece in unit.pieces]
        table = pa.concat_tables(tables, promote_options="permissive").combine_chunks()
    except (pa.ArrowException, OSError, ValueError) as error:
        if isinstance(error, BadFile):
            raise
        raise BadFile(f"the row groups cannot be read: {str(error).splitlines()[0]}") from None
    if not len(table):
        if only is None:  # a footer may cut its ids: no id lies between two of them
            return Block([], np.zeros(1, np.intp), Table((), (), ()))
        raise BadFile(f"the row groups must hold {only!r} (got none of its rows)")
    name = str(id_column(table.column_names))
    codes = table[name].combine_chunks().dictionary_encode()
    places, names = codes.indices.to_numpy(), codes.dictionary.to_pylist()
    places, columns = _sorted(places, _columns(table, reading, name))
    starts = np.flatnonzero(np.diff(places, prepend=-1))
    texts = [f"{unit.data_set}{_text(names[place])}" for place in places[starts]]
    return Block(texts, np.append(starts, len(places)), columns)


def _text(one: Any) -> str:
    return one.decode("utf-8", "backslashreplace") if isinstance(one, bytes) else str(one)


def _rows(piece: Piece, unit: Unit, only: str | None) -> Any:
    """The rows of a piece whose ids are in the span of the unit, or of `only`, as plain ids."""
    with _parquet(piece.path) as file:
        names = file.schema_arrow.names
        name = id_column(names)
        if name is None:
            raise BadFile(f"the row groups must have a column of ids (got {', '.join(names)[:80]})")
        if only is None:
            table = file.read_row_groups(piece.groups, use_threads=False)
        else:  # row groups that cannot hold it are not read
            kind = file.schema_arrow.field(name).type
            kind = kind.value_type if pa.types.is_dictionary(kind) else kind
            wanted = pc.field(name) == pa.scalar(only.removeprefix(unit.data_set)).cast(kind)
            table = pq.read_table(piece.path, filters=wanted, partitioning=None)
    ids = plain_ids(table[name])
    table = table.set_column(table.column_names.index(name), name, ids)
    if unit.span is None:
        return table
    low, high = unit.span
    mask = pc.less_equal(ids, high)
    mask = mask if low is None else pc.and_(mask, pc.greater(ids, low))
    return table if mask.null_count == 0 and pc.all(mask).as_py() else table.filter(mask)


def _columns(table: Any, reading: ReadOptions, ids: str) -> Table:
    """The columns that are channels, and after them the time."""
    kinds = {one.name: one.type for one in table.schema if one.name != ids}
    dates = [name for name, kind in kinds.items() if pa.types.is_timestamp(kind) or pa.types.is_date(kind)]
    numeric = [name for name, kind in kinds.items() if pa.types.is_floating(kind) or pa.types.is_integer(kind)]
    time = _time_name(list(kinds), dates, numeric, reading.time_column)
    channels = [name for name in numeric if name != time]
    if not channels:
        raise BadFile(f"there must be a column of numbers beside id and time (got {', '.join(table.column_names)})")
    named, columns = [named_column(name) for name in channels], [_numbers(table[name]) for name in channels]
    names, units = [one.name for one in named], [one.unit for one in named]
    if time is not None:
        names, units, columns = [*names, "time"], [*units, "s"], [*columns, _seconds(table[time], time, reading)]
    return Table(tuple(names), tuple(units), tuple(columns), None if time is None else len(channels))


def _time_of(table: Table) -> Array | None:
    return None if table.time is None else table.columns[table.time]


def _time_name(names: list[str], dates: list[str], numeric: list[str], chosen: str | int | None) -> str | None:
    if chosen == "none":
        return None
    if chosen is not None:
        name = names[chosen] if isinstance(chosen, int) and chosen < len(names) else str(chosen)
        if name not in (*dates, *numeric):
            raise BadSetting(f"time_column must be one of {', '.join((*dates, *numeric))} (got {name!r})")
        return name
    lower = {named_column(name).name.lower(): name for name in reversed(numeric)}
    return next(iter([*dates, *(lower[name] for name in TIME_NAMES if name in lower)]), None)


def _numbers(column: Any) -> Array:
    column = column.cast(pa.float64(), safe=False)  # the nearest double of a large integer
    return np.ascontiguousarray(column.to_numpy(), dtype=np.float64)


def _seconds(column: Any, name: str, reading: ReadOptions) -> Array:
    """Stamps in s; of dates and of whole numbers that no double holds from the least one, to keep their digits."""
    word = reading.time_unit or named_column(name).unit or ("ns" if name.lower().endswith("_ns") else "s")
    size, is_date = SECONDS_PER_UNIT[UNIT_OF_WORD.get(word.lower(), "s")], pa.types.is_temporal(column.type)
    if is_date:
        column, size = column.cast(pa.timestamp("ns"), safe=False).cast(pa.int64()), 1e-9
    if is_date or (column.type == pa.int64() and (pc.max(column).as_py() or 0) > 1 << 53):
        column = pc.subtract(column, pc.min(column))
    return _numbers(column) * size


def _sorted(places: Array, table: Table) -> tuple[Array, Table]:
    """The rows by id and time, where they are not already."""
    steps, time = np.diff(places), _time_of(table)
    back = np.zeros(len(steps), dtype=bool) if time is None else np.diff(time) < 0
    if not np.any((steps < 0) | ((steps == 0) & back)):
        return places, table
    order = np.lexsort((places,)) if time is None else np.lexsort((time, places))
    return places[order], _taken(table, order)


def _taken(table: Table, rows: Indices | slice) -> Table:
    return replace(table, columns=tuple(column[rows] for column in table.columns))
