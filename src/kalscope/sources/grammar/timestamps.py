"""The stamps in the cells of a log, of every common form: pure functions on text."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Literal

from kalscope.sources.grammar.cells import MISSING, parse_number

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
