"""What SOURCE names as units of work: files, lists of files, and row groups of Parquet data sets.

A data set in the long form, id, time, value, is divided by its ids: a unit has a span of ids, and reads every row
group that contains one of them, so that each series is whole and no id is in two units. Where the rows are sorted
by id, a unit has the ids of a row group up to its largest, and only footers are read here. Where they are mixed,
ids are counted and cut into spans of about equal size, each of which reads all.
"""

from __future__ import annotations

import csv
import glob
import hashlib
import json
import os
import stat
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import numpy as np

from kalscope.errors import BadFile, BadSetting, describe
from kalscope.fleet.store import library

ENDINGS = (".parquet", ".pq")
"""Endings of Parquet files."""
ID_NAMES = ("id", "series_id", "unique_id", "device_id", "sensor_id", "device", "sensor")
"""Names of the column that says which series a row belongs to, in lower case, the first that exists."""
WITHOUT = "rows without an id"
"""Name in the table of the rows that belong to no series."""
REPORT_EVERY = 1000
"""Files between two reports of how many there are."""
MAX_SAMPLED = 8
"""Row groups of a file whose ids are read first."""
MAX_TOGETHER = 16
"""Files whose ids are compared with each other."""
MAX_COMPARED = 50_000
"""Ids of a file that are compared with those of others."""
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
    """What holds it; one file, or the row groups over which its series run."""
    channel: str | None = None
    """The channel that a list names; None = that of the options."""
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
        """What `reopen` finds its recordings by: the path, or in JSON the data set and its row groups."""
        if not self.pieces[0].groups:
            return self.pieces[0].path
        data_set = None if self.span is None else self.data_set
        return json.dumps([data_set, [[piece.path, _runs(piece.groups)] for piece in self.pieces]])

    def key(self, fingerprint: str) -> str:
        """Hash of all that the result depends on, 32 hexadecimal digits; the fingerprint is that of the options."""
        pieces = [(piece.path, piece.size, piece.stamp, piece.groups) for piece in self.pieces]
        content = [fingerprint, self.id, self.channel, self.reason, self.span, self.data_set, pieces]
        text = json.dumps(content, default=str)
        return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:32]


