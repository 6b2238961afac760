"""Stamps in one cell: clock times, elapsed times, calendar stamps, and those in forms of the user."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import UTC, date, datetime, time, timedelta
from functools import lru_cache
from typing import Literal

from kalscope.errors import BadSetting

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

_ZONES = (
    (0.0, "Z UTC GMT UT WET LST"),  # LST: local standard time, no zone is known
    (1.0, "CET MEZ BST WEST"),
    (2.0, "CEST MESZ EET"),
    (3.0, "EEST MSK"),
    (5.5, "IST"),
    (8.0, "SGT HKT AWST"),
    (9.0, "JST KST"),
    (10.0, "AEST"),
    (11.0, "AEDT"),
    (12.0, "NZST"),
    (13.0, "NZDT"),
    (-4.0, "EDT"),
    (-5.0, "EST CDT"),
    (-6.0, "CST MDT"),
    (-7.0, "MST PDT"),
    (-8.0, "PST AKDT"),
    (-9.0, "AKST"),
    (-10.0, "HST"),
)
ZONES_H = {name: hours for hours, names in _ZONES for name in names.split()}
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
_COUNTED = re.compile(
    r"([-+]?)(?:([0-9]{1,5})(?: days?,? |d |\.))?(?:([0-9]{1,6}):)?([0-9]{1,4}):([0-5][0-9])(?:[.,]([0-9]{1,9}))?"
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
    match = _CLOCK.fullmatch(cell.replace("h", ":", 1) if cell[1:3].strip("0123456789")[:1] == "h" else cell)
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
    match = _COUNTED.fullmatch(cell)
    return None if match is None or match[1] or match[2] or match[3] else _counted(match)


def parse_elapsed(cell: str) -> float | None:
    """Microseconds of `125:03:11.5`, `1 day, 0:00:05`, `-00:00:05`: hours that may exceed 24, days, a sign."""
    match = _COUNTED.fullmatch(cell)
    return None if match is None or not match[3] or len(match[4]) != 2 or match[4] > "59" else _counted(match)


def _counted(match: re.Match[str]) -> float:
    sign, days, hour, minute, second, fraction = match.groups()
    total = int(days or 0) * 86400 + int(hour or 0) * 3600 + int(minute) * 60 + int(second)
    since = total * 1e6 + fraction_us(fraction)
    return -since if sign == "-" else since


def parse_hhmm(cell: str) -> float | None:
    """Microseconds since midnight of `0544` or `544` as 05:44, `5` as 00:05; 2400 ends a day."""
    return _in_digits(cell, 4, "")


def parse_hhmmss(cell: str) -> float | None:
    """Microseconds since midnight of `054450`, `54450`, `54450.25` as 05:44:50; 240000 ends a day."""
    whole, mark, fraction = cell.partition(".")
    return _in_digits(whole, 6, mark + fraction)


def _in_digits(whole: str, width: int, fraction: str) -> float | None:
    if not (whole.isascii() and whole.isdecimal() and len(whole) <= width):
        return None
    digits = whole.zfill(width)
    return parse_clock(":".join(digits[i : i + 2] for i in range(0, width, 2)) + fraction, midnight=24)


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
# A day is three numbers (`2022-02-23`, `23.02.22`), has the name of a month (`23-Feb-2022`, `Feb 23, 2022`,
# `27. Mai 2021`) or is digits alone (`20220223_071847`); a clock and a zone may follow. Other shapes are rewritten
# as one of these: the clock before the day, the year at the end (`Wed Feb 23 07:18:47 GMT+08:00 2022`).


DateOrder = Literal["ymd", "dmy", "mdy"]
"""Which of year, month and day comes first, second and third."""

PIVOT_YEAR = 69
"""Two-digit years from here on are 19xx, as in POSIX; those below are 20xx."""

_EPOCH = datetime(1970, 1, 1)
_EPOCH_UTC = datetime(1970, 1, 1, tzinfo=UTC)
_EPOCH_DAY = _EPOCH.toordinal()
_DAY_US = 86400e6

_WORD, _GAP = r"[^\W\d_]{3,10}", r"(?:st|nd|rd|th)?[-/., ]{1,2}(?:of )?"
_CHINESE = str.maketrans({"年": "-", "月": "-", "日": "", "时": ":", "時": ":", "分": ":", "秒": ""})
_DAY = re.compile(
    r"([0-9]{1,4})[-/.]([0-9]{1,2})[-/.]([0-9]{1,4})|(?:([^\W\d_]{2,10})[.,]{0,2} {1,2})?"
    rf"(?:([0-9]{{1,4}}){_GAP}({_WORD}){_GAP}([0-9]{{1,4}})|({_WORD}){_GAP}([0-9]{{1,2}}){_GAP}([0-9]{{1,4}}))"
)
_ZONE = (
    r"(?: ?([A-Za-z]{1,4}))?(?: ?([-+])([0-9]{1,2}):?([0-9]{2})?(?: [A-Z]{3,4})?)?"  # Go: +0800 CST
    r"(?: ?[\[(][A-Za-z0-9_/+ -]{1,40}[\])])?"  # Java: [Europe/Berlin], JavaScript: (China Standard Time)
)
_REST = re.compile(rf"(?:[T _,;:-]{{1,3}}|,? at ){CLOCK}{_ZONE}")
_YEAR_LAST = re.compile(
    rf"^((?:[^\W\d_]{{2,10}}[.,]? )?{_WORD} {{1,2}}[0-9]{{1,2}}),? ([0-9]{{1,2}}:.{{2,40}}) ([0-9]{{4}})\Z"
)
_CLOCK_FIRST = re.compile(r"([0-9]{1,2}:.{2,24}?),? ([0-9]{1,4}[-/.][0-9]{1,2}[-/.][0-9]{1,4})")
_IN_BRACKETS = re.compile(r"(?<=[0-9]) \([A-Za-z]{3,10}\) ")
_MONTH = re.compile(r"[12][0-9]{3}[-/][0-9]{1,2}")
_CLOCK_IN_DIGITS = re.compile(
    rf"[T_ -]?([0-9]{{2}})(?:([0-9]{{2}})(?:([0-9]{{2}})(?:[.,]?([0-9]{{1,9}}))?)?)?{_ZONE}"
)


def parse_calendar(cell: str, order: DateOrder = "ymd") -> float | None:
    """Microseconds since 1970 (UTC where no zone is given) of a stamp in an order of day, month and year.

    Returns:
        None for anything else. Fractions beyond the microsecond are cut.
    """
    if len(cell) > MAX_STAMP_LENGTH:
        return None
    stamp = parse_iso(cell, order)
    if stamp is not None:
        return stamp
    has_half = cell[-1:] in ("M", "m")  # 2/23/2022 7:18:47 PM
    head, _, tail = cell.partition(" ") if has_half else cell.rpartition(" ")
    read = parse_clock if has_half else quick_clock
    for text, clock in ((head, tail), (tail, head)):
        if text and (since := read(clock)) is not None and (day := _whole_day(text, order)) is not None:
            return day + since
    return _parse_other(cell, order)


@lru_cache(maxsize=4096)  # a log has few days and many stamps
def _whole_day(text: str, order: DateOrder) -> float | None:
    """Microseconds from 1970 to the day of a text without a clock; None for anything else."""
    stamp = None if ":" in text else _parse_other(text, order)
    return stamp if stamp is not None and stamp % _DAY_US == 0 else None


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


def _parse_other(cell: str, order: DateOrder) -> float | None:
    """A stamp in any other shape."""
    if not cell.isascii():  # 2024年03月17日 08时30分
        cell = cell.translate(_CHINESE)
    if order == "ymd" and len(cell) >= 8 and cell.isascii() and cell[:8].isdecimal():
        day = _day(cell[:4], cell[4:6], cell[6:8], "ymd")
        match = _CLOCK_IN_DIGITS.fullmatch(cell, 8)
        if day is None or match is None:
            return None if day is None else _with_rest(day, cell[8:])
        hour, minute, second, fraction, *zone = match.groups()
        return _added(day, (hour, ":", minute or "00", ":", second, ".", fraction, None), tuple(zone))
    cell = _rewritten(cell, order)
    match = _DAY.match(cell)
    if match is None or not is_weekday(match[4]) or (match[5] and order == "mdy") or (match[8] and order != "mdy"):
        return None
    first = 1 if match[1] else 5 if match[5] else 8
    day = _day(match[first], match[first + 1], match[first + 2], order)
    return None if day is None else _with_rest(day, cell[match.end() :])


def _rewritten(cell: str, order: DateOrder) -> str:
    """The day first, then the clock, without `(Sunday)` between; a month has a first day."""
    cell = _IN_BRACKETS.sub(" ", cell)
    if cell[:1].isalpha():
        return _YEAR_LAST.sub(r"\1 \3 \2", cell) if order == "mdy" else cell
    if cell[1:2] == ":" or cell[2:3] == ":":
        return _CLOCK_FIRST.sub(r"\2 \1", cell, 1)
    return f"{cell}-1" if order == "ymd" and _MONTH.fullmatch(cell) else cell


def _with_rest(day: float, rest: str) -> float | None:
    """The stamp of a day with the clock and the zone after it."""
    match = _REST.fullmatch(rest) if rest else None
    if match is None:
        return None if rest else day
    return _added(day, match.groups()[:-4], match.groups()[-4:])


def parse_six_digits(cell: str, order: DateOrder) -> float | None:
    """`240331` as the year, the month and the day in an order; only in a column named as a date."""
    if len(cell) != 6 or not (cell.isascii() and cell.isdecimal()):
        return None
    return _day(cell[:2], cell[2:4], cell[4:], order)


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


# Stamps that our own forms do not read: a format that the user gives, and dates of six digits.
#
# Which of them a column is in is decided once for the whole column, never cell by cell.


SIX_DIGITS = "six digits"
"""A date of two digits each for the year, the month and the day."""

_DATE_CODES = frozenset("aAbBcdDGgjmuUVWwxyYFvhe")


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
    ahead = stamp.utcoffset() or timedelta()
    return float((stamp.replace(tzinfo=None) - _EPOCH - ahead) // timedelta(microseconds=1))


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


def _codes(form: str) -> list[tuple[str, str]]:
    return [("%", code) for code in re.findall(r"%[-#]?(.)", form)]


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
