"""Which columns of a log hold its time, how their stamps are written, and the function that reads them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from kalscope.common.numbers import Array
from kalscope.recording import Assumption
from kalscope.sources.grammar.cells import MISSING, UNIT_OF_WORD, parse_number, split_measure
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.grammar.stamps import (
    CLOCK_PARSERS,
    MAX_STAMP_LENGTH,
    SIX_DIGITS,
    TURNS_S,
    ClockForm,
    DateOrder,
    check_format,
    day_us,
    has_date,
    parse_calendar,
    parse_clock,
    parse_six_digits,
    parse_with_format,
    year_of,
)

# How the stamps of one column are written, decided once from many of its cells.


_SHEET_DAYS = (20_000.0, 80_000.0)
"""Days of 1954 to 2119 in a spreadsheet, which counts from 1899-12-30."""
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
class TimeName:
    """What the name of a column says about time; a hint, which the cells must confirm."""

    strength: int = 0
    """2: the name of a time and nothing else: half of the cells are enough, and 202402291200 may be a stamp; 1: a
    word of it is, or it may be one if it rises; 0: none."""
    unit: str = ""
    """Unit of time, a key of SECONDS_PER_UNIT; "" where none is given."""
    is_date: bool = False
    """True where the name says date: 19580329, 240331 and a spreadsheet's 45123.5 may be one."""


def find_stamp_form(
    cells: Sequence[str], decimal: str, name: TimeName = TimeName(), options: ReadOptions = DEFAULTS
) -> TimeColumn | None:
    """The one reading that fits most of the cells that hold a digit, a few damaged ones ignored.

    Returns:
        A TimeColumn of index 0; None where no reading fits 90 % of the cells, or half of them by name.

    Raises:
        BadSetting: the time format is not valid.
    """
    present = [cell for cell in cells if len(cell) <= MAX_STAMP_LENGTH and cell.lower() not in MISSING]
    present = [cell for cell in present if any(c.isdigit() for c in cell)]
    least = max((0.5 if name.strength == 2 else 0.9) * len(present), 1)

    def fits(parse: StampParser) -> bool:
        # The first cells already show whether a column holds text.
        return any(parse(cell) is not None for cell in present[:8]) and _count(present, parse) >= least

    if options.time_format is not None:
        check_format(options.time_format)
        kind = "calendar" if has_date(options.time_format) else "clock"
        given = TimeColumn(0, kind, odd=options.time_format)
        return given if fits(stamp_parser(given, decimal)) else None
    number = TimeColumn(0, "number")
    numbers = stamp_parser(number, decimal)
    if name.is_date and fits(lambda cell: _sheet_day(numbers(cell), cell)):
        return replace(number, unit="day")
    if _are_dates_in_digits(present, name):
        return TimeColumn(0, "calendar")
    if name.is_date and (short := _calendar(present, least, options, parse_six_digits)):
        return replace(short, odd=SIX_DIGITS)
    if fits(numbers):
        return number
    # In a column that is named as a date, 17.05.24 is not a clock.
    clock = None if name.is_date else _clock(present, least)
    return clock or _calendar(present, least, options) or _clock(present, least)


def _sheet_day(value: float | None, cell: str) -> float | None:
    """The number of a day in a spreadsheet, `45123.5`; 030124 is a date in digits."""
    return value if value is not None and _SHEET_DAYS[0] <= value <= _SHEET_DAYS[1] and cell[0] != "0" else None


def _clock(counted: list[str], least: float) -> TimeColumn | None:
    counts = {form: _count(counted, CLOCK_PARSERS[form]) for form in _CLOCK_FORMS}
    best = max(_CLOCK_FORMS, key=lambda form: counts[form])
    if counts[best] < least:
        return None
    column = TimeColumn(0, "clock", clock=best)
    if best != "h:m:s" or counts["min:s"] < counts[best]:
        return column
    said = f'stamps such as {counted[0]} are read as hours and minutes; minutes and seconds: --time-format "%M:%S"'
    return replace(column, notes=(Assumption(said),))


def _are_dates_in_digits(counted: list[str], name: TimeName) -> bool:
    """True for 20240229, 2024022912, 202402291200: the name allows it, or the steps are even only as dates.

    Numbers jump where a day or a month ends, 2024022923 to 2024030100. A number of ten digits may also be seconds
    since 1970, of which hardly one in a hundred is a date with an hour.
    """
    size = len(counted[0]) if counted else 0
    cells = [cell for cell in counted if len(cell) == size and cell.isascii() and cell.isdecimal()]
    stamps = _stamps(cells, parse_calendar)
    if size not in _DIGITS or np.count_nonzero(np.isfinite(stamps)) < max(0.9 * len(counted), 1):
        return False
    named = name.is_date or (name.strength == 2 and size > 8)
    if named and (size != 10 or all(cell.startswith(_LIKELY_HOURS) for cell in cells)):
        return True
    return _steadiness(stamps) > _steadiness(np.array([float(cell) for cell in cells]))


