"""All columns, alone or together, that may be the time, and the points of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kalscope.common.array import Array
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.grammar.stamp_forms import StampHints, find_stamp_form
from kalscope.sources.grammar.stamps.clocks import ClockForm
from kalscope.sources.grammar.timestamps import TimeColumn, row_stamp_parser
from kalscope.sources.layout.columns import Column
from kalscope.sources.layout.rows.kinds import Cells
from kalscope.sources.layout.time.date_columns import clock_form, named_parts, unnamed_parts
from kalscope.sources.layout.time.evidence import Evidence, is_since_1970, judge
from kalscope.sources.layout.time.names import TimeName, time_name

_MAX_BACK, _MAX_BACK_WEAK = 0.25, 0.02
"""Share of steps back with which numbers may be a time, with a clear name and with a mere hint."""
_MIN_JUDGED = 8
"""Rows from which a clear name can be wrong."""
_MIN_FILL = 0.5
_DAY_US = 86400e6
_NEVER = ("row name", "row number", "metadata", "empty")


@dataclass(frozen=True)
class Candidate:
    """Columns that may be the time."""

    column: TimeColumn
    """How they are read."""
    evidence: Evidence
    """What their stamps show."""
    points: float
    """Weight of name, form and evidence."""


def find_candidates(
    columns: list[Column], rows: list[Cells], decimal: str, options: ReadOptions
) -> list[Candidate]:
    """All columns, alone or together, that may be the time, in the order of the file."""
    names = [time_name(column) for column in columns]
    forms: dict[int, TimeColumn] = {}
    for i, (column, name) in enumerate(zip(columns, names, strict=True)):
        if column.role in _NEVER:
            continue
        if name.strength or column.role == "text" or options.time_format is not None:
            form = find_stamp_form([row[i] for row in rows], decimal, hints_of(name, options))
            if form is not None and (name.strength or form.kind != "number"):
                unit = name.unit if form.kind == "number" else ""
                forms[i] = replace(form, index=i, unit=unit)
    proposed = [*_joined(forms, names, rows, decimal), *forms.values()]
    if options.time_format is not None and not forms:
        proposed = _in_two_columns(rows, decimal, options)
    parts = named_parts(columns, rows) or (None if any(c.name for c in columns) else unnamed_parts(rows))
    weighed = [_weighed(column, names, rows, decimal) for column in (*proposed, *([parts] if parts else []))]
    return [candidate for candidate in weighed if _is_plausible(candidate, names, len(rows))]


def hints_of(name: TimeName, options: ReadOptions) -> StampHints:
    """What a name and the options say about the stamps of a column."""
    return StampHints(
        is_time=name.strength == 2,
        is_date=name.is_date,
        may_be_spreadsheet=name.may_be_spreadsheet,
        day_first=options.day_first,
        time_format=options.time_format,
    )


def _joined(
    forms: dict[int, TimeColumn], names: list[TimeName], rows: list[Cells], decimal: str
) -> list[TimeColumn]:
    """Each date with the clock of the same row, in the column beside it or in one that is named as a time.

    Digits are a clock (`1800`) only where their name gives no unit: `time_ms` counts milliseconds.
    """
    dates = [i for i, form in forms.items() if form.kind == "calendar" and _has_days_only(form, rows, decimal)]
    if not dates:
        return []
    clocks: dict[int, ClockForm] = {}
    for i, form in forms.items():
        digits = clock_form([row[i] for row in rows]) if form.kind == "number" and not form.unit else None
        if form.kind == "clock" and not form.odd:
            clocks[i] = form.clock
        elif digits is not None:
            clocks[i] = digits
    joined: list[TimeColumn] = []
    for i in dates:
        beside = [j for j in (i + 1, i - 1) if j in clocks] + [j for j in clocks if names[j].strength == 2]
        if beside:
            clock = beside[0]
            joined.append(replace(forms[i], clock=clocks[clock], parts=(("date", i), ("clock", clock))))
    return joined


def _in_two_columns(rows: list[Cells], decimal: str, options: ReadOptions) -> list[TimeColumn]:
    """Two columns beside each other that the user's format reads together, joined by a blank."""
    proposed: list[TimeColumn] = []
    for i in range(min(map(len, rows), default=0) - 1):
        form = find_stamp_form([f"{row[i]} {row[i + 1]}" for row in rows], decimal, hints_of(TimeName(0), options))
        if form is not None:
            proposed.append(replace(form, index=i, parts=(("date", i), ("clock", i + 1))))
    return proposed


def _has_days_only(form: TimeColumn, rows: list[Cells], decimal: str) -> bool:
    stamps = stamps_of(form, rows[:50], decimal)
    read = stamps[np.isfinite(stamps)]
    return bool(read.size) and bool(np.all(read % _DAY_US == 0))


def _weighed(column: TimeColumn, names: list[TimeName], rows: list[Cells], decimal: str) -> Candidate:
    evidence = judge(stamps_of(column, rows, decimal), column.turn_s * 1e6)
    strength = max(names[i].strength for i in column.indices)
    return Candidate(column, evidence, evidence.weight + strength + _points_of_form(column, rows, decimal))


def _points_of_form(column: TimeColumn, rows: list[Cells], decimal: str) -> float:
    """A date with a clock says most, a bare number least."""
    if column.kind == "calendar":
        return 0.75 if _has_days_only(column, rows, decimal) else 1.5
    if column.kind == "clock":
        return 0.75
    if column.unit in ("day", "year"):
        return -0.5
    stamps = stamps_of(column, rows[:50], decimal)
    return 0.75 if column.unit or is_since_1970(stamps[np.isfinite(stamps)]) else 0.0


def _is_plausible(candidate: Candidate, names: list[TimeName], count: int) -> bool:
    """False for a stamp that never changes, is mostly missing, or goes back and forth."""
    evidence, column = candidate.evidence, candidate.column
    clear = names[column.index].strength == 2
    if evidence.fill < _MIN_FILL or (count > 1 and not evidence.moves):
        return False
    if column.kind != "number" or (clear and count < _MIN_JUDGED):
        return True
    return evidence.back <= (_MAX_BACK if clear else _MAX_BACK_WEAK)


def stamps_of(column: TimeColumn, rows: Sequence[Cells], decimal: str) -> Array:
    """The stamps of rows, shape (n,), NaN where unreadable."""
    parse = row_stamp_parser(column, decimal)
    return np.array([np.nan if (stamp := parse(row)) is None else stamp for row in rows])
