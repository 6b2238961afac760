"""Calendar stamps in one cell, in one order of day, month and year: pure functions on text.

It reads numbers (`2022-02-23`, `23.02.22`), names of months (`23-Feb-2022`, `Feb 23, 2022`, `27. Mai 2021`), digits
alone (`20220223_071847`), the form of C and Java (`Wed Feb 23 07:18:47 GMT+08:00 2022`), a clock before the date.
A clock and a zone may follow. Each pattern has bounded repeats only; a cell above 64 characters is not a stamp.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import UTC, date, datetime
from functools import lru_cache
from typing import Literal

from kalscope.sources.grammar.stamps.clocks import CLOCK, MAX_STAMP_LENGTH, clock_of, parse_clock
from kalscope.sources.grammar.stamps.date_words import MONTHS, WEEKDAYS, ZONES_H

DateOrder = Literal["ymd", "dmy", "mdy"]
"""Which of year, month and day comes first, second and third."""

PIVOT_YEAR = 69
"""Two-digit years from here on are 19xx, as in POSIX; those below are 20xx."""

_EPOCH = datetime(1970, 1, 1)
_EPOCH_UTC = datetime(1970, 1, 1, tzinfo=UTC)
_EPOCH_DAY = _EPOCH.toordinal()
_DAY_US = 86400e6

_NUMERIC = re.compile(r"([0-9]{1,4})[-/.]([0-9]{1,2})[-/.]([0-9]{1,4})")
_MONTH = re.compile(r"([12][0-9]{3})[-/]([0-9]{1,2})")
_WORD = r"[^\W\d_]{3,10}"
_NAMED = re.compile(
    rf"(?:([^\W\d_]{{2,10}})[.,]{{0,2}} {{1,2}})?"
    rf"(?:([0-9]{{1,4}})[-/., ]{{1,2}}({_WORD})[-/., ]{{1,2}}([0-9]{{1,4}})"
    rf"|({_WORD})[-/., ]{{1,2}}([0-9]{{1,2}})[-/., ]{{1,2}}([0-9]{{1,4}}))"
)
_ZONE = (
    r"(?: ?([A-Za-z]{1,4}))?(?: ?([-+])([0-9]{1,2}):?([0-9]{2})?(?: [A-Z]{3,4})?)?"  # Go: +0800 CST
    r"(?: ?[\[(][A-Za-z0-9_/+ -]{1,40}[\])])?"  # Java: [Europe/Berlin], JavaScript: (China Standard Time)
)
_REST = re.compile(rf"[T _,;:-]{{1,3}}{CLOCK}{_ZONE}")
_CTIME = re.compile(rf"(?:([^\W\d_]{{2,10}})[.,]? )?({_WORD}) {{1,2}}([0-9]{{1,2}}),? {CLOCK}{_ZONE} ([0-9]{{4}})")
_COMPACT = re.compile(rf"([0-9]{{8}})(?:[T_ -]?([0-9]{{6}}|[0-9]{{4}}|[0-9]{{2}})(?:[.,]?([0-9]{{1,9}}))?{_ZONE})?")


def parse_calendar(cell: str, order: DateOrder = "ymd") -> float | None:
    """Microseconds since 1970 (UTC where no zone is given) of a stamp in an order of day, month and year.

    Returns:
        None for anything else. Fractions beyond the microsecond are cut.
    """
    if len(cell) > MAX_STAMP_LENGTH:
        return None
    for form in CALENDAR_FORMS:
        stamp = form(cell, order)
        if stamp is not None:
            return stamp
    return None


def parse_iso(cell: str, order: DateOrder) -> float | None:
    """ISO 8601 with a date of ten characters; the fast path."""
    if order != "ymd" or cell[4:8:3] != "--" or (len(cell) > 10 and (cell[10] not in "T " or cell[13:14] != ":")):
        return None
    if cell[19:20] == ":":  # fromisoformat takes the 5 ms of 12:00:00:5 for half a second
        return None
    try:
        stamp = datetime.fromisoformat(cell)
    except ValueError:
        return None
    since = stamp - _EPOCH if stamp.tzinfo is None else stamp - _EPOCH_UTC
    return (since.days * 86400 + since.seconds) * 1e6 + since.microseconds


def parse_numeric(cell: str, order: DateOrder) -> float | None:
    """`23.02.2022 07:18`, `2/23/22 7:18:47 PM`, `2022/02/23 07:18:47,5 UTC`."""
    match = _NUMERIC.match(cell)
    if match is None:
        return None
    day = _day(match[1], match[2], match[3], order)
    return None if day is None else _with_rest(day, cell[match.end() :])


def parse_named(cell: str, order: DateOrder) -> float | None:
    """`23-Feb-2022 07:18:47.375`, `Feb 23, 2022`, `Wed, 23 Feb 2022 07:18:47 +0800`, `27. Mai 2021`."""
    match = _NAMED.match(cell)
    if match is None or not is_weekday(match[1]):
        return None
    parts = (match[2], match[3], match[4]) if match[2] else (match[5], match[6], match[7])
    if (order == "mdy") != (match[5] is not None):
        return None
    day = _day(*parts, order)
    return None if day is None else _with_rest(day, cell[match.end() :])


def parse_ctime(cell: str, order: DateOrder) -> float | None:
    """`Wed Feb 23 07:18:47 GMT+08:00 2022`, `Feb 23 07:18:47.5 2022`."""
    match = _CTIME.fullmatch(cell) if order == "mdy" else None
    if match is None or not is_weekday(match[1]):
        return None
    groups = match.groups()
    day = _day(groups[1], groups[2], groups[-1], "mdy")
    return None if day is None else _added(day, groups[3:-5], groups[-5:-1])


def parse_compact(cell: str, order: DateOrder) -> float | None:
    """`20220223`, `2022022307`, `20220223_071847`, `20220223T071847.5Z`, `20220223 07:18:47`."""
    if order != "ymd" or len(cell) < 8 or not (cell.isascii() and cell[:8].isdecimal()):
        return None
    match, day = _COMPACT.fullmatch(cell), _day(cell[:4], cell[4:6], cell[6:8], "ymd")
    if match is None or day is None:
        return None if day is None else _with_rest(day, cell[8:])
    _, digits, fraction, *zone = match.groups()
    if digits is None:
        return day
    if fraction and len(digits) < 6:
        return None
    clock = (digits[:2], ":", digits[2:4] or "00", ":", digits[4:] or None, ".", fraction, None)
    return _added(day, clock, tuple(zone))


def parse_clock_first(cell: str, order: DateOrder) -> float | None:
    """`07:18:47 23.02.2022`, `7:18 PM 2/23/2022`."""
    if cell[1:2] != ":" and cell[2:3] != ":":
        return None
    clock, _, day = cell.rpartition(" ")
    since = parse_clock(clock.rstrip(" ,"))
    if since is None or ":" in day:
        return None
    start = parse_numeric(day, order)
    return None if start is None else start + since


def parse_month(cell: str, order: DateOrder) -> float | None:
    """`2022-02` and `2022/2`: the first day of a month."""
    match = _MONTH.fullmatch(cell) if order == "ymd" else None
    return None if match is None else _day(match[1], match[2], "1", "ymd")


def parse_six_digits(cell: str, order: DateOrder) -> float | None:
    """`240331` as the year, the month and the day in an order; only in a column named as a date."""
    if len(cell) != 6 or not (cell.isascii() and cell.isdecimal()):
        return None
    return _day(cell[:2], cell[2:4], cell[4:], order)


CALENDAR_FORMS: tuple[Callable[[str, DateOrder], float | None], ...] = (
    parse_iso,
    parse_numeric,
    parse_named,
    parse_ctime,
    parse_compact,
    parse_clock_first,
    parse_month,
)
"""The forms of a stamp. Where two of them read a cell, they agree."""


def is_weekday(word: str | None) -> bool:
    """True for a name of a weekday, abbreviated or not, and where there is none."""
    return word is None or word.lower()[:2] in WEEKDAYS


def day_us(year: int, month: int, day: int) -> float | None:
    """Microseconds from 1970 to a day; None for 31 February."""
    try:
        return (date(year, month, day).toordinal() - _EPOCH_DAY) * _DAY_US
    except ValueError:
        return None


def year_of(text: str) -> int | None:
    """The year that two or four digits mean."""
    if len(text) == 4:
        return int(text)
    if len(text) == 2:
        return int(text) + (1900 if int(text) >= PIVOT_YEAR else 2000)
    return None


@lru_cache(maxsize=4096)  # a log has few days and many stamps
def _day(first: str, second: str, third: str, order: DateOrder) -> float | None:
    """Microseconds from 1970 to the day of three parts; the month may be a name."""
    year, month, day = {
        "ymd": (first, second, third),
        "dmy": (third, second, first),
        "mdy": (third, first, second),
    }[order]
    number = int(month) if month.isdecimal() else MONTHS.get(month.lower(), 0)
    full = year_of(year)
    if full is None or (len(month) > 2 and month.isdecimal()) or len(day) > 2:
        return None
    return day_us(full, number, int(day))


def _with_rest(day: float, rest: str) -> float | None:
    """The stamp of a day with the clock and the zone after it."""
    if not rest:
        return day
    match = _REST.fullmatch(rest)
    if match is None:
        return None
    groups = match.groups()
    return _added(day, groups[:-4], groups[-4:])


def _added(day: float, clock: tuple[str | None, ...], zone: tuple[str | None, ...]) -> float | None:
    """The sum of a day, a clock and a zone (word, sign, hours, minutes)."""
    since, ahead = clock_of(clock, midnight=24), 0.0
    word, sign, hours, minutes = zone
    if since is None:
        return None
    if word is not None:
        known = ZONES_H.get(word.upper())
        if known is None:
            return None
        ahead = known * 3600e6
    if sign is not None:
        h, m = int(hours or 0), int(minutes or 0)
        if h > 18 or m > 59:
            return None
        ahead += (h * 3600 + m * 60) * (1e6 if sign == "+" else -1e6)
    return day + since - ahead
