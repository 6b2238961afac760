"""Stamps of every common form, turned into seconds: pure functions on text and arrays."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Literal

import numpy as np

from kalscope.common.array import Array
from kalscope.sources.lines.cells import MISSING, parse_number

TimeKind = Literal["number", "calendar", "clock", "yyyymmdd", "year day"]
DateOrder = Literal["ymd", "dmy", "mdy"]

SECONDS_PER_UNIT = {
    "s": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "ns": 1e-9,
    "min": 60.0,
    "h": 3600.0,
    "day": 86400.0,
    "year": 31557600.0,  # the Julian year of 365.25 days
}
"""Seconds in one unit of time."""

UNIT_OF_WORD = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "millis", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "µs", "μs", "usec", "micros", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanosecond", "nanoseconds"), "ns"),
    **dict.fromkeys(("min", "mins", "minute", "minutes"), "min"),
    **dict.fromkeys(("h", "hr", "hour", "hours"), "h"),
    **dict.fromkeys(("d", "day", "days"), "day"),
    **dict.fromkeys(("year", "years", "yr"), "year"),
}
"""The unit that a word in a header names, lower case."""

MAX_STAMP = 1e20
"""A numeric stamp beyond this is damage: epoch nanoseconds are 1.8e18."""

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)
_CLOCK = re.compile(r"([0-9]{1,2})[:.]([0-9]{2})(?:[:.]([0-9]{2})(?:[.,]([0-9]{1,9}))?)?")
_DATE = re.compile(r"([0-9]{1,4})[-/.]([0-9]{1,2})[-/.]([0-9]{1,4})(?:[T ]+(.+))?")
_ISO = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}(?:[T ].+)?")


@dataclass(frozen=True)
class TimeColumn:
    """Which column holds the time and how its cells are read."""

    index: int
    """Column of the stamp, from 0."""
    kind: TimeKind
    """Numbers, calendar stamps (ISO 8601 or d/m/y), clock times without a date, 20260131, or a year with the
    day of the year and the clock as 2359 in columns of their own."""
    unit: str = ""
    """Unit of a numeric stamp, a key of SECONDS_PER_UNIT; "" is decided by magnitude."""
    order: DateOrder = "ymd"
    """Order of the parts of a calendar stamp."""
    clock_index: int | None = None
    """Column of the clock where date and clock stand in two columns; None otherwise."""
    day_index: int | None = None
    """Column of the day of the year, 1 … 366, for "year day"; None otherwise."""

    @property
    def indices(self) -> tuple[int, ...]:
        """All columns that the time is made of."""
        return tuple(i for i in (self.index, self.day_index, self.clock_index) if i is not None)


def parse_clock(cell: str) -> float | None:
    """Microseconds since midnight of `12:00`, `12:00:00.023`, `18.00.00`; None for anything else."""
    match = _CLOCK.fullmatch(cell)
    if match is None:
        return None
    hour, minute, second = int(match[1]), int(match[2]), int(match[3] or 0)
    if hour > 23 or minute > 59 or second > 59:
        return None
    fraction = float("0." + match[4]) if match[4] else 0.0
    return (hour * 3600 + minute * 60 + second) * 1e6 + round(fraction * 1e6)


def parse_calendar(cell: str, order: DateOrder = "ymd") -> float | None:
    """Microseconds since 1970 (UTC where no zone is said) of an ISO 8601 or d/m/y stamp; else None."""
    try:
        if _ISO.fullmatch(cell):
            stamp = datetime.fromisoformat(cell)
            stamp = stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)
            return float((stamp - _EPOCH) // _MICROSECOND)
        match = _DATE.fullmatch(cell)
        if match is None:
            return None
        parts = dict(zip(order, (int(match[1]), int(match[2]), int(match[3])), strict=True))
        year = parts["y"] + (2000 if parts["y"] < 100 else 0)
        day = datetime(year, parts["m"], parts["d"], tzinfo=UTC)
        clock = parse_clock(match[4].strip()) if match[4] else 0.0
        return None if clock is None else float((day - _EPOCH) // _MICROSECOND) + clock
    except (ValueError, OverflowError):  # 31 February, year 0, a zone of 99 hours
        return None


def parse_yyyymmdd(cell: str) -> float | None:
    """Microseconds since 1970 of `19580329`; None for anything else."""
    if not re.fullmatch("[0-9]{8}", cell):
        return None
    return parse_calendar(f"{cell[:4]}-{cell[4:6]}-{cell[6:]}")


def parse_year_day(year: str, day: str, hhmm: str) -> float | None:
    """Microseconds since 1970 of `2018`, `291`, `2359`: year, day of the year, clock; None for anything else."""
    if not all(cell.isascii() and cell.isdecimal() for cell in (year, day, hhmm)):
        return None
    if not (1900 <= int(year) <= 2200 and 1 <= int(day) <= 366 and int(hhmm) <= 2400 and int(hhmm) % 100 < 60):
        return None
    start = datetime(int(year), 1, 1, tzinfo=UTC) + timedelta(days=int(day) - 1)
    return float((start - _EPOCH) // _MICROSECOND) + (int(hhmm) // 100 * 60 + int(hhmm) % 100) * 60e6


def row_stamp_parser(column: TimeColumn, decimal: str) -> Callable[[Sequence[str]], float | None]:
    """The function that reads the stamp of a row from all its cells, whatever columns it is made of."""
    index, day, clock = column.index, column.day_index, column.clock_index
    if column.kind == "year day" and day is not None and clock is not None:
        return lambda cells: parse_year_day(cells[index], cells[day], cells[clock])
    parse = stamp_parser(column, decimal)
    if clock is None:
        return lambda cells: parse(cells[index])

    def parse_both(cells: Sequence[str]) -> float | None:
        date, time = parse(cells[index]), parse_clock(cells[clock])
        return None if date is None or time is None else date + time

    return parse_both


def stamp_parser(column: TimeColumn, decimal: str) -> Callable[[str], float | None]:
    """The function that reads one cell of the time column; it answers None for a missing or damaged stamp."""
    if column.kind == "calendar":
        return lambda cell: parse_calendar(cell, column.order)
    if column.kind == "clock":
        return parse_clock
    if column.kind == "yyyymmdd":
        return parse_yyyymmdd

    def parse(cell: str) -> float | None:
        value = parse_number(cell, decimal)
        # NaN fails the comparison as well.
        return value if value is not None and abs(value) <= MAX_STAMP else None

    return parse


def time_kind(
    cells: Sequence[str], decimal: str, *, may_be_date: bool, share: float = 0.9
) -> tuple[TimeKind, DateOrder] | None:
    """The one reading that fits most of the cells that are there, the odd damaged one left aside.

    Args:
        cells: Cells of the column, from the head of the file.
        decimal: Decimal mark.
        may_be_date: True where the name allows 19580329 to be a date rather than a count.
        share: How many of the cells must fit, 0…1.
    """
    cells = [cell for cell in cells if cell.lower() not in MISSING]
    least = max(share * len(cells), 1)

    def fitting(parse: Callable[[str], float | None]) -> int:
        return sum(parse(cell) is not None for cell in cells)

    if may_be_date and fitting(parse_yyyymmdd) >= least:
        return "yyyymmdd", "ymd"
    if fitting(lambda cell: parse_number(cell, decimal)) >= least:
        return "number", "ymd"
    if fitting(parse_clock) >= least:
        return "clock", "ymd"
    # A day above 12 decides between 31/12 and 12/31; the day comes first where none does.
    orders: tuple[DateOrder, ...] = ("ymd", "dmy", "mdy")
    counts = {order: fitting(partial(parse_calendar, order=order)) for order in orders}
    best = max(orders, key=lambda order: counts[order])
    return ("calendar", best) if counts[best] >= least else None


def unit_by_magnitude(stamps: Array) -> str:
    """Unit of numeric stamps that name none: epoch stamps by their size, integer counters by their step.

    A sensor samples between once a second and a thousand times a second: integer steps of thousands are
    then microseconds, of millions nanoseconds. Whole minutes stay seconds, and so do all fractions.
    """
    low, high = float(stamps.min()), float(stamps.max())
    step = _median_step(stamps[:100_000])
    # The head is checked first: most stamps with fractions show them there.
    whole = all(bool(np.all(part == np.floor(part))) for part in (stamps[:1000], stamps))
    for size, unit in ((1e9, "s"), (1e12, "ms"), (1e15, "us"), (1e18, "ns")):
        # 2001 to 2100; whole seconds that step by thousands but not by minutes are a counter of µs.
        counter = unit == "s" and whole and step >= 1000 and step % 60 != 0
        if size <= low and high < 4.2 * size and not counter:
            return unit
    if not whole or step < 2 or step % 60 == 0:
        return "s"
    return "ms" if step < 1000 else "us" if step < 1e6 else "ns"


def is_epoch(stamps: Array, unit: str) -> bool:
    """True where numeric stamps count from 1970: the first one lies between 2001 and 2100."""
    scale = SECONDS_PER_UNIT[unit]
    return scale <= 1.0 and 1e9 <= float(stamps[0]) * scale < 4.2e9


def to_seconds(stamps: Array, column: TimeColumn) -> tuple[Array, str]:
    """Seconds of the stamps, shape (n,), n >= 1, and a sentence that says how they were read.

    Calendar and epoch stamps count from the first sample; others, years among them, as the source counts them.
    """
    if column.kind in ("calendar", "yyyymmdd", "year day"):
        start = _date_text(float(stamps[0]) * 1e-6)
        return (stamps - stamps[0]) / 1e6, f"time counts from the first stamp, {start}"
    if column.kind == "clock":
        # A clock that jumps back by more than half a day has passed midnight.
        days = np.cumsum(np.diff(stamps, prepend=stamps[0]) < -43200e6)
        seconds = (stamps - stamps[0]) / 1e6 + 86400.0 * days
        start = timedelta(microseconds=float(stamps[0]))
        passed = f"; the clock passes midnight {times(int(days[-1]))}" if days[-1] else ""
        return seconds, f"time counts from the first stamp, {start} on the clock{passed}"
    unit = column.unit or unit_by_magnitude(stamps)
    said = f"read as {unit}" if column.unit else f"read as {unit} (assumed from their size; no unit given)"
    scale = SECONDS_PER_UNIT[unit]
    if unit == "year":
        return stamps * scale, f"stamps are {said}"
    if is_epoch(stamps, unit):
        start = _date_text(float(stamps[0]) * scale)
        return _scaled(stamps - stamps[0], scale), f"stamps are {said} since 1970; time counts from {start}"
    return _scaled(stamps, scale), f"stamps are {said}"


def nominal_period(time: Array, steps: Array | None = None) -> float | None:
    """Median positive step of the stamps in s; None where no step is positive.

    `steps`, their differences, may be given to save time and memory; they come back in another order.
    Stamps coarser than the sampling (most steps are 0) have no telling step: then the mean step.
    """
    steps = np.diff(time) if steps is None else steps
    positive = steps if steps.size and float(steps.min()) > 0 else steps[steps > 0]
    if positive.size == 0:
        return None
    coarse = positive.size < steps.size / 2 and np.count_nonzero(steps == 0) > steps.size / 2
    if coarse and time[-1] > time[0]:
        return float((time[-1] - time[0]) / steps.size)
    # The stamps were decimal text: 0.02 - 0.01 is 0.01 within 1e-9, not 0.010000000000000002.
    return float(f"{np.median(positive, overwrite_input=True):.9g}")


def _scaled(stamps: Array, scale: float) -> Array:
    # Dividing by 1000 rounds 3 ms to the double nearest 0.003; multiplying by 0.001 may not.
    return stamps / round(1 / scale) if scale < 1 else stamps if scale == 1 else stamps * scale


def times(count: int) -> str:
    """`once`, `2 times`."""
    return "once" if count == 1 else f"{count} times"


def _date_text(seconds: float) -> str:
    try:
        return (_EPOCH + timedelta(seconds=seconds)).isoformat()
    except OverflowError:  # a zone can push a stamp of year 1 or 9999 over the calendar's edge
        return f"{seconds:g} s from 1970"


def _median_step(stamps: Array) -> float:
    steps = np.diff(stamps)
    positive = steps[steps > 0]
    return float(np.median(positive)) if positive.size else 0.0
