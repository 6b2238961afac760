"""Which columns of a log are its time: all that could be are weighed against each other.

A name is a hint. How many rows have a stamp, whether the stamps rise, and how fine they are decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kalscope.common.array import Array
from kalscope.errors import BadSetting
from kalscope.sources.grammar.cells import parse_number
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.grammar.stamp_forms import StampHints, find_stamp_form
from kalscope.sources.grammar.stamps.clocks import ClockForm
from kalscope.sources.grammar.timestamps import TimeColumn, row_stamp_parser
from kalscope.sources.layout.columns import Column
from kalscope.sources.layout.rows.kinds import Cells
from kalscope.sources.layout.time.date_columns import clock_form, named_parts, repeated_parts, unnamed_parts
from kalscope.sources.layout.time.evidence import Evidence, judge
from kalscope.sources.layout.time.names import TimeName, time_name

_MAX_ROWS = 900
"""Rows that are weighed: the first, and some of the middle and the end."""
_MAX_BACK, _MAX_BACK_WEAK = 0.25, 0.02
"""Share of steps back with which numbers may be a time, by a clear name and by a mere hint."""
_MIN_JUDGED = 8
"""Rows from which a clear name can be wrong."""
_MIN_STEPS_FROM_1970 = 3
"""Steps forward that stamps since 1970 without a name must show; between them they may stand still."""
_MIN_FILL = 0.5
_CLOSE = 1.0
"""A candidate with as few points less than the best is named."""
_DAY_US = 86400e6


@dataclass(frozen=True)
class _Candidate:
    """Columns that may be the time."""

    column: TimeColumn
    """How they are read."""
    evidence: Evidence
    """What their stamps show."""
    points: float
    """Weight of name, form and evidence."""


def find_time(
    columns: list[Column], rows: list[Cells], decimal: str, *, named: bool, options: ReadOptions = DEFAULTS
) -> TimeColumn | None:
    """The candidate that bears out best that it is the time; None where there is none.

    Args:
        columns: Names and roles.
        rows: Cells of rows from the head of the file and, where they are at hand, from its middle and end.
        decimal: Decimal mark.
        named: True where the names are those of the source.
        options: Format of the stamps, order of day and month.

    Raises:
        BadSetting: the format of the stamps fits no column.
    """
    rows = _sampled(rows)
    found = _candidates(columns, rows, decimal, options)
    if options.time_format is not None and not found:
        raise BadSetting(f"time_format must fit a column of stamps (got {options.time_format!r}, which fits none)")
    if not found:
        return _by_numbers(columns, rows, decimal, named=named)
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
        c for c in _candidates(columns, rows, decimal, options) if index in c.column.indices and c.column.parts
    ]
    if joined:
        best = max(joined, key=lambda candidate: candidate.points).column
        return _with_repeated(best, columns, rows, decimal)
    said = time_name(columns[index])
    cells = [row[index] for row in rows]
    form = find_stamp_form(cells, decimal, _hints(replace(said, strength=2), options))
    if form is None:
        example = next(filter(None, cells), "")[:40]
        if options.time_format is not None:
            raise BadSetting(f"time_format must fit the stamps (got {options.time_format!r} for {example!r})")
        raise BadSetting(f"the time column must hold numbers or stamps (got {example!r})")
    column = replace(form, index=index, unit=said.unit if form.kind == "number" else "")
    return _with_repeated(column, columns, rows, decimal)


def _with_repeated(column: TimeColumn, columns: list[Column], rows: list[Cells], decimal: str) -> TimeColumn:
    """The time with the columns that only repeat a part of it, which are no channels either."""
    if column.kind != "calendar":
        return column
    others = repeated_parts(columns, rows, _stamps(column, rows, decimal))
    return replace(column, also=tuple(i for i in others if i not in column.indices))


def _candidates(columns: list[Column], rows: list[Cells], decimal: str, options: ReadOptions) -> list[_Candidate]:
    """All columns, alone or together, that may be the time, as they stand in the file."""
    names = [time_name(column) for column in columns]
    forms: dict[int, TimeColumn] = {}
    for i, (column, name) in enumerate(zip(columns, names, strict=True)):
        if column.role in ("row name", "row number", "empty"):
            continue
        if name.strength or column.role == "text" or options.time_format is not None:
            form = find_stamp_form([row[i] for row in rows], decimal, _hints(name, options))
            if form is not None and (name.strength or form.kind != "number"):
                unit = name.unit if form.kind == "number" else ""
                forms[i] = replace(form, index=i, unit=unit)
    proposed = [*_joined(forms, names, rows, decimal), *forms.values()]
    if options.time_format is not None and not forms:
        proposed = _in_two_columns(rows, decimal, options)
    parts = named_parts(columns, rows) or (None if any(c.name for c in columns) else unnamed_parts(rows))
    weighed = [_weighed(column, names, rows, decimal) for column in (*proposed, *([parts] if parts else []))]
    return [candidate for candidate in weighed if _is_plausible(candidate, names, len(rows))]


def _hints(name: TimeName, options: ReadOptions) -> StampHints:
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
    """Each date with the clock of the same row, in the column beside it or in one that is named a time."""
    dates = [i for i, form in forms.items() if form.kind == "calendar" and _has_days_only(form, rows, decimal)]
    if not dates:
        return []
    clocks: dict[int, ClockForm] = {}
    for i, form in forms.items():
        digits = clock_form([row[i] for row in rows]) if form.kind == "number" else None
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
    """Two columns beside each other that the format of the user reads together, a blank between them."""
    proposed: list[TimeColumn] = []
    for i in range(min(map(len, rows), default=0) - 1):
        form = find_stamp_form([f"{row[i]} {row[i + 1]}" for row in rows], decimal, _hints(TimeName(0), options))
        if form is not None:
            proposed.append(replace(form, index=i, parts=(("date", i), ("clock", i + 1))))
    return proposed


def _has_days_only(form: TimeColumn, rows: list[Cells], decimal: str) -> bool:
    stamps = _stamps(form, rows[:50], decimal)
    read = stamps[np.isfinite(stamps)]
    return bool(read.size) and bool(np.all(read % _DAY_US == 0))


def _weighed(column: TimeColumn, names: list[TimeName], rows: list[Cells], decimal: str) -> _Candidate:
    evidence = judge(_stamps(column, rows, decimal), column.turn_s * 1e6)
    strength = max(names[i].strength for i in column.indices)
    return _Candidate(column, evidence, evidence.weight + strength + _points_of_form(column, rows, decimal))


def _points_of_form(column: TimeColumn, rows: list[Cells], decimal: str) -> float:
    """A date with a clock says most, a bare number least."""
    if column.kind == "calendar":
        return 0.75 if _has_days_only(column, rows, decimal) else 1.5
    if column.kind == "clock":
        return 0.75
    if column.unit in ("day", "year"):
        return -0.5
    stamps = _stamps(column, rows[:50], decimal)
    return 0.75 if column.unit or _is_since_1970(stamps[np.isfinite(stamps)]) else 0.0


def _is_plausible(candidate: _Candidate, names: list[TimeName], count: int) -> bool:
    """False for a stamp that never changes, is mostly missing, or goes back and forth."""
    evidence, column = candidate.evidence, candidate.column
    clear = names[column.index].strength == 2
    if evidence.fill < _MIN_FILL or (count > 1 and not evidence.moves):
        return False
    if column.kind != "number" or (clear and count < _MIN_JUDGED):
        return True
    return evidence.back <= (_MAX_BACK if clear else _MAX_BACK_WEAK)


def _about_rival(best: _Candidate, found: list[_Candidate], columns: list[Column]) -> list[str]:
    """A sentence about the next best, where it is close and its column has a name."""
    others = [c for c in found if not {*c.column.indices} & {*best.column.indices}]
    rival = max(others, key=lambda candidate: candidate.points, default=None)
    if rival is None or rival.points < best.points - _CLOSE or not columns[rival.column.index].name:
        return []
    name = columns[rival.column.index].name
    return [f'the time could also be "{name}": --time-column "{name}"']


def _by_numbers(columns: list[Column], rows: list[Cells], decimal: str, *, named: bool) -> TimeColumn | None:
    """Numbers whose name says no time: a first column without a name that rises, or stamps since 1970."""
    if len(columns) < 2:
        return None
    if not named and _rises_steadily([row[0] for row in rows], decimal):
        return TimeColumn(0, "number")
    for i, column in enumerate(columns):
        if column.role == "channel" and _counts_from_1970([row[i] for row in rows], decimal):
            return TimeColumn(i, "number")
    return None


def _numbers(cells: list[str], decimal: str) -> Array:
    stamps = np.array([value if (value := parse_number(cell, decimal)) is not None else np.nan for cell in cells])
    return stamps[np.isfinite(stamps) & (np.abs(stamps) < 1e20)]


def _rises_steadily(cells: list[str], decimal: str) -> bool:
    """True for eight or more rising stamps of nearly even step; a counter 0, 1, 2, … is none."""
    stamps = _numbers(cells, decimal)
    if stamps.size < 8 or stamps.size < 0.9 * len(cells):
        return False
    steps = np.diff(stamps)
    long = np.count_nonzero(steps > 50 * np.median(steps))
    # Between rows of the head, the middle and the end the steps are long.
    return bool(np.all(steps > 0) and long <= max(2, 0.01 * steps.size) and not np.all(steps == 1))


def _counts_from_1970(cells: list[str], decimal: str) -> bool:
    """True for eight or more rising numbers that are stamps of 2001 to 2100 in s, ms, µs or ns.

    A burst of samples may share its stamp.
    """
    if not _is_since_1970(_numbers(cells[:8], decimal)):
        return False
    stamps = _numbers(cells, decimal)
    steps = np.diff(stamps)
    rising = bool(np.all(steps >= 0)) and np.count_nonzero(steps) >= _MIN_STEPS_FROM_1970
    return rising and stamps.size >= 8 and stamps.size == len(cells)


def _is_since_1970(stamps: Array) -> bool:
    return bool(stamps.size) and any(size <= stamps[0] < 4.2 * size for size in (1e9, 1e12, 1e15, 1e18))


def _stamps(column: TimeColumn, rows: Sequence[Cells], decimal: str) -> Array:
    parse = row_stamp_parser(column, decimal)
    return np.array([np.nan if (stamp := parse(row)) is None else stamp for row in rows])


def _sampled(rows: list[Cells]) -> list[Cells]:
    """The first rows, some from the middle and the last ones."""
    if len(rows) <= _MAX_ROWS:
        return rows
    third, middle = _MAX_ROWS // 3, len(rows) // 2
    return rows[:third] + rows[middle : middle + third] + rows[-third:]
