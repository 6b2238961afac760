"""How the stamps of one column are written, decided once from many of its cells."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kalscope.common.array import Array
from kalscope.sources.grammar.cells import MISSING
from kalscope.sources.grammar.stamps.clocks import CLOCK_PARSERS, MAX_STAMP_LENGTH, ClockForm
from kalscope.sources.grammar.stamps.dates import DateOrder, parse_calendar
from kalscope.sources.grammar.stamps.odd_stamps import (
    DATEUTIL,
    EXCEL,
    SIX_DIGITS,
    check_format,
    has_date,
    parse_excel,
    parse_with_dateutil,
    parse_with_format,
)
from kalscope.sources.grammar.timestamps import StampParser, TimeColumn, stamp_parser

_MAX_COUNTED = 300
"""Cells used to tell the forms apart."""
_CLOCK_FORMS: tuple[ClockForm, ...] = ("h:m:s", "min:s", "elapsed")
_TOLERANCE = 0.15
"""Months of 28 to 31 days are even steps."""
_MANY_TIMES = 5.0
_ORDERS: tuple[DateOrder, ...] = ("ymd", "dmy", "mdy")
_DIGITS = (8, 10, 12, 14)
"""Digits of YYYYMMDD, YYYYMMDDHH, YYYYMMDDHHMM and YYYYMMDDHHMMSS."""
_LIKELY_HOURS = ("19", "20")
"""Centuries of YYYYMMDDHH whose rows may be few; those of 18… are also seconds since 1970, from 2027 on."""


@dataclass(frozen=True)
class StampHints:
    """What is known about a column besides its cells."""

    is_time: bool = False
    """True where the name is one of a time: half of the cells are enough, and 202402291200 may be a stamp."""
    is_date: bool = False
    """True where the name is one of a date: 19580329 may be one."""
    may_be_spreadsheet: bool = False
    """True where the name says date, not just day or timestamp: 240331 and a spreadsheet's 45123.5 may be one."""
    day_first: bool | None = None
    """`ReadOptions.day_first`."""
    time_format: str | None = None
    """`ReadOptions.time_format`."""


def find_stamp_form(cells: Sequence[str], decimal: str, hints: StampHints) -> TimeColumn | None:
    """The one reading that fits most of the cells that hold a digit, a few damaged ones ignored.

    Returns:
        A TimeColumn of index 0; None where no reading fits 90 % of the cells, or half of them by name.

    Raises:
        BadSetting: the time format is not valid.
    """
    present = [cell for cell in cells if len(cell) <= MAX_STAMP_LENGTH and cell.lower() not in MISSING]
    present = [cell for cell in present if any(c.isdigit() for c in cell)]
    counted = present if len(present) <= _MAX_COUNTED else _spread(present)
    least = max((0.5 if hints.is_time else 0.9) * len(counted), 1)

    def fits(parse: StampParser) -> bool:
        # The first cells already show whether a column holds text.
        first = counted[:8]
        return any(parse(cell) is not None for cell in first) and _count(counted, parse) >= least

    if hints.time_format is not None:
        return _by_format(hints.time_format, fits)
    if hints.may_be_spreadsheet and fits(lambda cell: parse_excel(cell, decimal)):
        return TimeColumn(0, "calendar", odd=EXCEL)
    if _are_dates_in_digits(counted, hints):
        return TimeColumn(0, "calendar")
    short = _of_six_digits(counted, fits) if hints.may_be_spreadsheet else None
    if short is not None:
        return short
    number = TimeColumn(0, "number")
    if fits(stamp_parser(number, decimal)):
        return number
    # In a column that is named as a date, 17.05.24 is not a clock.
    calendar = _calendar(present, counted, least, hints.day_first) if hints.may_be_spreadsheet else None
    found = calendar or _clock(counted, least) or _calendar(present, counted, least, hints.day_first)
    return found or _with_dateutil(counted, hints, fits)


def _clock(counted: list[str], least: float) -> TimeColumn | None:
    counts = {form: _count(counted, CLOCK_PARSERS[form]) for form in _CLOCK_FORMS}
    best = max(_CLOCK_FORMS, key=lambda form: counts[form])
    return TimeColumn(0, "clock", clock=best) if counts[best] >= least else None


def _of_six_digits(counted: list[str], fits: Callable[[StampParser], bool]) -> TimeColumn | None:
    """A date such as 240331 in the order that reads most of the cells; of equals, the one that rises steadily."""
    found: list[tuple[int, tuple[int, float, float], TimeColumn]] = []
    for order in _ORDERS:
        column = TimeColumn(0, "calendar", order=order, odd=SIX_DIGITS)
        parse = stamp_parser(column, ".")
        if fits(parse):
            found.append((_count(counted, parse), _steadiness(_stamps(counted, parse)), column))
    return max(found, key=lambda one: one[:2], default=(0, (), None))[2]


