"""The options of a fleet, and the channels of a unit: of a file, or of row groups of Parquet files.

Stamps of one even step, the usual case, need no search for the sample rate; all others are read like any file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, NamedTuple, Protocol

import numpy as np

from kalscope.analysis.channel_kinds import default_channel
from kalscope.common.numbers import Array, Indices
from kalscope.common.text import program
from kalscope.errors import BadFile, BadSetting, KalscopeError
from kalscope.estimation.request import Request
from kalscope.fleet.find import Unit, id_column, plain_ids
from kalscope.fleet.store import library, table_text
from kalscope.recording import Recording
from kalscope.sources.containers.table import Table
from kalscope.sources.grammar.cells import SECONDS_PER_UNIT, UNIT_OF_WORD
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.reading.assemble import assemble, check_chosen_period, reading_of
from kalscope.sources.reading.columns import named_column
from kalscope.sources.reading.recording_file import read_recording

FORMAT = 6
"""Raised when the same recording would give another row: parts of another format are not used."""
DEVICE_LIMIT_S = 120.0
"""Longest time for a unit of up to 16 MiB, s, by default; see `time_limit`."""
TIME_NAMES = ("time", "timestamp", "t", "ts", "ds", "datetime", "date", "time_s", "time_ms", "time_us", "time_ns")
"""Names of the time column, in lower case, the first that exists; a column of dates comes before all."""
EVEN = 1e-6
"""Steps that differ by less than this share are one step."""


class Question(Protocol):
    """What the user of `kalscope tune` requests; a dataclass whose `repr` contains all of it."""

    @property
    def gate(self) -> float | None:
        """Outlier gate on v²/s; NaN = off, None = as estimated."""
        ...

    def request(self, recording: Recording) -> Request:
        """The same as a request to `find_parameters`, for this recording."""
        ...


@cache
def any_recording() -> Recording:
    """A placeholder recording, for questions where only the options count."""
    return Recording(np.arange(3.0), ("x",), ("",), np.zeros((3, 1)), 1.0)


@dataclass(frozen=True)
class FleetOptions:
    """What is to be done with each recording."""

    question: Question
    """What is estimated of each channel."""
    reading: ReadOptions = DEFAULTS
    """How files are read."""
    sample_period: float | None = None
    """Sample period in s in place of that of the recordings."""
    channel: str | None = None
    """The channel of each recording; None = the first that measures something."""
    every: bool = False
    """Whether all channels are fitted."""
    row_groups: bool = False
    """Whether each row group of a Parquet file is a recording by itself."""
    device_limit: float = field(default=DEVICE_LIMIT_S, repr=False)
    """Longest time for a unit, s, see `time_limit`; not in the `repr`, because no row depends on it."""
    program: str = field(default_factory=program)
    """The program with its version: rows of another one are not the same."""

    @property
    def request(self) -> Request | None:
        """The request where it is the same for each recording; None where a still stretch is within each or not."""
        try:
            return self.question.request(any_recording())
        except KalscopeError:
            return None

    @property
    def is_pooled(self) -> bool:
        """Whether the filter for all is the most likely one, and no goal decides it."""
        request = self.request
        return request is None or (not request.target and request.ratio is None)

    def fingerprint(self) -> str:
        """A text that differs where the rows would differ."""
        return f"{FORMAT} {self!r}"


class Channel(NamedTuple):
    """One channel of one recording."""

    id: str
    """Name of the recording in the table."""
    recording: Recording
    name: str
    """Name of the channel."""


def read_file(unit: Unit, options: FleetOptions) -> list[Channel]:
    """The channels of a file.

    Raises:
        BadFile: it cannot be read.
        BadSetting: an option does not suit it, or it has no such channel.
    """
    if unit.reason:
        raise BadFile(unit.reason)
    recording = read_recording(unit.pieces[0].path, options.reading, sample_period=options.sample_period)
    return channels_of(recording, unit.id, options, unit.channel)


def channels_of(
    recording: Recording, name: str, options: FleetOptions, channel: str | None = None
) -> list[Channel]:
    """The channels to fit of the recording with this name in the table; `channel` is that of a list."""
    chosen = channel or options.channel
    if chosen is not None:
        recording.index(chosen)
    names = (chosen,) if chosen else recording.names if options.every else (default_channel(recording),)
    return [Channel(name, recording, one) for one in names]


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
        first, sizes, time = self.starts[:-1], np.diff(self.starts), self.table.time
        if time is None or not len(first):
            return np.full(len(first), np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            period = (time[self.starts[1:] - 1] - time[first]) / (sizes - 1)
        apart = np.abs(np.append(np.diff(time), 0.0) / np.repeat(period, sizes) - 1.0)
        apart[self.starts[1:] - 1] = 0.0  # from one recording to the next
        even = (np.maximum.reduceat(apart, first) <= EVEN) & (sizes >= 3) & (period > 0.0)
        return np.where(even, period, np.nan)


def read_block(unit: Unit, reading: ReadOptions, only: str | None = None) -> Block:
    """The recordings in the row groups of a unit; of a data set those in its span, or `only` the one of this name.

    Args:
        unit: The row groups.
        reading: How files are read. Of a numeric time column the unit is that of its name, or s.
        only: Name of the recording in the table; None = all of the span.

    Raises:
        BadFile: the row groups cannot be read, or hold no channel or none of these rows.
        BadSetting: there is no such time column.
    """

    def in_span(ids: Any) -> Any:
        compute, (low, high) = library("pyarrow.compute"), unit.span or (None, None)
        below = compute.less_equal(ids, high)
        return below if low is None else compute.and_(below, compute.greater(ids, low))

    def named(ids: Any) -> Any:
        names = ((one, f"{unit.data_set}{one}") for one in ids.unique().to_pylist() if one is not None)
        same = [one for one, name in names if only in (name, table_text(name))]
        return library("pyarrow.compute").is_in(ids, library("pyarrow").array(same, ids.type))

    table = _read_groups(unit, None if unit.span is None else in_span if only is None else named)
    if not len(table):
        if unit.span is not None and only is None:  # a footer may cut its ids: no id lies between two of them
            return Block([], np.zeros(1, np.intp), Table((), (), ()))
        wanted = "at least one row" if only is None else repr(only)
        raise BadFile(f"the row groups must hold {wanted} (got none of its rows)")
    if unit.span is None:
        return Block([unit.id], np.array([0, len(table)]), _columns(table, reading, None))
    name = str(id_column(table.column_names))
    codes = table[name].combine_chunks().dictionary_encode()
    places, names = codes.indices.to_numpy(), codes.dictionary.to_pylist()
    if only is not None:  # the rows of two ids whose names are cut alike are one recording, as they came
        places = np.zeros(len(places), places.dtype)
    places, columns = _sorted(places, _columns(table, reading, name))
    starts = np.flatnonzero(np.diff(places, prepend=-1))
    texts = [only or f"{unit.data_set}{names[place]}" for place in places[starts]]
    return Block(texts, np.append(starts, len(places)), columns)


def _read_groups(unit: Unit, wanted: Callable[[Any], Any] | None) -> Any:
    """The row groups of a unit, one below the other; with `wanted` only the rows of these ids, as plain ids."""
    pa, parquet, tables = library("pyarrow"), library("pyarrow.parquet"), list[Any]()
    try:
        for piece in unit.pieces:
            with parquet.ParquetFile(piece.path, memory_map=False) as file:
                read = (file.read_row_group(i, use_threads=False) for i in piece.groups)
                tables += read if wanted is None else (_only(table, wanted) for table in read)
        return pa.concat_tables(tables, promote_options="permissive").combine_chunks()
    except (pa.ArrowException, ValueError) as error:
        if isinstance(error, BadFile):
            raise
        raise BadFile(f"the row groups cannot be read: {str(error).splitlines()[0]}") from None


def _only(table: Any, wanted: Callable[[Any], Any]) -> Any:
    name = id_column(table.column_names)
    if name is None:
        raise BadFile(f"the row groups must have a column of ids (got {', '.join(table.column_names)[:80]})")
    ids = plain_ids(table[name])
    table, mask = table.set_column(table.column_names.index(name), name, ids), wanted(ids)
    return table if mask.null_count == 0 and library("pyarrow.compute").all(mask).as_py() else table.filter(mask)


def _columns(table: Any, reading: ReadOptions, ids: str | None) -> Table:
    """The columns that are channels, and the time."""
    types = library("pyarrow").types
    names = [name for name in table.column_names if name != ids]
    dates = [name for name in names if types.is_timestamp(table[name].type) or types.is_date(table[name].type)]
    numeric = [name for name in names if types.is_floating(table[name].type) or types.is_integer(table[name].type)]
    time = _time_name(names, dates, numeric, reading)
    channels = [name for name in numeric if name != time]
    if not channels:
        raise BadFile(f"there must be a column of numbers beside id and time (got {', '.join(table.column_names)})")
    named = [named_column(name) for name in channels]
    return Table(
        tuple(one.name for one in named),
        tuple(one.unit for one in named),
        tuple(_numbers(table[name]) for name in channels),
        None if time is None else _seconds(table[time], time, time in dates, reading),
    )


def _time_name(names: list[str], dates: list[str], numeric: list[str], reading: ReadOptions) -> str | None:
    chosen = reading.time_column
    if chosen == "none":
        return None
    if chosen is not None:
        name = chosen if isinstance(chosen, str) else names[chosen] if chosen < len(names) else str(chosen)
        if name not in (*dates, *numeric):
            raise BadSetting(f"time_column must be one of {', '.join((*dates, *numeric))} (got {name!r})")
        return name
    if dates:
        return dates[0]
    lower = {named_column(name).name.lower(): name for name in reversed(numeric)}
    return next((lower[name] for name in TIME_NAMES if name in lower), None)


def _numbers(column: Any) -> Array:
    column = column.cast(library("pyarrow").float64(), safe=False)  # the nearest double of a large integer
    return np.ascontiguousarray(column.to_numpy(), dtype=np.float64)


def _seconds(column: Any, name: str, date: bool, reading: ReadOptions) -> Array:
    """Stamps in s; of dates and of whole numbers that no double holds from the least one, to keep their digits."""
    pa, compute = library("pyarrow"), library("pyarrow.compute")
    if date:
        column, size = column.cast(pa.timestamp("ns"), safe=False).cast(pa.int64()), 1e-9
    else:
        word = reading.time_unit or named_column(name).unit or ("ns" if name.lower().endswith("_ns") else "s")
        size = SECONDS_PER_UNIT[UNIT_OF_WORD.get(word.lower(), "s")]
    if date or (column.type == pa.int64() and (compute.max(column).as_py() or 0) > 1 << 53):
        column = compute.subtract(column, compute.min(column))
    return _numbers(column) * size


def _sorted(places: Array, table: Table) -> tuple[Array, Table]:
    """The rows by id and time, where they are not already."""
    steps, time = np.diff(places), table.time
    back = np.zeros(len(steps), dtype=bool) if time is None else np.diff(time) < 0
    if not np.any((steps < 0) | ((steps == 0) & back)):
        return places, table
    order = np.lexsort((places,)) if time is None else np.lexsort((time, places))
    return places[order], _taken(table, order)


def _taken(table: Table, rows: Indices | slice) -> Table:
    columns, time = tuple(column[rows] for column in table.columns), table.time
    return replace(table, columns=columns, time=None if time is None else time[rows])
