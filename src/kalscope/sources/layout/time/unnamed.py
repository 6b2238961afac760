"""Numbers that are the time although no name says it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kalscope.common.array import Array
from kalscope.sources.grammar.cells import parse_number
from kalscope.sources.grammar.stamp_forms import StampHints, find_stamp_form
from kalscope.sources.grammar.timestamps import TimeColumn, stamp_parser
from kalscope.sources.layout.columns import Column
from kalscope.sources.layout.rows.kinds import Cells
from kalscope.sources.layout.time.evidence import is_since_1970

_MIN_DATES = 8
"""Fewest rows to recognise dates in digits without a name."""
_MIN_STEPS_FROM_1970 = 3
"""Steps forward that stamps since 1970 without a name must show; between them they may repeat."""


def unnamed_time(columns: list[Column], rows: list[Cells], decimal: str, *, named: bool) -> TimeColumn | None:
    """Numbers with no name of a time: dates in digits, a first column without a name that rises, or since 1970."""
    if len(columns) < 2:
        return None
    for i, column in enumerate(columns):
        dated = _dates_in_digits([row[i] for row in rows], decimal) if column.role == "channel" else None
        if dated is not None:
            return replace(dated, index=i)
    if not named and _rises_steadily([row[0] for row in rows], decimal):
        return TimeColumn(0, "number")
    for i, column in enumerate(columns):
        if column.role == "channel" and _counts_from_1970([row[i] for row in rows], decimal):
            return TimeColumn(i, "number")
    return None


def _dates_in_digits(cells: list[str], decimal: str) -> TimeColumn | None:
    """2024022923, 2024030100: numbers whose steps are even only as dates, and that never step back."""
    form = find_stamp_form(cells, decimal, StampHints())
    if form is None or form.kind != "calendar" or len(cells) < _MIN_DATES:
        return None
    parse = stamp_parser(form, decimal)
    stamps = np.array([stamp for cell in cells if (stamp := parse(cell)) is not None])
    return form if bool(np.all(np.diff(stamps) >= 0)) else None


def _numbers(cells: list[str], decimal: str) -> Array:
    stamps = np.array([value if (value := parse_number(cell, decimal)) is not None else np.nan for cell in cells])
    return stamps[np.isfinite(stamps) & (np.abs(stamps) < 1e20)]


def _rises_steadily(cells: list[str], decimal: str) -> bool:
    """True for eight or more rising stamps of nearly even step; a counter 0, 1, 2, … is not one."""
    stamps = _numbers(cells, decimal)
    if stamps.size < 8 or stamps.size < 0.9 * len(cells):
        return False
    steps = np.diff(stamps)
    # Between rows of the head, the middle and the end the steps are longer, also those of a counter.
    few_long = np.count_nonzero(steps > 50 * np.median(steps)) <= max(2, 0.01 * steps.size)
    is_counter = np.count_nonzero(steps != 1) <= min(2, 0.02 * steps.size)
    return bool(np.all(steps > 0) and few_long and not is_counter)


def _counts_from_1970(cells: list[str], decimal: str) -> bool:
    """True for eight or more rising numbers that are stamps of 2001 to 2100 in s, ms, µs or ns.

    A burst of samples may share its stamp.
    """
    if not is_since_1970(_numbers(cells[:8], decimal)):
        return False
    stamps = _numbers(cells, decimal)
    steps = np.diff(stamps)
    rising = bool(np.all(steps >= 0)) and int(np.count_nonzero(steps)) >= _MIN_STEPS_FROM_1970
    return rising and stamps.size >= 8 and stamps.size == len(cells)