def _calendar(
    present: list[str],
    least: float,
    options: ReadOptions,
    parse: Callable[[str, DateOrder], float | None] = parse_calendar,
) -> TimeColumn | None:
    """The order that fits most cells; of equals, the one whose stamps rise steadily.

    Where nothing decides, the day comes first, unless the log would then last many times longer.
    """
    orders = _ORDERS
    if options.day_first is not None:
        orders = ("ymd", "dmy") if options.day_first else ("ymd", "mdy")
    if not any(parse(cell, order) is not None for cell in present[:8] for order in orders):
        return None
    stamps = {order: _stamps(present, _in_order(parse, order)) for order in orders}
    read = {order: int(np.count_nonzero(np.isfinite(stamps[order]))) for order in orders}
    rest: list[DateOrder] = [order for order in orders if read[order] == max(read.values())]
    if max(read.values()) < least:
        return None
    quality = {order: _steadiness(stamps[order]) for order in rest}
    shortest = min(_span(stamps[order]) for order in rest)
    likely = {order: _span(stamps[order]) <= _MANY_TIMES * shortest for order in rest}
    best = max(rest, key=lambda order: (*quality[order], likely[order], order == "dmy", order == "ymd"))
    # Where both orders mean the same day (05/05) there is nothing to decide.
    for other in rest if options.day_first is None else ():
        if quality[other] == quality[best] and not np.array_equal(stamps[other], stamps[best], equal_nan=True):
            return TimeColumn(0, "calendar", order=best, notes=(_order_note(present[0], best, other),))
    return TimeColumn(0, "calendar", order=best)


def _order_note(example: str, best: DateOrder, other: DateOrder) -> str:
    names = {"dmy": "day first", "mdy": "month first", "ymd": "year first"}
    option = {"dmy": "--day-first", "mdy": "--month-first", "ymd": '--time-format "%y-%m-%d"'}
    return Assumption(
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


def _in_order(parse: Callable[[str, DateOrder], float | None], order: DateOrder) -> StampParser:
    return lambda cell: parse(cell, order)


def _stamps(cells: Sequence[str], parse: StampParser) -> Array:
    return np.array([np.nan if (stamp := parse(cell)) is None else stamp for cell in cells])


def _count(cells: Sequence[str], parse: StampParser) -> int:
    return sum(parse(cell) is not None for cell in cells)


# Which columns of a log hold its time, and the function that reads the stamp of a row.


TimeKind = Literal["number", "calendar", "clock"]
PartRole = Literal["date", "year", "month", "day", "day of year", "clock", "hour", "minute", "second"]
StampParser = Callable[[str], "float | None"]

MAX_STAMP = 1e20
"""A numeric stamp beyond this is damage: epoch nanoseconds are 1.8e18."""

MAX_YEAR, MIN_YEAR = 2200, 1800
"""Years that a column of years may hold."""


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
    """How stamps that our own forms do not fit are read: "six digits", or a
    format of `datetime.strptime`; "" where our own forms fit."""
    parts: tuple[tuple[PartRole, int], ...] = ()
    """(role, column) of each part where the time is in several columns; () where it is in one."""
    day: float | None = None
    """The first readable date in µs since 1970, where date and clock are in two columns; for rows without one."""
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
    if column.odd == SIX_DIGITS:
        return partial(parse_six_digits, order=column.order)
    if column.odd:
        return partial(parse_with_format, form=column.odd)
    if column.kind == "calendar":
        return partial(parse_calendar, order=column.order)
    if column.kind == "clock":
        return CLOCK_PARSERS[column.clock]

    def parse(cell: str) -> float | None:
        value = parse_number(cell, decimal)
        if value is None and (measure := split_measure(cell)) and measure[1].lower() in UNIT_OF_WORD:
            value = parse_number(measure[0], decimal)  # 10 ms
        # NaN fails the comparison as well.
        return value if value is not None and abs(value) <= MAX_STAMP else None

    return parse


def _day_parser(
    column: TimeColumn, places: dict[PartRole, int], decimal: str
) -> Callable[[Sequence[str]], float | None]:
    """Microseconds from 1970 to the day of a row; 0 where no column holds the day."""
    if "date" in places:
        parse, date = stamp_parser(replace(column, kind="calendar", parts=()), decimal), places["date"]
        last = [column.day]

        def parse_date(cells: Sequence[str]) -> float | None:
            found = parse(cells[date])
            last[0] = last[0] if found is None else found  # a broken date is that of the row before
            return last[0]

        return parse_date
    if "year" not in places:
        return lambda _: 0.0
    year, month, day = places["year"], places.get("month"), places.get("day")
    number = places.get("day of year")

    def parse_day(cells: Sequence[str]) -> float | None:
        digits = whole(cells[year])
        full = None if digits is None else year_of(f"{digits:02}")
        if full is None or not MIN_YEAR <= full <= MAX_YEAR:
            return None
        if number is not None:
            count, start = whole(cells[number]), day_us(full, 1, 1)
            return start + (count - 1) * 86400e6 if start is not None and count and count <= 366 else None
        m, d = (1 if place is None else whole(cells[place]) for place in (month, day))
        return None if m is None or d is None else day_us(full, m, d)

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


def whole(cell: str) -> int | None:
    """The number in a cell of digits, `07` or `7.0`; None for anything else."""
    head, mark, tail = cell.partition(".")
    if not (head.isascii() and head.isdecimal() and len(head) <= 4) or (mark and tail.strip("0")):
        return None
    return int(head)