def _runs(numbers: Sequence[int]) -> list[list[int]]:
    """Ascending numbers as runs, each with its first and its last."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return runs


def unit_of(path: str, name: str, channel: str | None = None) -> Unit:
    """The unit of one file, whatever it is: what cannot be read becomes a row with the reason.

    Args:
        path: Of the file.
        name: Its name in the table.
        channel: The channel that a list names.
    """
    path = os.path.abspath(path)
    try:
        state = os.stat(path)
    except (OSError, ValueError) as error:  # a NUL in the name
        return Unit(name, (Piece(path),), channel, describe(error) if isinstance(error, OSError) else str(error))
    regular = stat.S_ISREG(state.st_mode)
    reason = "" if regular else "it must be a file (got a folder, a device or a pipe)"
    return Unit(name, (Piece(path, state.st_size if regular else 0, state.st_mtime_ns),), channel, reason)


def find_units(
    sources: Sequence[str],
    output: str | os.PathLike[str],
    row_groups: bool = False,
    on_files: Callable[[int], None] | None = None,
) -> list[Unit]:
    """Everything that the sources name, each once, in the order of the names.

    A folder stands for everything below it except hidden names; a file that is not a recording becomes a row with
    the reason.

    Args:
        sources: Paths of files and folders, patterns such as "logs/*.csv", and @LIST.
        output: The folder of the results, which is not a source.
        row_groups: Whether each row group of a Parquet file is a recording by itself.
        on_files: Called with the number of files so far, every thousand.

    Raises:
        BadSetting: A source names nothing, or all of them nothing.
        BadFile: A list cannot be read.
    """
    listed = [entry for source in sources if source.startswith("@") for entry in read_list(source[1:])]
    roots = [path for source in sources if not source.startswith("@") for path in _matches(source)]
    base, skipped = _base([*roots, *(path for path, _ in listed)]), os.path.realpath(output)
    units: dict[tuple[str, str | None], Unit] = {}
    for root in roots:
        if os.path.join(os.path.realpath(root), "").startswith(os.path.join(skipped, "")):
            continue  # a pattern such as ** matches the results of an earlier run
        for path, reason in _below(root, skipped):
            name = _name(path, base)
            unit = Unit(name, (Piece(path),), reason=reason) if reason else unit_of(path, name)
            units.setdefault((unit.pieces[0].path, None), unit)
            if on_files is not None and len(units) % REPORT_EVERY == 0:
                on_files(len(units))
    for path, channel in listed:
        unit = unit_of(path, _name(path, base), channel)
        units.setdefault((unit.pieces[0].path, channel), unit)
    if not units:
        raise BadSetting(f"SOURCE must name at least one file (got {', '.join(map(repr, sources))}, all empty)")
    spread = _spread(units.values(), row_groups)
    return sorted(spread, key=lambda unit: (unit.data_set, unit.id, unit.channel or ""))


def _spread(units: Iterable[Unit], row_groups: bool) -> Iterator[Unit]:
    """The units with those of Parquet data sets in place of their files; the files of a folder are one data set."""
    folders: dict[str, dict[str, Unit]] = {}
    for unit in units:
        path = unit.pieces[0].path
        if unit.reason or unit.channel or not path.lower().endswith(ENDINGS):
            yield unit
        elif row_groups:
            yield from _row_group_units(path, unit.id) or [unit]
        else:
            folders.setdefault(os.path.dirname(path), {})[path] = unit
    for folder, by_path in folders.items():
        together = _long_files(by_path)
        yield from (unit for path, unit in by_path.items() if path not in together)
        if together:
            paths = [path for path in by_path if path in together]
            first = by_path[paths[0]].id
            name = os.path.dirname(first)
            label = first if len(paths) == 1 else name or os.path.basename(folder)
            yield from _data_set_units(paths, f"{name}/" if name else "", label)


def _matches(source: str) -> list[str]:
    """The paths that a source stands for."""
    if os.path.lexists(source):
        return [os.path.abspath(source)]
    paths = sorted(_expanded(source)) if glob.has_magic(source) else []
    if not paths:
        raise BadSetting(
            f"SOURCE must be a folder, a file, a pattern such as 'logs/*.csv' or @LIST (got {source!r})"
        )
    return [os.path.abspath(path) for path in paths]


def _expanded(pattern: str) -> Iterator[str]:
    """What a pattern stands for; ** is any depth of folders, and follows no link to one, which might be a loop."""
    parts = Path(pattern).parts
    if "**" not in parts:
        yield from glob.glob(pattern)
        return
    at = parts.index("**")
    for root in glob.glob(os.path.join(*parts[:at])) if at else [os.curdir]:
        if set(parts[at:]) <= {"**", "*"}:
            yield root
            continue
        for path, _ in _below(root, ""):
            if _fits(Path(os.path.relpath(path, root)).parts, parts[at:]):
                yield path


def _fits(parts: Sequence[str], pattern: Sequence[str]) -> bool:
    """Whether the parts of a path fit those of a pattern."""
    if not pattern:
        return not parts
    if pattern[0] == "**":
        return _fits(parts, pattern[1:]) or (bool(parts) and _fits(parts[1:], pattern))
    return bool(parts) and fnmatch(parts[0], pattern[0]) and _fits(parts[1:], pattern[1:])


def _base(paths: Sequence[str]) -> str:
    """The folder that names are relative to: the only folder given, or the one that contains all."""
    if len(paths) == 1:
        return paths[0] if os.path.isdir(paths[0]) else os.path.dirname(paths[0])
    try:
        return os.path.commonpath([os.path.dirname(path) for path in paths]) if paths else ""
    except ValueError:  # two drives of Windows
        return ""


def _name(path: str, base: str) -> str:
    name = os.path.relpath(path, base) if base else path
    return Path(name).as_posix().encode("utf-8", "backslashreplace").decode()


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


def read_list(path: str) -> list[tuple[str, str | None]]:
    """The entries of a list, each a path and a channel or None.

    A line is PATH or PATH,CHANNEL, with a comma or a tab between them and quotes where a path contains one; a path
    is relative to the folder of the list. Empty lines and lines that begin with # are skipped.

    Raises:
        BadFile: The list cannot be read, names nothing, or a line has three parts.
    """
    try:
        with open(path, encoding="utf-8-sig") as file:
            lines = file.readlines()  # str.splitlines would cut a path at a form feed
    except (OSError, UnicodeDecodeError) as error:
        reason = describe(error) if isinstance(error, OSError) else "it must be text in UTF-8"
        raise BadFile(f"the list {path!r} cannot be read: {reason}") from None
    folder, entries = os.path.dirname(os.path.abspath(path)), list[tuple[str, str | None]]()
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            cells = next(csv.reader([line], delimiter="\t" if "\t" in line else ",", skipinitialspace=True))
        except csv.Error:  # longer than any path
            cells = []
        if len(cells) not in (1, 2) or not cells[0].strip():
            raise BadFile(f"line {number} of {path!r} must be PATH or PATH,CHANNEL (got {line.strip()[:80]!r})")
        entries.append((os.path.join(folder, cells[0].strip()), (cells[1].strip() if cells[1:] else "") or None))
    if not entries:
        raise BadFile(f"the list {path!r} must name at least one file (got {len(lines)} lines)")
    return entries


@dataclass(frozen=True)
class _Sample:
    """Some ids of a file, by which data sets in the long form are recognized."""

    path: str
    columns: frozenset[str]
    """Names of all columns."""
    id_column: str
    repeats: bool
    """Whether an id has two rows or more, on average."""
    counts: bool
    """Whether the ids just number the rows."""
    ids: frozenset[Any]
    """Some of them, where they do not repeat."""


def id_column(names: Sequence[str]) -> str | None:
    """The column that holds the ids; None where there is none."""
    lower = {name.lower(): name for name in reversed(names)}
    return next((lower[name] for name in ID_NAMES if name in lower), None)


def plain_ids(column: Any) -> Any:
    """The ids themselves where a column is dictionary-encoded."""
    return column.cast(column.type.value_type) if library("pyarrow").types.is_dictionary(column.type) else column


def _long_files(paths: Iterable[str]) -> set[str]:
    """Those Parquet files of a folder that are one data set in the long form; none that cannot be read.

    They are judged together: where each file is a day, say, it may hold each id once, and the other files decide.
    """
    samples = [one for path in paths if (one := _sample(path)) is not None]
    together: set[str] = set()
    for name in {one.id_column for one in samples}:
        several = [one for one in samples if one.id_column == name]
        kinds = {one.columns for one in several if one.repeats}
        joining = [one for one in several if one.columns in kinds or not one.counts]
        compared = [one.ids for one in joining[:MAX_TOGETHER]]
        held = sum(map(len, compared))
        if kinds or (held > 0 and 2 * len(frozenset[Any]().union(*compared)) <= held):
            together.update(one.path for one in joining)
    return together


def _sample(path: str) -> _Sample | None:
    """Some ids of a file; None where it has none, or cannot be read."""
    pa = library("pyarrow")
    try:
        file = _parquet(path)
        names, groups = file.schema_arrow.names, list(range(file.num_row_groups))
        name = id_column(names)
        if name is None or len(names) < 2:
            return None
        ids = plain_ids(file.read_row_groups(groups[:MAX_SAMPLED], columns=[name])[name])
        if len(ids.unique()) < len(ids) < 2 * len(ids.unique()):  # mixed, so that few occur twice so far
            ids = plain_ids(file.read_row_groups(groups, columns=[name])[name])
        repeats = 2 * len(ids.unique()) <= len(ids)
        some = frozenset[Any]() if repeats else frozenset(ids.slice(0, MAX_COMPARED).drop_null().to_pylist())
    except (pa.ArrowException, OSError, ValueError, TypeError):
        return None
    whole = pa.types.is_integer(ids.type) and not ids.null_count
    counts = whole and bool(np.all(np.diff(ids.to_numpy().astype(np.float64)) == 1.0))
    return _Sample(path, frozenset(names), name, repeats, counts, some) if len(ids) else None


@dataclass(frozen=True)
class _Group:
    """A row group and the ids in it."""

    path: str
    index: int
    size: int
    stamp: int
    first: Any
    """The least id, or less; None where it has none."""
    last: Any
    """The largest id, or more."""
    missing: int
    """Rows without an id."""


Share = tuple[tuple[Any, Any], Sequence[_Group]]
"""A span of ids, above the first and up to the second, and the row groups that may hold any of them."""


def _data_set_units(paths: Sequence[str], name: str, label: str) -> list[Unit]:
    """The units of the files of one data set; one with the reason where it cannot be divided.

    Args:
        paths: Its files, which have an id column.
        name: Of the folder in the table, "" for none; the ids of its series follow.
        label: Name in the table for the whole data set.
    """
    try:
        groups = [group for path in paths for group in _groups(path)]
        shares = _shares([group for group in groups if group.first is not None])
    except (library("pyarrow").ArrowException, OSError, ValueError, TypeError) as error:
        reason = " ".join(describe(error).split()) or type(error).__name__
        return [Unit(label, tuple(map(_whole, paths)), reason=reason)]
    units = [Unit(f"{name}{i:09d}", _pieces(one), span=span, data_set=name) for i, (span, one) in enumerate(shares)]
    without = [group for group in groups if group.missing]
    if without:
        count = sum(group.missing for group in without)
        reason = f"{count} {'rows have' if count > 1 else 'row has'} no id, so that no series can take them"
        files = tuple(_whole(path) for path in dict.fromkeys(group.path for group in without))
        units.append(Unit(f"{name}{WITHOUT}", files, reason=reason, data_set=name))
    return units


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
    shares, whole = list(_by_footers(groups)), sum(group.size for group in groups)
    read = sum(group.size for _, inside in shares for group in inside)
    if read <= SORTED_READINGS * whole and not any(_is_mixed(inside) for _, inside in shares):
        return shares
    if whole > MAX_READINGS * MAX_UNIT_BYTES:
        path = groups[0].path
        folder, name = os.path.dirname(path), id_column(library("pyarrow.parquet").read_schema(path).names)
        raise BadFile(
            f"a data set of more than {MAX_READINGS * MAX_UNIT_BYTES >> 30} GiB must be sorted by {name} (got"
            f" {whole / 1e9:.3g} GB with mixed ids): duckdb -c"
            f" \"COPY (FROM '{folder}/*.parquet' ORDER BY {name}) TO 'sorted.parquet'\""
        )
    return _by_counts(groups, max(MIXED_BYTES, whole // MAX_READINGS + 1) / whole)


def _is_mixed(groups: Sequence[_Group]) -> bool:
    """Whether row groups that are read together hold more than the end of a unit and the beginning of the next."""
    several = [group for group in groups if group.first != group.last]
    return len(several) > 2 and sum(group.size for group in several) > MIXED_BYTES


def _by_footers(groups: Sequence[_Group]) -> Iterator[Share]:
    """The spans up to the largest id of each row group."""
    waiting = sorted(groups, key=lambda group: (group.first, group.last), reverse=True)
    active: list[_Group] = []
    low = None
    for end in sorted({group.last for group in groups}):
        while waiting and waiting[-1].first <= end:
            active.append(waiting.pop())
        yield (low, end), tuple(active)
        active, low = [group for group in active if group.last > end], end


def _by_counts(groups: Sequence[_Group], share: float) -> list[Share]:
    """Spans of ids that hold about this share of all rows each, at least one id."""
    pa, counted = library("pyarrow"), list[Any]()
    for path, indices in _by_file(groups).items():
        file = _parquet(path)
        name = str(id_column(file.schema_arrow.names))
        several = [_present(file.read_row_group(i, columns=[name])[name]).value_counts() for i in indices]
        counted += [pa.table({"id": one.field("values"), "rows": one.field("counts")}) for one in several]
    table = pa.concat_tables(counted, promote_options="permissive")
    table = table.group_by("id").aggregate([("rows", "sum")]).sort_by("id")
    upto = np.cumsum(table["rows_sum"].to_numpy())
    last_of_each = np.flatnonzero(np.diff(np.ceil(upto / (share * upto[-1])), append=np.inf))
    ends = table["id"].take(pa.array(last_of_each)).to_pylist()
    return [
        ((low, end), tuple(group for group in groups if group.first <= end and (low is None or group.last > low)))
        for low, end in zip([None, *ends], ends, strict=False)
    ]


def _groups(path: str) -> Iterator[_Group]:
    """The row groups of a file with the ids in them; those without rows skipped."""
    file, stamp = _parquet(path), os.stat(path).st_mtime_ns
    name = str(id_column(file.schema_arrow.names))
    exact = not library("pyarrow").types.is_floating(file.schema_arrow.field(name).type)  # footers do not count NaN
    for i in range(file.num_row_groups):
        footer = file.metadata.row_group(i)
        if footer.num_rows:
            columns = map(footer.column, range(footer.num_columns))
            column = next((one for one in columns if one.path_in_schema == name), None)
            ends = _known_ends(column.statistics) if exact and column is not None else None
            if ends is None:
                ids = file.read_row_group(i, columns=[name])[name]
                present = _present(ids)
                both = library("pyarrow.compute").min_max(present)
                ends = both["min"].as_py(), both["max"].as_py(), len(ids) - len(present)
            yield _Group(os.path.abspath(path), i, _size(footer), stamp, *ends)


def _known_ends(known: Any) -> tuple[Any, Any, int] | None:
    """The least and the largest id and the number of rows without one by the footer; None where it has none."""
    try:
        if known is not None and known.has_min_max and known.has_null_count:
            return known.min, known.max, known.null_count
    except (ValueError, library("pyarrow").ArrowException):  # a text that was cut within a character
        pass
    return None


def _present(column: Any) -> Any:
    """The ids without those that are missing, null or NaN."""
    ids, compute = plain_ids(column), library("pyarrow.compute")
    if library("pyarrow").types.is_floating(ids.type):
        ids = ids.filter(compute.invert(compute.is_nan(ids)))
    return ids.drop_null()


def _row_group_units(path: str, name: str) -> list[Unit]:
    """A unit for each row group of a file, each a recording; none where its footer cannot be read."""
    try:
        piece, footer = _whole(path), library("pyarrow.parquet").read_metadata(path)
    except (library("pyarrow").ArrowException, OSError, ValueError):
        return []
    sizes = [_size(footer.row_group(i)) for i in range(footer.num_row_groups)]
    return [Unit(f"{name}#{i}", (Piece(piece.path, size, piece.stamp, (i,)),)) for i, size in enumerate(sizes)]


def _size(footer: Any) -> int:
    """Bytes of a row group in memory: a file holds equal values once."""
    return max(footer.total_byte_size, 8 * footer.num_rows * footer.num_columns)


def _by_file(groups: Sequence[_Group]) -> dict[str, list[int]]:
    """The numbers of row groups by their files."""
    files: dict[str, list[int]] = {}
    for group in sorted(groups, key=lambda group: (group.path, group.index)):
        files.setdefault(group.path, []).append(group.index)
    return files


def _pieces(groups: Sequence[_Group]) -> tuple[Piece, ...]:
    """Row groups as pieces of their files."""
    by_place = {(group.path, group.index): group for group in groups}
    return tuple(
        Piece(path, sum(by_place[path, i].size for i in indices), by_place[path, indices[0]].stamp, tuple(indices))
        for path, indices in _by_file(groups).items()
    )


def _whole(path: str) -> Piece:
    """A file of which nothing is read, as it is now."""
    try:
        return Piece(os.path.abspath(path), stamp=os.stat(path).st_mtime_ns)
    except OSError:
        return Piece(os.path.abspath(path))


def _parquet(path: str) -> Any:
    return library("pyarrow.parquet").ParquetFile(path, memory_map=False)
