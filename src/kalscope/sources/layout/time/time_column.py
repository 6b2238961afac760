"""Which columns of a log are its time: all candidates are weighed against each other.

A name is a hint. How many rows have a stamp, whether the stamps rise, and how fine they are decide.
"""

from __future__ import annotations

from dataclasses import replace

from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.grammar.stamp_forms import find_stamp_form
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.layout.columns import Column
from kalscope.sources.layout.rows.kinds import Cells
from kalscope.sources.layout.time.candidates import Candidate, find_candidates, hints_of, stamps_of
from kalscope.sources.layout.time.date_columns import repeated_parts
from kalscope.sources.layout.time.names import time_name
from kalscope.sources.layout.time.unnamed import unnamed_time

_MAX_ROWS = 600
"""Rows that are weighed: the first, and some of the middle and the end."""
_CLOSE = 1.0
"""A candidate at most this many points below the best is named."""


def find_time(
    columns: list[Column], rows: list[Cells], decimal: str, *, named: bool, options: ReadOptions = DEFAULTS
) -> TimeColumn | None:
    """The candidate with the most points; None where there is none.

    Args:
        columns: Names and roles.
        rows: Cells of rows from the head of the file and, if available, from its middle and end.
        decimal: Decimal mark.
        named: True where the names are those of the source.
        options: Format of the stamps, order of day and month.

    Raises:
        BadSetting: the format of the stamps fits no column.
    """
    rows = _sampled(rows)
    found = find_candidates(columns, rows, decimal, options)
    if options.time_format is not None and not found:
        raise BadSetting(f"time_format must fit a column of stamps (got {options.time_format!r}, which fits none)")
    if not found:
        return unnamed_time(columns, rows, decimal, named=named)
    best = max(found, key=lambda candidate: candidate.points)
    column = replace(best.column, notes=(*best.column.notes, *_about_rival(best, found, columns)))
    return _with_repeated(column, columns, rows, decimal)


def chosen_time(
    columns: list[Column],
    rows: list[Cells],
    decimal: str,
    choice: str | int,
    labels: Cells = (),
    options: ReadOptions = DEFAULTS,
) -> TimeColumn | None:
    """The time column that the user chose, by name or by index from 0; None for "none".

    Raises:
        BadSetting: there is no such column, or it holds neither numbers nor stamps.
    """
    names = [column.name for column in columns]
    if choice == "none" and "none" not in names:
        return None
    if isinstance(choice, str):
        # As the file writes it, `time [ms]`, or as the report shows it, `time`.
        alike = [i for known in (names, list(labels)) for i, name in enumerate(known) if name == choice.strip()]
        index = alike[0] if alike else -1
    else:
        index = choice
    if not 0 <= index < len(columns):
        shown = ", ".join(name or f"column {i}" for i, name in enumerate(names, 1))
        raise BadSetting(f'the time column must be one of {shown}, or "none" (got {choice!r})')
    rows = _sampled(rows)
    joined = [
        c for c in find_candidates(columns, rows, decimal, options) if index in c.column.indices and c.column.parts
    ]
    if joined:
        best = max(joined, key=lambda candidate: candidate.points).column
        return _with_repeated(best, columns, rows, decimal)
    said = time_name(columns[index])
    cells = [row[index] for row in rows]
    form = find_stamp_form(cells, decimal, hints_of(replace(said, strength=2), options))
    if form is None:
        example = next(filter(None, cells), "")[:40]
        if options.time_format is not None:
            raise BadSetting(f"time_format must fit the stamps (got {options.time_format!r} for {example!r})")
        raise BadSetting(f"the time column must hold numbers or stamps (got {example!r})")
    column = replace(form, index=index, unit=said.unit if form.kind == "number" else "")
    return _with_repeated(column, columns, rows, decimal)


def _with_repeated(column: TimeColumn, columns: list[Column], rows: list[Cells], decimal: str) -> TimeColumn:
    """The time with the columns that only repeat a part of it, which are not channels either."""
    if column.kind != "calendar":
        return column
    others = repeated_parts(columns, rows, stamps_of(column, rows, decimal))
    return replace(column, also=tuple(i for i in others if i not in column.indices))


def _about_rival(best: Candidate, found: list[Candidate], columns: list[Column]) -> list[str]:
    """A sentence about the next best, where it is close and its column has a name."""
    others = [c for c in found if not {*c.column.indices} & {*best.column.indices}]
    rival = max(others, key=lambda candidate: candidate.points, default=None)
    if rival is None or rival.points < best.points - _CLOSE or not columns[rival.column.index].name:
        return []
    name = columns[rival.column.index].name
    return [f'the time could also be "{name}": --time-column "{name}"']


def _sampled(rows: list[Cells]) -> list[Cells]:
    """The first rows, some from the middle and the last ones, none of them twice."""
    if len(rows) <= _MAX_ROWS:
        return rows
    third = _MAX_ROWS // 3
    middle = (len(rows) - third) // 2
    return rows[:third] + rows[middle : middle + third] + rows[-third:]
