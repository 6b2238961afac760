"""Reads the recordings in row groups of Parquet files.

Stamps of one even step, the usual case, need no search for the sample rate; all others are read like any file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from kalscope.common.array import Array, Indices
from kalscope.errors import BadFile, BadSetting
from kalscope.recording import Recording
from kalscope.sources.containers.table import Table
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.grammar.time_units import SECONDS_PER_UNIT, UNIT_OF_WORD
from kalscope.sources.layout.columns import named_column
from kalscope.sources.readers.assemble import assemble, check_chosen_period
from kalscope.sources.readers.table_reading import reading_of
from kalscope.tuning.fleet.libraries import library
from kalscope.tuning.fleet.recordings.long_form import id_column, plain_ids
from kalscope.tuning.fleet.recordings.unit import Unit
from kalscope.tuning.fleet.store.table import told

TIME_NAMES = ("time", "timestamp", "t", "ts", "ds", "datetime", "date", "time_s", "time_ms", "time_us", "time_ns")
"""Names of the time column, in lower case, the first one found; a column of dates comes before all."""
EVEN = 1e-6
"""Steps that differ by less than this share are one step."""


@dataclass(frozen=True)
class Columns:
    """The columns of a table and what they are."""

    names: tuple[str, ...]
    """Names of the channels."""
    units: tuple[str, ...]
    """Their units."""
    values: tuple[Array, ...]
    """Their samples, NaN where missing."""
    time: Array | None
    """Stamps in s, from 0 at the first; None where there are none."""


@dataclass(frozen=True)
class Block:
    """The recordings of a unit, one below the other."""

    ids: list[str]
    """Their names in the table."""
    starts: Indices
    """First row of each, and one past the last of all, shape (k + 1,)."""
    columns: Columns
    """The rows."""

    def recording(self, i: int, options: ReadOptions, sample_period: float | None) -> Recording:
        """One of them, as a file with these rows would be read.

        Raises:
            BadSetting: an option does not suit it.
        """
        columns, rows = self.columns, slice(int(self.starts[i]), int(self.starts[i + 1]))
        values = tuple(column[rows] for column in columns.values)
        table = Table(columns.names, columns.units, values, None if columns.time is None else columns.time[rows])
        own = ReadOptions(missing=options.missing, gaps=options.gaps, rate=options.rate)
        check_chosen_period(own, sample_period)
        return assemble(reading_of(table, own), own, sample_period, self.ids[i])

    def even_steps(self) -> Array:
        """The step of each recording's stamps in s, shape (k,); NaN where they are uneven, or fewer than three."""
        first, sizes = self.starts[:-1], np.diff(self.starts)
        time = self.columns.time
        if time is None or not len(first):
            return np.full(len(first), np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            period = (time[self.starts[1:] - 1] - time[first]) / (sizes - 1)
        apart = np.abs(np.append(np.diff(time), 0.0) / np.repeat(period, sizes) - 1.0)
        apart[self.starts[1:] - 1] = 0.0  # from one recording to the next
        even = (np.maximum.reduceat(apart, first) <= EVEN) & (sizes >= 3) & (period > 0.0)
        return np.where(even, period, np.nan)


def read_block(unit: Unit, options: ReadOptions) -> Block | None:
    """The recordings of a unit; None where it has no rows.

    Args:
        unit: Some row groups; with a span the ids within it, else one recording.
        options: How files are read. Of a numeric time column the unit is that of its name, or s.

    Raises:
        BadFile: the row groups cannot be read, or hold no channel.
        BadSetting: there is no such time column.
    """
    span = unit.span
    if span is None:
        table = _table(unit, None)
        return Block([unit.id], np.array([0, len(table)]), _columns(table, options, None)) if len(table) else None
    table = _table(unit, partial(_within, span))
    if not len(table):
        return None
    name = str(id_column(table.column_names))
    codes = table[name].combine_chunks().dictionary_encode()
    places, names = codes.indices.to_numpy(), codes.dictionary.to_pylist()
    places, columns = _sorted(places, _columns(table, options, name))
    starts = np.flatnonzero(np.diff(places, prepend=-1))
    texts = [f"{unit.data_set}{names[place]}" for place in places[starts]]
    return Block(texts, np.append(starts, len(places)), columns)


def one_recording(unit: Unit, options: ReadOptions, sample_period: float | None) -> Recording:
    """One recording of a data set.

    Args:
        unit: The row groups that hold it; its id is that of the recording, its span says only that there are ids.
        options: How files are read.
        sample_period: Sample period in s in place of that of the stamps.

    Raises:
        BadFile: the row groups cannot be read, or do not hold it.
        BadSetting: there is no such time column.
    """
    table = _table(unit, None if unit.span is None else partial(_named, unit))
    name = None if unit.span is None else id_column(table.column_names)
    if not len(table):
        raise BadFile(f"the row groups must hold {unit.id!r} (got none of its rows)")
    _, columns = _sorted(np.zeros(len(table)), _columns(table, options, name))
    return Block([unit.id], np.array([0, len(table)]), columns).recording(0, options, sample_period)


def _table(unit: Unit, own: Callable[[Any], Any] | None) -> Any:
    """The row groups of a unit, one below the other; of each only the rows whose ids are `own`, a mask or None."""
    pa, parquet = library("pyarrow"), library("pyarrow.parquet")
    tables: list[Any] = []
    try:
        for piece in unit.pieces:
            with parquet.ParquetFile(piece.path, memory_map=False) as file:
                read = (file.read_row_group(i, use_threads=False) for i in piece.groups)
                tables += read if own is None else (_only(table, own) for table in read)
        return pa.concat_tables(tables, promote_options="permissive").combine_chunks()
    except (pa.ArrowException, ValueError) as error:
        if isinstance(error, BadFile):
            raise
        raise BadFile(f"the row groups cannot be read: {str(error).splitlines()[0]}") from None


def _only(table: Any, own: Callable[[Any], Any]) -> Any:
    """The rows of a table whose ids are wanted, with plain ids."""
    compute, name = library("pyarrow.compute"), id_column(table.column_names)
    if name is None:
        raise BadFile(f"the row groups must have a column of ids (got {', '.join(table.column_names)[:80]})")
    ids = plain_ids(table[name])
    table = table.set_column(table.column_names.index(name), name, ids)
    wanted = own(ids)
    return table if wanted.null_count == 0 and compute.all(wanted).as_py() else table.filter(wanted)


def _within(span: tuple[Any, Any], ids: Any) -> Any:
    """Which ids lie within the span."""
    compute = library("pyarrow.compute")
    low, high = span
    own = compute.less_equal(ids, high)
    return own if low is None else compute.and_(own, compute.greater(ids, low))


def _named(unit: Unit, ids: Any) -> Any:
    """Which ids have the name of the unit, as `read_block` and the table give it."""
    names = ((one, f"{unit.data_set}{one}") for one in ids.unique().to_pylist() if one is not None)
    own = [one for one, name in names if unit.id in (name, told(name))]
    return library("pyarrow.compute").is_in(ids, library("pyarrow").array(own, ids.type))


def _columns(table: Any, options: ReadOptions, ids: str | None) -> Columns:
    """The columns that are channels, and the time."""
    types = library("pyarrow").types
    names = [name for name in table.column_names if name != ids]
    dates = [name for name in names if types.is_timestamp(table[name].type) or types.is_date(table[name].type)]
    numeric = [name for name in names if types.is_floating(table[name].type) or types.is_integer(table[name].type)]
    time = _time_name(names, dates, numeric, options)
    channels = [named_column(name) for name in numeric if name != time]
    if not channels:
        raise BadFile(f"there must be a column of numbers beside id and time (got {', '.join(table.column_names)})")
    return Columns(
        tuple(one.name for one in channels),
        tuple(one.unit for one in channels),
        tuple(_numbers(table[name]) for name in numeric if name != time),
        None if time is None else _seconds(table[time], time, time in dates, options),
    )


def _time_name(names: list[str], dates: list[str], numeric: list[str], options: ReadOptions) -> str | None:
    chosen = options.time_column
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


def _seconds(column: Any, name: str, date: bool, options: ReadOptions) -> Array:
    """Stamps in s; of dates and of whole numbers that no double holds from the least one, to keep their digits."""
    pa = library("pyarrow")
    if date:
        return _from_least(column.cast(pa.timestamp("ns"), safe=False).cast(pa.int64())) * 1e-9
    word = options.time_unit or named_column(name).unit or ("ns" if name.lower().endswith("_ns") else "s")
    size = SECONDS_PER_UNIT[UNIT_OF_WORD.get(word.lower(), "s")]
    large = column.type == pa.int64() and (library("pyarrow.compute").max(column).as_py() or 0) > 1 << 53
    return (_from_least(column) if large else _numbers(column)) * size


def _from_least(column: Any) -> Array:
    """Whole numbers relative to the least of them, NaN where missing."""
    compute = library("pyarrow.compute")
    return _numbers(compute.subtract(column, compute.min(column)))


def _sorted(places: Array, columns: Columns) -> tuple[Array, Columns]:
    """The rows by id and time, where they are not already."""
    steps = np.diff(places)
    time = columns.time
    back = np.zeros(len(steps), dtype=bool) if time is None else np.diff(time) < 0
    if not np.any((steps < 0) | ((steps == 0) & back)):
        return places, columns
    order = np.lexsort((places,)) if time is None else np.lexsort((time, places))
    values = tuple(column[order] for column in columns.values)
    return places[order], Columns(columns.names, columns.units, values, None if time is None else time[order])
