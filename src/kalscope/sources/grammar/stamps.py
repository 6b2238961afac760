"""Stamps in one cell: clock times, elapsed times, calendar stamps, and those in forms of the user."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import UTC, date, datetime, time, timedelta, timezone, tzinfo
from functools import lru_cache
from typing import Literal

from kalscope.errors import BadSetting
from kalscope.sources.grammar.cells import parse_number

# Words in calendar stamps: months and weekdays in English, German, French and Spanish, and names of time zones.


_NAMES = (
    "jan january januar jän jänner janv janvier ene enero",
    "feb february februar fév févr fevr février feber febrero",
    "mar march mär märz mrz maerz mars marzo",
    "apr april avr avril abr abril",
    "may mai mayo",
    "jun june juni juin junio",
    "jul july juli juil juillet julio",
    "aug august août aout ago agosto",
    "sep sept september septembre septiembre",
    "oct october okt oktober octobre octubre",
    "nov november novembre noviembre",
    "dec december dez dezember déc décembre dic diciembre",
)

MONTHS = {name: number for number, names in enumerate(_NAMES, 1) for name in names.split()}
"""Number of the month of a name, lower case, 1 … 12."""

WEEKDAYS = frozenset("mo tu we th fr sa su di mi do so lu ma me je ve".split())  # noqa: SIM905
"""The first two letters of the weekdays, lower case."""

ZONES_H = {
    **dict.fromkeys(("Z", "UTC", "GMT", "UT", "WET", "LST"), 0.0),  # LST: local standard time, no zone is known
    **dict.fromkeys(("CET", "MEZ", "BST", "WEST"), 1.0),
    **dict.fromkeys(("CEST", "MESZ", "EET"), 2.0),
    **dict.fromkeys(("EEST", "MSK"), 3.0),
    **dict.fromkeys(("SGT", "HKT", "AWST"), 8.0),
    **dict.fromkeys(("JST", "KST"), 9.0),
    **dict.fromkeys(("AEST",), 10.0),
    **dict.fromkeys(("AEDT",), 11.0),
    **dict.fromkeys(("NZST",), 12.0),
    **dict.fromkeys(("NZDT",), 13.0),
    **dict.fromkeys(("IST",), 5.5),
    **dict.fromkeys(("EDT",), -4.0),
    **dict.fromkeys(("EST", "CDT"), -5.0),
    **dict.fromkeys(("CST", "MDT"), -6.0),
    **dict.fromkeys(("MST", "PDT"), -7.0),
    **dict.fromkeys(("PST", "AKDT"), -8.0),
    **dict.fromkeys(("AKST",), -9.0),
    **dict.fromkeys(("HST",), -10.0),
}
"""Hours that a zone is ahead of UTC. Where a name is used twice (CST, IST), the changes of one log still come out
right: winter and summer time differ by an hour."""


# Clock times and elapsed times in one cell: pure functions on text.
#
# Each function returns None for any other text. All patterns have bounded repeats only.


ClockForm = Literal["h:m:s", "min:s", "elapsed", "hhmm", "hhmmss"]
"""A time of day (`18:00`, `7:03:05.5 PM`, `18.00.00`); minutes and seconds (`56:36.147`); hours that may exceed 24,
and days (`125:03:11`, `1 day, 0:00:05`); digits alone (`544`, `0544`; `54450`, `054450`)."""

TURNS_S: dict[ClockForm, float] = {
    "h:m:s": 86400.0,
    "min:s": 3600.0,
    "elapsed": 0.0,
    "hhmm": 86400.0,
    "hhmmss": 86400.0,
}
"""Seconds after which a clock of a form wraps to 0; 0 where it never does."""

MAX_STAMP_LENGTH = 64
"""A longer cell is not a stamp."""

CLOCK = (
    r"([0-9]{1,2})([:.])([0-9]{1,2})(?:([:.])([0-9]{1,2})(?:([.,:])([0-9]{1,9}))?)?(?: {0,2}([AaPp])\.?[Mm]\.?)?"
)
"""The pattern of a time of day. Groups: hour, mark, minute, mark, second, mark, fraction, letter of AM or PM."""

_CLOCK = re.compile(CLOCK)
_MINUTES = re.compile(r"([0-9]{1,4}):([0-5][0-9])(?:[.,]([0-9]{1,9}))?")
_ELAPSED = re.compile(
    r"([-+]?)(?:([0-9]{1,5})(?: days?,? |d |\.))?([0-9]{1,6}):([0-5][0-9]):([0-5][0-9])(?:[.,]([0-9]{1,9}))?"
)


def quick_clock(cell: str) -> float | None:
    """Microseconds since midnight of `07:18`, `07:18:47`, `07:18:47.375`; after None it may still be a clock."""
    size = len(cell)
    if cell[2:3] != ":" or cell[:2] == "24" or not (size in (5, 8) or (cell[8:9] in ".," and cell[9:].isdecimal())):
        return None
    try:
        clock = time.fromisoformat(cell)
    except ValueError:
        return None
    return ((clock.hour * 60 + clock.minute) * 60 + clock.second) * 1e6 + clock.microsecond


def parse_clock(cell: str, midnight: int = 0) -> float | None:
    """Microseconds since midnight of `12:00`, `12:00:00.023`, `18.00.00`, `7:03 PM`; 24:00 if `midnight` is 24."""
    if len(cell) > MAX_STAMP_LENGTH:
        return None
    quick = quick_clock(cell)
    if quick is not None:
        return quick
    match = _CLOCK.fullmatch(cell)
    return None if match is None else clock_of(match.groups(), midnight=midnight)


def clock_of(groups: tuple[str | None, ...], *, midnight: int = 0) -> float | None:
    """Microseconds since midnight of the groups of CLOCK.

    Args:
        groups: Hour, mark, minute, mark, second, mark, fraction, "a" or "p".
        midnight: 24 where 24:00 may end a day, else 0.
    """
    hour, separator, minute, other, second, mark, fraction, half = groups
    h, m, s = int(hour or 0), int(minute or 0), int(second or 0)
    if other not in (None, separator):
        return None
    if (len(minute or "") < 2 or len(second or "00") < 2) and (second is None or separator != ":"):
        return None  # 18:6:3 is a clock; 3:4 and 1.2.3 are not
    if half is not None:
        if not 1 <= h <= 12:
            return None
        h = h % 12 + (12 if half in "Pp" else 0)
    if m > 59 or s > 59 or (h > 23 and (h, m, s) != (midnight, 0, 0)):
        return None
    return (h * 3600 + m * 60 + s) * 1e6 + fraction_us(fraction, mark)


def fraction_us(digits: str | None, mark: str | None = ".") -> int:
    """Microseconds of the digits after a second, finer ones cut off; after a colon they count ms or µs."""
    if not digits:
        return 0
    if mark == ":":
        return int(digits) * 1000 if len(digits) <= 3 else int(digits[:6])
    return int(digits[:6].ljust(6, "0"))


def parse_minutes(cell: str) -> float | None:
    """Microseconds of `56:36.147`, minutes and seconds."""
    match = _MINUTES.fullmatch(cell)
    if match is None:
        return None
    return (int(match[1]) * 60 + int(match[2])) * 1e6 + fraction_us(match[3])


def parse_elapsed(cell: str) -> float | None:
    """Microseconds of `125:03:11.5`, `1 day, 0:00:05`, `-00:00:05`: hours that may exceed 24, days, a sign."""
    match = _ELAPSED.fullmatch(cell)
    if match is None:
        return None
    sign, days, hour, minute, second, fraction = match.groups()
    total = int(days or 0) * 86400 + int(hour) * 3600 + int(minute) * 60 + int(second)
    since = total * 1e6 + fraction_us(fraction)
    return -since if sign == "-" else since


def parse_hhmm(cell: str) -> float | None:
    """Microseconds since midnight of `0544` or `544` as 05:44, `5` as 00:05; 2400 ends a day."""
    return _digits(cell, 4, "")


def parse_hhmmss(cell: str) -> float | None:
    """Microseconds since midnight of `054450`, `54450`, `54450.25` as 05:44:50; 240000 ends a day."""
    whole, _, fraction = cell.partition(".")
    return _digits(whole, 6, fraction)


def _digits(whole: str, width: int, fraction: str) -> float | None:
    if not (whole.isascii() and whole.isdecimal() and len(whole) <= width):
        return None
    if fraction and not (fraction.isascii() and fraction.isdecimal() and len(fraction) <= 9):
        return None
    digits = whole.zfill(width)
    h, m, s = int(digits[:2]), int(digits[2:4]), int(digits[4:] or 0)
    if m > 59 or s > 59 or (h > 23 and (h, m, s) != (24, 0, 0)):
        return None
    return (h * 3600 + m * 60 + s) * 1e6 + fraction_us(fraction)


CLOCK_PARSERS: dict[ClockForm, Callable[[str], float | None]] = {
    "h:m:s": parse_clock,
    "min:s": parse_minutes,
    "elapsed": parse_elapsed,
    "hhmm": parse_hhmm,
    "hhmmss": parse_hhmmss,
}
"""The function that reads a cell of each form."""


# Calendar stamps in one cell, in one order of day, month and year: pure functions on text.
#
# It reads numbers (`2022-02-23`, `23.02.22`), names of months (`23-Feb-2022`, `Feb 23, 2022`, `27. Mai 2021`),
# digits alone (`20220223_071847`), the form of C and Java (`Wed Feb 23 07:18:47 GMT+08:00 2022`), a clock before
# the date. A clock and a zone may follow. Each pattern has bounded repeats only; a cell above 64 characters is not
# a stamp.


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


# Stamps that our own forms do not read: a format that the user gives, a spreadsheet's day numbers, and dateutil.
#
# Which of them a column is in is decided once for the whole column, never cell by cell.


# pyright: reportMissingModuleSource=false, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
# dateutil has no types of its own.


EXCEL = "excel"
"""Days since 1899-12-30, as spreadsheets count them."""
SIX_DIGITS = "six digits"
"""A date of two digits each for the year, the month and the day."""
DATEUTIL = "dateutil"
"""Whatever python-dateutil reads as a whole date."""

MIN_EXCEL, MAX_EXCEL = 20_000.0, 80_000.0
"""Days of 1954 to 2119: a number outside is not a spreadsheet date."""

_EXCEL_EPOCH_DAYS = 25569  # from 1899-12-30 to 1970-01-01
_MICROSECOND = timedelta(microseconds=1)
_DATE_CODES = frozenset("aAbBcdDGgjmuUVWwxyYFvhe")
_INVERTED_ZONE = re.compile(r"\b(?:GMT|UTC)(?=[-+])")  # dateutil takes "GMT+8" for 8 hours behind


def odd_parser(form: str, decimal: str, order: DateOrder) -> Callable[[str], float | None]:
    """The function that reads a cell of an odd form as microseconds; None for a damaged stamp."""
    if form == EXCEL:
        return lambda cell: parse_excel(cell, decimal)
    if form == SIX_DIGITS:
        return lambda cell: parse_six_digits(cell, order)
    if form == DATEUTIL:
        return lambda cell: parse_with_dateutil(cell, order)
    return lambda cell: parse_with_format(cell, form)


def parse_excel(cell: str, decimal: str) -> float | None:
    """Microseconds since 1970 of a spreadsheet's day number, `45123.5`."""
    days = parse_number(cell, decimal)
    if days is None or not MIN_EXCEL <= days <= MAX_EXCEL or cell[0] == "0":  # 030124 is a date in digits
        return None
    return round((days - _EXCEL_EPOCH_DAYS) * 86400e3) * 1e3  # spreadsheets resolve ms at best