def _are_dates_in_digits(counted: list[str], hints: StampHints) -> bool:
    """True for 20240229, 2024022912, 202402291200: the name allows it, or the steps are even only as dates.

    Numbers jump where a day or a month ends, 2024022923 to 2024030100. A number of ten digits may also be seconds
    since 1970, of which hardly one in a hundred is a date with an hour.
    """
    size = len(counted[0]) if counted else 0
    cells = [cell for cell in counted if len(cell) == size and cell.isascii() and cell.isdecimal()]
    stamps = _stamps(cells, parse_calendar)
    if size not in _DIGITS or np.count_nonzero(np.isfinite(stamps)) < max(0.9 * len(counted), 1):
        return False
    named = hints.is_date or (hints.is_time and size > 8)
    if named and (size != 10 or all(cell.startswith(_LIKELY_HOURS) for cell in cells)):
        return True
    return _steadiness(stamps) > _steadiness(np.array([float(cell) for cell in cells]))


def _by_format(form: str, fits: Callable[[StampParser], bool]) -> TimeColumn | None:
    check_format(form)
    if not fits(lambda cell: parse_with_format(cell, form)):
        return None
    return TimeColumn(0, "calendar" if has_date(form) else "clock", odd=form)


def _with_dateutil(counted: list[str], hints: StampHints, fits: Callable[[StampParser], bool]) -> TimeColumn | None:
    """A column that is named as a time, in words that only dateutil reads: it takes ten times as long per cell."""
    order: DateOrder = "mdy" if hints.day_first is False else "dmy"
    if not hints.is_time or not counted or not fits(lambda cell: parse_with_dateutil(cell, order)):
        return None
    return TimeColumn(0, "calendar", order=order, odd=DATEUTIL)


def _calendar(present: list[str], counted: list[str], least: float, day_first: bool | None) -> TimeColumn | None:
    orders = _ORDERS
    if day_first is not None:
        orders = ("ymd", "dmy") if day_first else ("ymd", "mdy")
    if not any(parse_calendar(cell, order) is not None for cell in counted[:8] for order in orders):
        return None
    counts = {order: _count(counted, _in_order(order)) for order in orders}
    likely: list[DateOrder] = [order for order in orders if counts[order] >= max(least, 0.9 * max(counts.values()))]
    if not likely:
        return None
    if len(likely) == 1 or day_first is not None:
        return TimeColumn(0, "calendar", order=max(likely, key=lambda order: counts[order]))
    return _order_by_all(present, likely)


def _order_by_all(cells: list[str], orders: list[DateOrder]) -> TimeColumn:
    """Of orders that fit nearly all cells, the one that fits most; of equals, the one whose stamps rise steadily.

    Where nothing decides, the day comes first, unless the log would then last many times longer.
    """
    stamps = {order: _stamps(cells, _in_order(order)) for order in orders}
    read = {order: int(np.count_nonzero(np.isfinite(stamps[order]))) for order in orders}
    rest: list[DateOrder] = [order for order in orders if read[order] == max(read.values())]
    quality = {order: _steadiness(stamps[order]) for order in rest}
    shortest = min(_span(stamps[order]) for order in rest)
    likely = {order: _span(stamps[order]) <= _MANY_TIMES * shortest for order in rest}
    best = max(rest, key=lambda order: (*quality[order], likely[order], order == "dmy", order == "ymd"))
    column = TimeColumn(0, "calendar", order=best)
    # Where both orders mean the same day (05/05) there is nothing to decide.
    for other in rest:
        if quality[other] == quality[best] and not np.array_equal(stamps[other], stamps[best], equal_nan=True):
            return replace(column, notes=(_order_note(cells[0], best, other),))
    return column


def _order_note(example: str, best: DateOrder, other: DateOrder) -> str:
    names = {"dmy": "day first", "mdy": "month first", "ymd": "year first"}
    option = {"dmy": "--day-first", "mdy": "--month-first", "ymd": '--time-format "%y-%m-%d"'}
    return (
        f"stamps such as {example} are read {names[best]} (assumed: the file does not show it);"
        f" they could also be {names[other]}: {option[other]}"
    )


def _span(stamps: Array) -> float:
    read = stamps[np.isfinite(stamps)]
    return float(np.ptp(read)) if read.size else 0.0


def _steadiness(stamps: Array) -> tuple[int, float, float]:
    """How well stamps rise: minus the steps back, the share of steps near the median, and of those equal to it."""
    steps = np.diff(stamps[np.isfinite(stamps)])
    back = int(min(np.count_nonzero(steps < 0), np.count_nonzero(steps > 0)))
    steps = np.abs(steps[steps != 0])
    if not steps.size:
        return -back, 1.0, 1.0
    usual = float(np.median(steps))
    near = float(np.mean(np.abs(steps - usual) <= _TOLERANCE * usual))
    return -back, near, float(np.mean(np.abs(steps - usual) <= 0.001 * usual))


def _in_order(order: DateOrder) -> StampParser:
    return lambda cell: parse_calendar(cell, order)


def _stamps(cells: Sequence[str], parse: StampParser) -> Array:
    return np.array([np.nan if (stamp := parse(cell)) is None else stamp for cell in cells])


def _count(cells: Sequence[str], parse: StampParser) -> int:
    return sum(parse(cell) is not None for cell in cells)


def _spread(cells: list[str]) -> list[str]:
    """The first cells, and as many spread over the rest."""
    half = _MAX_COUNTED // 2
    return cells[:half] + cells[half :: max(1, (len(cells) - half) // half)]
