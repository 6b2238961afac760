"""Which columns of a log hold its time, and the function that reads the stamp of a row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

from kalscope.sources.grammar.cells import parse_number
from kalscope.sources.grammar.stamps.clocks import (
    CLOCK_PARSERS,
    MAX_STAMP_LENGTH,
    TURNS_S,
    ClockForm,
    parse_clock,
    quick_clock,
)
from kalscope.sources.grammar.stamps.dates import (
    CALENDAR_FORMS,
    DateOrder,
    day_us,
    parse_calendar,
    parse_iso,
    year_of,
)
from kalscope.sources.grammar.stamps.odd_stamps import odd_parser, parse_with_format

TimeKind = Literal["number", "calendar", "clock"]
PartRole = Literal["date", "year", "month", "day", "day of year", "clock", "hour", "minute", "second"]
StampParser = Callable[[str], "float | None"]

MAX_STAMP = 1e20
"""A numeric stamp beyond this is damage: epoch nanoseconds are 1.8e18."""

MAX_YEAR, MIN_YEAR = 2200, 1800
"""Years that a column of years may hold."""

_MAX_PARTS_LENGTH = 24


@dataclass(frozen=True)
class TimeColumn:
    """Which columns hold the time and how their cells are read."""

    index: int
    """Column of the stamp, or of the first of its parts, from 0."""
    kind: TimeKind
    """Numbers, calendar stamps, or clock times without a date; the last two are read as microseconds."""
    unit: str = ""
    """Unit of a numeric stamp, a key of SECONDS_PER_UNIT; "" is decided by magnitude."""
    order: DateOrder = "ymd"
    """Order of the parts of a calendar stamp."""
    clock: ClockForm = "h:m:s"
    """How the clock is written, where one is alone or in a column of its own."""
    odd: str = ""
    """How stamps that our own forms do not fit are read: "dateutil", "excel" (days since 1900), "six digits", or a
    format of `datetime.strptime`; "" where our own forms fit."""
    parts: tuple[tuple[PartRole, int], ...] = ()
    """(role, column) of each part where the time is in several columns; () where it is in one."""
    also: tuple[int, ...] = ()
    """Other columns that only repeat a part of it: a year, a month, an hour."""
    notes: tuple[str, ...] = ()
    """What was assumed, each a sentence."""

    @property
    def indices(self) -> tuple[int, ...]:
        """All columns that the time is made of."""
        return tuple(i for _, i in self.parts) or (self.index,)

    @property
    def turn_s(self) -> float:
        """Seconds after which a clock wraps to 0; 0 where it never does."""
        return TURNS_S[self.clock] if self.kind == "clock" else 0.0


def row_stamp_parser(column: TimeColumn, decimal: str) -> Callable[[Sequence[str]], float | None]:
    """The function that reads the stamp of a row from all its cells, whatever columns it is made of.

    It returns microseconds for calendar stamps (since 1970, UTC where no zone is given) and clocks, the number
    itself for numbers, and None for a missing or damaged stamp.
    """
    if not column.parts:
        parse, index = stamp_parser(column, decimal), column.index
        return lambda cells: parse(cells[index])
    places = dict(column.parts)
    if "%" in column.odd:
        date, clock, form = places["date"], places["clock"], column.odd
        return lambda cells: parse_with_format(f"{cells[date]} {cells[clock]}", form)
    day = _day_parser(column, places, decimal)
    since = _clock_parser(column, places, decimal)

    def parse_parts(cells: Sequence[str]) -> float | None:
        start = day(cells)
        if start is None:
            return None
        clock = since(cells)
        return None if clock is None else start + clock

    return parse_parts


def stamp_parser(column: TimeColumn, decimal: str) -> StampParser:
    """The function that reads one cell of a time column; it returns None for a missing or damaged stamp."""
    if column.odd:
        return odd_parser(column.odd, decimal, column.order)
    if column.kind == "calendar":
        return calendar_parser(column.order)
    if column.kind == "clock":
        return CLOCK_PARSERS[column.clock]

    def parse(cell: str) -> float | None:
        value = parse_number(cell, decimal)
        # NaN fails the comparison as well.
        return value if value is not None and abs(value) <= MAX_STAMP else None

    return parse


def calendar_parser(order: DateOrder) -> StampParser:
    """As `parse_calendar`, but faster: days are remembered, and the form that read the last cell is tried first."""
    forms = list(CALENDAR_FORMS)

    def parse(cell: str) -> float | None:
        if len(cell) > MAX_STAMP_LENGTH:
            return None
        stamp = parse_iso(cell, order)
        if stamp is not None:
            return stamp
        head, _, tail = cell.rpartition(" ")
        clock = quick_clock(tail)
        day = None if clock is None or not head else _whole_day(head, order)
        if clock is not None and day is not None:
            return day + clock
        for i, form in enumerate(forms):
            stamp = form(cell, order)
            if stamp is not None:
                if i:
                    forms.insert(0, forms.pop(i))
                return stamp
        return None

    return parse


@lru_cache(maxsize=4096)
def _whole_day(text: str, order: DateOrder) -> float | None:
    """Microseconds from 1970 to the day of a text without a clock; None for anything else."""
    stamp = None if ":" in text else parse_calendar(text, order)
    return stamp if stamp is not None and stamp % 86400e6 == 0 else None


def _day_parser(
    column: TimeColumn, places: dict[PartRole, int], decimal: str
) -> Callable[[Sequence[str]], float | None]:
    """Microseconds from 1970 to the day of a row; 0 where no column holds the day."""
    if "date" in places:
        parse, date = stamp_parser(replace(column, kind="calendar", parts=()), decimal), places["date"]
        return lambda cells: parse(cells[date])
    if "year" not in places:
        return lambda _: 0.0
    year, month, day = places["year"], places.get("month"), places.get("day")
    number = places.get("day of year")

    def parse_day(cells: Sequence[str]) -> float | None:
        if number is not None:
            parts = (cells[year], cells[number])
        else:
            parts = (cells[year], "1" if month is None else cells[month], "1" if day is None else cells[day])
        if sum(map(len, parts)) > _MAX_PARTS_LENGTH:  # long texts are not remembered
            return None
        return _numbered_day(*parts) if len(parts) == 2 else _written_day(*parts)

    return parse_day


def _clock_parser(
    column: TimeColumn, places: dict[PartRole, int], decimal: str
) -> Callable[[Sequence[str]], float | None]:
    """Microseconds since midnight of a row; 0 where no column holds the clock."""
    if "clock" in places:
        clock, parse = places["clock"], CLOCK_PARSERS[column.clock]
        if column.clock == "h:m:s":
            return lambda cells: parse_clock(cells[clock], midnight=24)
        return lambda cells: parse(cells[clock])
    if "hour" not in places:
        return lambda _: 0.0
    hour, minute, second = places["hour"], places.get("minute"), places.get("second")

    def parse_three(cells: Sequence[str]) -> float | None:
        h, m = whole(cells[hour]), 0 if minute is None else whole(cells[minute])
        s = 0.0 if second is None else parse_number(cells[second], decimal)
        # NaN fails the comparison as well.
        if h is None or m is None or s is None or not (h <= 24 and m <= 59 and 0 <= s < 61):
            return None
        return (h * 3600 + m * 60) * 1e6 + round(s * 1e6)

    return parse_three


@lru_cache(maxsize=4096)
def _written_day(year: str, month: str, day: str) -> float | None:
    y, m, d = whole(year), whole(month), whole(day)
    if y is None or m is None or d is None:
        return None
    full = year_of(str(y).zfill(2))
    return None if full is None or not MIN_YEAR <= full <= MAX_YEAR else day_us(full, m, d)


@lru_cache(maxsize=4096)
def _numbered_day(year: str, day: str) -> float | None:
    start, number = _written_day(year, "1", "1"), whole(day)
    return None if start is None or number is None or not 1 <= number <= 366 else start + (number - 1) * 86400e6


def whole(cell: str) -> int | None:
    """The number in a cell of digits, `07` or `7.0`; None for anything else."""
    head, mark, tail = cell.partition(".")
    if not (head.isascii() and head.isdecimal() and len(head) <= 4) or (mark and tail.strip("0")):
        return None
    return int(head)