def parse_with_format(cell: str, form: str) -> float | None:
    """Microseconds since 1970, or since midnight where the format names no part of a date."""
    if len(cell) > MAX_STAMP_LENGTH:
        return None
    try:
        stamp = datetime.strptime(cell, form)
    except ValueError:
        return None
    if not has_date(form):
        stamp = stamp.replace(year=1970, month=1, day=1)
    return _microseconds(stamp)


def has_date(form: str) -> bool:
    """True where a format of strptime names a part of a date."""
    return any(mark == "%" and code in _DATE_CODES for mark, code in _codes(form))


def check_format(form: str) -> None:
    """Raise BadSetting unless strptime knows every code of a format, and each occurs once."""
    try:
        datetime.strptime("", form)
    except ValueError as error:
        if "does not match" not in str(error):
            raise BadSetting(f"time_format must hold the codes of strptime (got {form!r}: {error})") from None
    except re.error:  # strptime makes a pattern with a named group for each code
        raise BadSetting(f"time_format must hold each code of strptime once (got {form!r})") from None
    if not _codes(form):
        raise BadSetting(f'time_format must look like "%d.%m.%Y %H:%M:%S" (got {form!r})')


def parse_with_dateutil(cell: str, order: DateOrder) -> float | None:
    """Microseconds since 1970 of a whole date in any form that python-dateutil reads."""
    if not 6 <= len(cell) <= MAX_STAMP_LENGTH or not any(c.isdigit() for c in cell):
        return None
    from dateutil import parser

    text, found = _INVERTED_ZONE.sub("", cell), set[float]()
    # A part that is missing would be taken from the default: two defaults must give one stamp.
    for default in (datetime(2000, 1, 1), datetime(2011, 12, 28)):
        try:
            stamp: datetime = parser.parse(
                text, default=default, dayfirst=order == "dmy", yearfirst=order == "ymd", tzinfos=_zone
            )
            found.add(_microseconds(stamp))
        except (ValueError, OverflowError, TypeError, IndexError, AttributeError):  # what it raises on odd text
            return None
    return found.pop() if len(found) == 1 else None


