"""From the Table of a container to the Reading that every recording is assembled from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kalscope.common.array import Array
from kalscope.errors import BadSetting
from kalscope.sources.containers.table import Table
from kalscope.sources.grammar.line_format import LineFormat
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.layout.columns import Column, named_column, settle_roles
from kalscope.sources.layout.sniffer import Layout
from kalscope.sources.layout.time.time_column import chosen_time, find_time
from kalscope.sources.readers.assemble import Reading
from kalscope.sources.readers.csv_rows import Tally

_HEAD_ROWS = 1000
"""Rows by which a column is recognised as the time."""


def reading_of(table: Table, options: ReadOptions) -> Reading:
    """The table with its time: the stamps of the file, or the column that is the time by the rules of text files.

    Raises:
        BadSetting: there is no such time column.
    """
    columns = [_column(name, unit) for name, unit in zip(table.names, table.units, strict=True)]
    data = dict(enumerate(table.columns))
    columns += [Column(name, role="text") for name in table.texts]
    notes = table.notes
    if table.time is not None and options.time_column is None:
        if options.time_unit is not None:
            raise BadSetting(f"time_unit must be left out: the file gives seconds (got {options.time_unit!r})")
        data = {0: table.time, **{i + 1: column for i, column in data.items()}}
        columns = [Column("time", "s", "time"), *columns]
        time = TimeColumn(0, "number", "s")
        columns, _, more = settle_roles(columns, time)
        notes = (*notes, *([table.clock] if table.clock else []), *more[1:])
    else:
        time = _find_time(table, columns, options)
        columns = [replace(column, role="text") if i in table.dates else column for i, column in enumerate(columns)]
        columns, time, more = settle_roles(columns, time)
        if time is None and table.period is not None:
            more = (f"the file gives one sample every {table.period:.9g} s", *more[1:])
        notes = (*notes, *more)
    layout = Layout(LineFormat(), tuple(columns), time, 1, frozenset(), (), notes, start=table.start)
    wanted = {*layout.channels, *(time.indices if time else ())}
    return _counted({i: column for i, column in data.items() if i in wanted}, layout, table)


def _column(name: str, unit: str) -> Column:
    """A name may hold its unit, as in a header of text."""
    column = named_column(name)
    if column.unit.isdecimal():  # acc[0] is a name
        column = Column(name)
    return column if unit in ("", column.unit) else replace(column, name=name, unit=unit)


def _find_time(table: Table, columns: list[Column], options: ReadOptions) -> TimeColumn | None:
    named = [column.name for column in columns]
    choice = options.time_column
    index = named.index(choice) if isinstance(choice, str) and choice in named else choice
    if index is None and table.dates:
        index = min(table.dates)
    if isinstance(index, int) and index in table.dates:
        return TimeColumn(index, "calendar")
    cells = [[_cell(value) for value in column[:_HEAD_ROWS].tolist()] for column in table.columns]
    texts = [""] * len(table.texts)
    rows = [(*row, *texts) for row in zip(*cells, strict=True)]
    time = find_time(columns, rows, ".", named=True) if index is None else chosen_time(columns, rows, ".", index)
    if time is None or time.kind != "number":
        return None
    if index is None and table.period is not None and not time.unit and _counts(table.columns[time.index]):
        return None
    return time


def _counts(column: Array) -> bool:
    """True for 0, 1, 2, … or 1, 2, 3, …: beside a rate that the file gives, they number the samples."""
    return column[0] in (0, 1) and bool(np.all(np.diff(column) == 1))


def _cell(value: float) -> str:
    return f"{value:.17g}" if np.isfinite(value) else ""


def _counted(columns: dict[int, Array], layout: Layout, table: Table) -> Reading:
    """Rows without a stamp are rejected; infinite samples are missing ones, counted as bad cells."""
    tally, rejected, n = Tally(bad_cells=table.bad_cells, issues=list(table.issues)), 0, table.shape[0]
    if layout.time is not None:
        known = np.isfinite(columns[layout.time.index])
        rejected = int(np.count_nonzero(~known))
        if rejected:
            columns = {i: column[known] for i, column in columns.items()}
    for i in layout.channels:
        infinite = np.isinf(columns[i])
        if infinite.any():
            tally.bad_cells += int(np.count_nonzero(infinite))
            columns[i] = np.where(infinite, np.nan, columns[i])
    tally.lines.update(row=n - table.filled - rejected, rejected=rejected + table.rejected, header=table.headers)
    return Reading(columns, tally, layout, table.period)