def _codes(form: str) -> list[tuple[str, str]]:
    return [("%", code) for code in re.findall(r"%[-#]?(.)", form)]


def _zone(name: str | None, offset: int | None) -> tzinfo:
    hours = ZONES_H.get((name or "").upper(), 0.0)
    return timezone(timedelta(hours=hours) if offset is None else timedelta(seconds=offset))


def _microseconds(stamp: datetime) -> float:
    ahead = stamp.utcoffset() or timedelta()
    return float((stamp.replace(tzinfo=None) - _EPOCH - ahead) // _MICROSECOND)


# Whether a cell is a stamp at all, whatever its form.


MIN_STAMP_LENGTH = 4
_MIN_DATE_LENGTH = 6


def is_stamp(cell: str) -> bool:
    """True where the cell is a date, a clock, an elapsed time or a date with a clock; never for a plain number."""
    if not MIN_STAMP_LENGTH <= len(cell) <= MAX_STAMP_LENGTH or not _may_be_stamp(cell):
        return False
    orders: tuple[DateOrder, ...] = ("ymd",) if cell[:4].isdecimal() else ("dmy", "mdy", "ymd")
    is_date = len(cell) >= _MIN_DATE_LENGTH and any(parse_calendar(cell, order) is not None for order in orders)
    return is_date or any(parse(cell) is not None for parse in (parse_clock, parse_minutes, parse_elapsed))


def _may_be_stamp(cell: str) -> bool:
    """True where the cell has the marks of a stamp; no plain number and few texts have them."""
    digits = sum(map(cell.count, "0123456789"))
    if digits < 3 or not (cell[0].isdigit() or cell[0].isalpha()):
        return False
    if ":" in cell or cell.count("-") + cell.count("/") + cell.count(".") >= 2:
        return True
    # A name of a month, or the T or _ of 20240313T093000.
    return digits < len(cell) - 1 or "_" in cell or "T" in cell
