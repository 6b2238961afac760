"""Stamps in cells: clocks, elapsed times and dates, how those of one column are written, and what reads them."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, time, timedelta
from functools import lru_cache, partial
from typing import Literal

import numpy as np

from kalscope.common.numbers import Array
from kalscope.errors import BadSetting
from kalscope.recording import Assumption
from kalscope.sources.grammar.cells import MISSING, UNIT_OF_WORD, parse_number, split_measure
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions

# Words in calendar stamps: months and weekdays in English, German, French and Spanish, and names of time zones.


_MONTHS = """
jan jän ene | feb fév | mar mär mae mrz | apr avr abr | may mai | jun juin | jul juil | aug aoû ago | sep | oct okt
| nov | dec dez déc dic
"""
_MONTH_OF = {name: number for number, names in enumerate(_MONTHS.split("|"), 1) for name in names.split()}
"""Number of the month by the beginning of its name, lower case."""

_WEEKDAYS = frozenset("mo tu we th fr sa su di mi do so lu ma me je ve".split())  # noqa: SIM905
"""The first two letters of the weekdays, lower case."""

_ZONES = """
Z 0 UTC 0 GMT 0 UT 0 LST 0 WET 0 WEST 1 BST 1 CET 1 MEZ 1 CEST 2 MESZ 2 EET 2 EEST 3 MSK 3 IST 5.5 SGT 8 HKT 8
AWST 8 JST 9 KST 9 AEST 10 AEDT 11 NZST 12 NZDT 13 HST -10 AKST -9 AKDT -8 PST -8 PDT -7 MST -7 MDT -6 CST -6 CDT -5
EST -5 EDT -4
"""
_HOURS_OF_ZONE: dict[str, float] = dict(zip(_ZONES.split()[::2], map(float, _ZONES.split()[1::2]), strict=True))
"""Hours that a zone is ahead of UTC; of LST, local standard time, nothing is known. Where a name is used twice
(CST), the changes of one log still come out right: winter and summer time differ by an hour."""


def month_of(name: str) -> int:
    """The number of the month of a name, 1 … 12; 0 for any other text."""
    name = name.lower()
    return _MONTH_OF.get(name[:3]) or _MONTH_OF.get(name[:4], 0)


def is_weekday(word: str | None) -> bool:
    """True for a name of a weekday, abbreviated or not, and where there is none."""
    return word is None or word.lower()[:2] in _WEEKDAYS


# Clock times and elapsed times in one cell: pure functions on text.
#
# Each function returns None for any other text. All patterns have bounded repeats only.


ClockForm = Literal["h:m:s", "elapsed", "h:mm", "hhmm", "hhmmss"]
"""A time of day (`18:00`, `7:03:05.5 PM`, `18.00.00`); elapsed minutes and seconds, hours that may exceed 24, days
(`56:36.147`, `125:03:11`, `1 day, 0:00:05`, `1h 2m 3s`); elapsed hours and minutes (`125:03`); digits alone (`544`,
`0544`; `54450`, `054450`)."""

MAX_STAMP_LENGTH = 64
"""A longer cell is not a stamp."""

_CLOCK_TEXT = (
    r"([0-9]{1,2})([:.])([0-9]{1,2})(?:([:.])([0-9]{1,2})(?:([.,:])([0-9]{1,9}))?)?"
    r"(?: {0,2}([AaPp])(?:\.? ?[Mm])?\.?)?"
)
"""The pattern of a time of day. Groups: hour, mark, minute, mark, second, mark, fraction, letter of AM or PM."""

_CLOCK = re.compile(_CLOCK_TEXT)
_ELAPSED = re.compile(
    r"([-+]?)(?:([0-9]{1,5})(?: ?d(?:ays?)?,? ?|\.(?=[0-9]{1,2}:..:)))?(?:([0-9]{1,6})(?::|h ?))?"
    r"([0-9]{1,4})(?::|m(?:in)? ?)([0-5]?[0-9])(?:[.,]([0-9]{1,9}))? ?s?"
)


def _quick_clock(cell: str) -> float | None:
    """Microseconds since midnight of `07:18`, `07:18:47`, `07:18:47.375`; after None it may still be a clock."""
    size = len(cell)
    if cell[2:3] != ":" or cell[:2] == "24" or not (size in (5, 8) or (cell[8:9] in ".," and cell[9:].isdecimal())):
        return None
    try:
        clock = time.fromisoformat(cell)
    except ValueError:
        return None
    return ((clock.hour * 60 + clock.minute) * 60 + clock.second) * 1e6 + clock.microsecond


def parse_clock(cell: str) -> float | None:
    """Microseconds since midnight of `12:00`, `12:00:00.023`, `18.00.00`, `7:03 PM`; 24:00 ends a day."""
    if len(cell) > MAX_STAMP_LENGTH:
        return None
    quick = _quick_clock(cell)
    cell = cell.replace("h", ":", 1) if cell[1:3].strip("0123456789")[:1] == "h" else cell  # 8h30
    match = _CLOCK.fullmatch(_without_zone(cell)) if quick is None else None
    return quick if match is None else _clock_of(match.groups())


def _without_zone(cell: str) -> str:
    """`01:00` of `01:00 UTC`, `0100` of `0100Z`; like any clock it is that of its place."""
    bare = cell.rstrip("ABCDEFGHIJKLMNOPQRSTUVWXYZ")
    return bare.rstrip(" ") if cell[len(bare) :] in _HOURS_OF_ZONE else cell


def _clock_of(groups: Sequence[str | None]) -> float | None:
    """Microseconds since midnight of the groups of the pattern of a clock."""
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
    if m > 59 or s > 59 or (h > 23 and (h, m, s) != (24, 0, 0)):
        return None
    return (h * 3600 + m * 60 + s) * 1e6 + _fraction_us(fraction, mark)


def _fraction_us(digits: str | None, mark: str | None = ".") -> int:
    """Microseconds of the digits after a second, finer ones cut off; after a colon they count ms or µs."""
    if not digits:
        return 0
    if mark == ":":
        return int(digits) * 1000 if len(digits) <= 3 else int(digits[:6])
    return int(digits[:6].ljust(6, "0"))


def _parse_elapsed(cell: str) -> float | None:
    """Microseconds of `125:03:11.5`, `56:36.147`, `1 day, 0:00:05`, `-00:00:05`, `1h 2m 3s`."""
    match = _ELAPSED.fullmatch(cell)
    if match is None or (match[3] and int(match[4]) > 59) or (":" in cell and len(match[5]) < 2):
        return None
    days, hours, minutes, seconds = (int(part or 0) for part in match.groups()[1:5])
    since = (((days * 24 + hours) * 60 + minutes) * 60 + seconds) * 1e6 + _fraction_us(match[6])
    return -since if match[1] == "-" else since


def _parse_digits(cell: str, width: int) -> float | None:
    """Microseconds since midnight of `0544`, `544` and `5` as 05:44 and 00:05, of six digits with their seconds."""
    whole, mark, fraction = _without_zone(cell).partition(".")
    if not (whole.isascii() and whole.isdecimal() and len(whole) <= width) or (mark and width == 4):
        return None
    digits = whole.zfill(width)
    return parse_clock(":".join(digits[i : i + 2] for i in range(0, width, 2)) + mark + fraction)


CLOCK_PARSERS: dict[ClockForm, Callable[[str], float | None]] = {
    "h:m:s": parse_clock,
    "elapsed": _parse_elapsed,
    "h:mm": lambda cell: _parse_elapsed(f"{cell}:00"),
    "hhmm": partial(_parse_digits, width=4),
    "hhmmss": partial(_parse_digits, width=6),
}
"""The function that reads a cell of each form."""


# Calendar stamps in one cell, in one order of day, month and year: pure functions on text.
#
# A day is three numbers (`2022-02-23`, `23.02.22`), has the name of a month (`23-Feb-2022`, `Feb 23, 2022`,
# `27. Mai 2021`) or is digits alone (`20220223_071847`); a clock and a zone may follow. Other shapes are rewritten
# as one of these: the clock before the day, the year at the end (`Wed Feb 23 07:18:47 GMT+08:00 2022`).


DateOrder = Literal["ymd", "dmy", "mdy"]
"""Which of year, month and day comes first, second and third."""

_EPOCH = datetime(1970, 1, 1)
_EPOCH_UTC = datetime(1970, 1, 1, tzinfo=UTC)
DAY_US = 86400e6

_WORD = r"[^\W\d_]{3,10}"
_GAP = r"(?:st|nd|rd|th)?[-/., ]{1,2}(?:of )?"
_DAY = re.compile(
    r"([0-9]{1,4})[-/.]([0-9]{1,2})[-/.]([0-9]{1,4})|(?:([^\W\d_]{2,10})[.,]{0,2} {1,2})?"
    rf"(?:([0-9]{{1,4}}){_GAP}({_WORD}){_GAP}([0-9]{{1,4}})|({_WORD}){_GAP}([0-9]{{1,2}}){_GAP}([0-9]{{1,4}}))"
)
_REST = re.compile(
    rf"(?:[T _,;:-]{{1,3}}|,? (?:at|@|klo) ){_CLOCK_TEXT}"
    r"(?: ?([A-Za-z]{1,4}))?(?: ?([-+])([0-9]{1,2}):?([0-9]{2})?(?: [A-Z]{3,4})?)?"  # Go: +0800 CST
    r"(?: ?[\[(][A-Za-z0-9_/+ -]{1,40}[\])])?"  # Java: [Europe/Berlin], JavaScript: (China Standard Time)
)
_YEAR_LAST = re.compile(
    rf"^((?:[^\W\d_]{{2,10}}[.,]? {{1,2}})?(?:{_WORD} {{1,2}}[0-9]{{1,2}}|[0-9]{{1,2}}\.? {_WORD})),?"
    r" ([0-9]{1,2}:.{2,40}) ([0-9]{4})\Z"
)
_CLOCK_FIRST = re.compile(r"^([0-9]{1,2}:.{2,24}?),? ([0-9]{1,4}[-/.][0-9]{1,2}[-/.][0-9]{1,4})")
_CHINESE = str.maketrans({"年": "-", "月": "-", "日": "", "时": ":", "時": ":", "分": ":", "秒": ""})
_HALF_FIRST = re.compile(r"(\w{2}) ?([0-9]{1,2}:[0-9:]{2,5})")
_AFTERNOON = ("오후", "下午", "午後")


def parse_calendar(cell: str, order: DateOrder = "ymd") -> float | None:
    """Microseconds since 1970 (UTC where no zone is given) of a stamp in an order of day, month and year.

    Returns:
        None for anything else. Fractions beyond the microsecond are cut.
    """
    if len(cell) > MAX_STAMP_LENGTH:
        return None
    stamp = _parse_iso(cell) if order == "ymd" else None
    if stamp is not None:
        return stamp
    has_half = cell[-1:] in ("M", "m")  # 2/23/2022 7:18:47 PM
    head, _, tail = cell.partition(" ") if has_half else cell.rpartition(" ")
    read = parse_clock if has_half else _quick_clock
    for text, clock in ((head, tail), (tail, head)):
        if text and (since := read(clock)) is not None and (day := _whole_day(text, order)) is not None:
            return day + since
    return _parse_other(cell, order)


def _parse_iso(cell: str) -> float | None:
    """ISO 8601 with a date of ten characters or of eight digits, `20220223_071847`; the fast path."""
    if cell[:8].isdecimal() and cell.isascii() and len(cell) >= 8:
        rest = cell[9:] if cell[8:9] in ("T", "_", " ", "-", ":") else cell[8:]
        rest = f"{rest[:6]}.{rest[6:]}" if rest[:7].isdecimal() and len(rest) > 6 else rest
        cell = f"{cell[:8]}T{rest}" if rest else cell
    elif cell[4:8:3] != "--" or (len(cell) > 10 and (cell[10] not in "T " or cell[13:14] != ":")):
        return None
    if cell[19:20] == ":":  # fromisoformat takes the 5 ms of 12:00:00:5 for half a second
        return None
    try:
        stamp = datetime.fromisoformat(cell)
    except ValueError:
        return None
    since = stamp - _EPOCH if stamp.tzinfo is None else stamp - _EPOCH_UTC
    return (since.days * 86400 + since.seconds) * 1e6 + since.microseconds


@lru_cache(maxsize=4096)  # a log has few days and many stamps
def _whole_day(text: str, order: DateOrder) -> float | None:
    """Microseconds from 1970 to the day of a text without a clock; None for anything else."""
    stamp = None if ":" in text else _parse_other(text, order)
    return stamp if stamp is not None and stamp % DAY_US == 0 else None


def _parse_other(cell: str, order: DateOrder) -> float | None:
    """A stamp in any other shape."""
    if len(cell) == 6 and cell.isascii() and cell.isdecimal():
        return _day(cell[:2], cell[2:4], cell[4:], order)
    if "(" in cell or not cell.isascii():
        cell = _HALF_FIRST.sub(_half_last, cell.translate(_CHINESE)).rstrip(":")
        cell = re.sub(r"(?<=[0-9]) \([A-Za-z]{3,10}\) ", " ", cell)
    cell = re.sub(r"^([0-9]{1,4})\. ([0-9]{1,2})\. ([0-9]{1,4})\.?", r"\1.\2.\3", cell) if ". " in cell else cell
    if cell[:1].isalpha():
        cell = _YEAR_LAST.sub(r"\1 \3 \2", cell)
    elif ":" in cell[1:3]:
        cell = _CLOCK_FIRST.sub(r"\2 \1", cell)
    elif len(cell) <= 7 and re.fullmatch(r"[12][0-9]{3}[-/][0-9]{1,2}", cell):
        cell += "-1"
    match = _DAY.match(cell)
    if match is None or not is_weekday(match[4]) or (match[5] and order == "mdy") or (match[8] and order != "mdy"):
        return None
    first = 1 if match[1] else 5 if match[5] else 8
    day, rest = _day(match[first], match[first + 1], match[first + 2], order), cell[match.end() :]
    return _with_rest(day, rest) if rest and day is not None else day


def _half_last(match: re.Match[str]) -> str:
    """`9:00 AM` of `오전 9:00`, as Korean, Chinese and Japanese write it."""
    is_half = match[1] in (*_AFTERNOON, "오전", "上午", "午前")
    return f"{match[2]} {'PM' if match[1] in _AFTERNOON else 'AM'}" if is_half else match[0]


def _with_rest(day: float, rest: str) -> float | None:
    """The stamp of a day with the clock and the zone after it."""
    match = _REST.fullmatch(rest)
    if match is None:
        return None
    *clock, zone, sign, hours, minutes = match.groups()
    since, ahead = _clock_of(clock), _HOURS_OF_ZONE.get((zone or "Z").upper())
    h, m = int(hours or 0), int(minutes or 0)
    if since is None or ahead is None or h > 18 or m > 59:
        return None
    return day + since - ahead * 3600e6 - (h * 3600 + m * 60) * (-1e6 if sign == "-" else 1e6)


@lru_cache(maxsize=4096)
def day_us(year: int, month: int, day: int) -> float | None:
    """Microseconds from 1970 to a day, of a year of two or four digits; None for 31 February."""
    year += 0 if year > 99 else 1900 if year >= 69 else 2000  # as in POSIX
    try:
        return (date(year, month, day) - _EPOCH.date()).days * DAY_US
    except ValueError:
        return None


@lru_cache(maxsize=4096)
def _day(first: str, second: str, third: str, order: DateOrder) -> float | None:
    """Microseconds from 1970 to the day of three parts; the month may be a name."""
    part = dict(zip(order, (first, second, third), strict=True))
    year, month, day = part["y"], part["m"], part["d"]
    is_year = len(year) == 2 or (len(year) == 4 and year >= "0100")
    if not is_year or len(day) > 2 or (len(month) > 2 and month.isdecimal()):
        return None
    return day_us(int(year), int(month) if month.isdecimal() else month_of(month), int(day))


# Stamps in a format that the user gives.


def _parse_with_format(cell: str, form: str) -> float | None:
    """Microseconds since 1970, or since midnight where the format names no part of a date."""
    if len(cell) > MAX_STAMP_LENGTH:
        return None
    try:
        stamp = datetime.strptime(cell, form)
    except ValueError:
        return None
    if not _has_date(form):
        stamp = stamp.replace(year=1970, month=1, day=1)
    ahead = stamp.utcoffset() or timedelta()
    return float((stamp.replace(tzinfo=None) - _EPOCH - ahead) // timedelta(microseconds=1))


@lru_cache
def _has_date(form: str) -> bool:
    """True where a format of strptime names a part of a date."""
    return datetime(2001, 2, 3).strftime(form) != datetime(1999, 12, 30).strftime(form)


def _check_format(form: str) -> None:
    """Raise BadSetting unless strptime knows every code of a format, and each occurs once."""
    try:
        datetime.strptime("", form)
        valid = True
    except (ValueError, re.error) as error:  # strptime makes a pattern with a named group for each code
        valid = "does not match" in str(error)
    if not valid or "%" not in form:
        example = '"%d.%m.%Y %H:%M:%S"'
        raise BadSetting(f"time_format must hold codes of strptime, each once, such as {example} (got {form!r})")


# Whether a cell is a stamp at all, whatever its form.


def is_stamp(cell: str) -> bool:
    """True where the cell is a date, a clock, an elapsed time or a date with a clock; never for a plain number."""
    digits = sum(map(cell.count, "0123456789"))
    # The mark of a clock, two others, or the T or _ of 20240313T093000: no plain number and few texts have them.
    is_marked = len(cell) - digits >= 2 or any(mark in cell for mark in ":T_")
    if digits < 3 or not is_marked or not cell[0].isalnum() or len(cell) > MAX_STAMP_LENGTH:
        return False
    orders: tuple[DateOrder, ...] = ("ymd",) if cell[:4].isdecimal() else _ORDERS
    is_date = len(cell) >= 6 and any(parse_calendar(cell, order) is not None for order in orders)
    return is_date or any(CLOCK_PARSERS[form](cell) is not None for form in _CLOCK_FORMS)


# How well stamps show that they are the time: fill, order, resolution, evenness.


MAX_BACK = 0.25
"""Share of steps back with which numbers may be a time whose name is clear."""
MIN_EVEN = 0.9
"""Share of alike steps of a ramp that is a time although no name says it."""
_EVEN_WITHIN = 0.2


@dataclass(frozen=True)
class Evidence:
    """What the stamps of the sampled rows show, each as a share of 1."""

    fill: float = 0.0
    """Rows whose stamp can be read."""
    back: float = 0.0
    """Of the steps that move, those against the direction of most; a clock that passes midnight moves forward."""
    distinct: float = 1.0
    """Stamps that do not repeat the one before: below 1 the clock is coarser than the sampling, 0: it stands."""
    even: float = 0.0
    """Steps within a fifth of the median step: months are even."""
    exact: float = 0.0
    """Steps within a thousandth of it."""

    @property
    def weight(self) -> float:
        """Points of a candidate; those for its name and form are added."""
        return 3.0 * self.distinct + self.even - (10.0 * (1.0 - self.fill) + 20.0 * self.back)

    @property
    def steadiness(self) -> tuple[float, float, float]:
        """How well the stamps rise, to compare two readings of the same cells."""
        return -self.back, self.even, self.exact


def judge(stamps: Array, column: TimeColumn | None = None) -> Evidence:
    """What the stamps of a column of the sampled rows, shape (n,), NaN where unreadable, show."""
    read = stamps[np.isfinite(stamps)]
    if not read.size:
        return Evidence()
    steps = np.diff(unwrap(read, column)[0])
    ahead, back = int(np.count_nonzero(steps > 0)), int(np.count_nonzero(steps < 0))
    fill, moving = read.size / stamps.size, ahead + back
    if not moving:
        return Evidence(fill, distinct=0.0 if steps.size else 1.0)
    steps = steps if ahead >= back else -steps
    usual = float(np.median(np.abs(steps[steps != 0])))
    off = np.abs(steps - usual) / usual
    even, exact = (float(np.mean(off <= share)) for share in (_EVEN_WITHIN, 0.001))
    share = min(ahead, back) / moving
    if share > MAX_BACK and in_order_is_even(read):
        share = MAX_BACK
    return Evidence(fill, share, moving / steps.size, even, exact)


def in_order_is_even(stamps: Array) -> bool:
    """True for even stamps whose rows are out of order."""
    steps = np.diff(np.sort(stamps))
    return bool(np.mean(np.abs(steps - np.median(steps)) < _EVEN_WITHIN * np.median(steps)) > MIN_EVEN)


# What stamps count from and where they begin again.


_EPOCHS: tuple[tuple[float, float, str, float], ...] = (
    (1e9, 3e9, "s", 0),  # 2001 to 2065
    (3e9, 4.2e9, "s", 2_082_844_800),  # LabVIEW counts from 1904: 1999 to 2037
    (1e12, 4.2e12, "ms", 0),
    (1e15, 4.2e15, "us", 0),
    (1e18, 4.2e18, "ns", 0),
    (1.26e17, 1.6e17, "100ns", 116_444_736_000_000_000),  # Windows counts from 1601
    (6.3e17, 6.7e17, "100ns", 621_355_968_000_000_000),  # .NET counts from the year 1
    (20_000, 52_000, "day", 25_569),  # spreadsheets: 1954 to 2042
    (52_000, 80_000, "day", 40_587),  # modified Julian dates: 2001 to 2077
    (725_000, 770_000, "day", 719_529),  # MATLAB's datenum: 1984 to 2108
    (2_440_000, 2_490_000, "day", 2_440_587.5),  # Julian dates: 1968 to 2105
)
"""Lowest and highest stamp that count from a date, their unit, and the stamp of 1970-01-01."""


def find_epoch(stamps: Array, unit: str = "") -> tuple[str, float] | None:
    """Unit of stamps that all count from one date, and the stamp of 1970-01-01; None for others.

    Numbers of days only where that is their unit: many sensors show 40 000.
    """
    low, high = (float(stamps.min()), float(stamps.max())) if stamps.size else (0.0, 0.0)
    found = ((one, since) for least, most, one, since in _EPOCHS if least <= low and high < most)
    return next((epoch for epoch in found if epoch[0] == unit or (not unit and epoch[0] != "day")), None)


_TURNS = {
    "h:m:s": ((43200e6, "a clock at noon"), (DAY_US, "a clock at midnight")),
    "elapsed": ((3600e6, "a clock at the full hour"),),
    "h:mm": (),
    "calendar": ((3600e6, "a clock that is set back by an hour"),),
    "number": (
        (2.0**16, "a 16-bit counter"),
        (86_400.0, "seconds of the day"),
        (604_800.0, "seconds of the week"),
        (86_400e3, "milliseconds of the day"),
        (604_800e3, "milliseconds of the week"),
        (2.0**32, "a 32-bit counter (millis() or micros())"),
        (2.0**32 / 1e3, "a 32-bit counter (millis() or micros())"),
        (2.0**32 / 1e6, "a 32-bit counter (micros())"),
    ),
}
"""Where stamps begin again, and what does so."""


def unwrap(stamps: Array, column: TimeColumn | None = None) -> tuple[Array, str]:
    """Stamps that go on where they begin again, and a sentence about it; "" where they do not.

    Only where the step over the wrap is an ordinary one: a device that restarts jumps back to 0 from anywhere, and
    stays a step back. A clock may miss half a day.
    """
    back = np.flatnonzero(stamps[1:] < stamps[:-1])
    steps = np.diff(stamps) if back.size else stamps[:0]
    if not np.any(steps > 0):  # nothing steps back, or nothing goes on
        return stamps, ""
    usual, span = 2 * float(np.quantile(steps[steps > 0], 0.98)), float(np.ptp(stamps))
    kind = "number" if column is None else column.kind
    is_date, form = kind == "calendar", column.clock if column and kind == "clock" else kind
    for size, what in _TURNS.get(form, _TURNS["h:m:s"]):
        over = steps[back] + size
        wraps = back[(over >= 0) & (over <= (size / 2 if size == DAY_US else min(usual, size / 4)))]
        fits = wraps.size == back.size if is_date else span < size and float(stamps.min()) >= 0
        if wraps.size and fits:
            turned = np.zeros(len(stamps))
            turned[wraps + 1] = size
            said = f"the stamps wrap {times(wraps.size)}, like {what}, and were unwrapped"
            return stamps + np.cumsum(turned), said
    return stamps, ""


def times(count: int) -> str:
    """`once`, `2 times`."""
    return "once" if count == 1 else f"{count} times"


# How the stamps of one column are written, decided once from many of its cells.


_CLOCK_FORMS: tuple[ClockForm, ...] = ("h:m:s", "elapsed", "h:mm")
_ORDERS: tuple[DateOrder, ...] = ("ymd", "dmy", "mdy")


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

    def fitting(*forms: TimeColumn) -> dict[TimeColumn, Array]:
        """Those that read most cells, where that is enough, with the stamps."""
        parsers = {form: stamp_parser(form, decimal) for form in forms}
        if not any(parse(cell) is not None for cell in present[:8] for parse in parsers.values()):
            return {}  # the first cells already show that a column holds text
        stamps = {form: _stamps(present, parse) for form, parse in parsers.items()}
        read = {form: int(np.count_nonzero(np.isfinite(stamps[form]))) for form in forms}
        return {form: stamps[form] for form in forms if read[form] == max(least, *read.values())}

    if options.time_format is not None:
        _check_format(options.time_format)
        kind = "calendar" if _has_date(options.time_format) else "clock"
        return next(iter(fitting(TimeColumn(0, kind, odd=options.time_format))), None)
    number = TimeColumn(0, "number")
    numbers = fitting(number).get(number)
    if name.is_date and numbers is not None and not any(cell[0] == "0" for cell in present):  # 030124 has digits
        number = replace(number, unit="day" if find_epoch(np.nanmedian(numbers, keepdims=True), "day") else "")
    if not number.unit and _are_dates_in_digits(present, name):
        return TimeColumn(0, "calendar")
    is_short = name.is_date and all(len(cell) == 6 for cell in present)  # 240331
    if numbers is not None and (number.unit or not is_short):
        return number
    clocks = fitting(*(TimeColumn(0, "clock", clock=form) for form in _CLOCK_FORMS))
    orders: tuple[DateOrder, ...] = _ORDERS
    if options.day_first is not None:
        orders = ("ymd", "dmy") if options.day_first else ("ymd", "mdy")
    # In a column that is named as a date, 17.05.24 is not a clock.
    may_be = [TimeColumn(0, "calendar", order=order) for order in orders if name.is_date or not clocks]
    dates = fitting(*may_be)
    if dates:
        return _calendar(dates, present[0], decided=options.day_first is not None)
    if clocks:
        return _clock(clocks, present[0], name.unit)
    return None if numbers is None else number


def _clock(read: dict[TimeColumn, Array], example: str, unit: str) -> TimeColumn:
    """The form of a clock; `05:10` has hours and minutes unless the unit of the name or the start say otherwise."""
    best, form = next(iter(read)), {column.clock: column for column in read}
    if not {"elapsed", "h:mm"} <= form.keys():
        return best
    stamps = read[form["h:mm"]][np.isfinite(read[form["h:mm"]])]
    # A log that begins at 00:00 and ends after 23:00, or whose stamps are multiples of 5, has hours and minutes.
    is_short = "h:m:s" not in form or (stamps[0] == 0 and stamps.max() < 23 * 3600e6)
    words, option = ["hours and minutes", "minutes and seconds"], "%M:%S"
    if unit in ("s", "min") or (not unit and is_short and bool(np.any(stamps % 300e6))):
        best, words, option = form["elapsed"], words[::-1], "%H:%M"
    elif "h:m:s" not in form:
        best = form["h:mm"]
    said = f'stamps such as {example} are read as {words[0]}; {words[1]}: --time-format "{option}"'
    return replace(best, notes=(Assumption(said),))


def _are_dates_in_digits(counted: list[str], name: TimeName) -> bool:
    """True for 20240229, 2024022912, 202402291200: the name allows it, or the steps are even only as dates.

    Numbers jump where a day or a month ends, 2024022923 to 2024030100. A number of ten digits may also be seconds
    since 1970, of which hardly one in a hundred is a date with an hour.
    """
    size = len(counted[0]) if counted else 0
    cells = [cell for cell in counted if len(cell) == size and cell.isascii() and cell.isdecimal()]
    if size not in (8, 10, 12, 14) or len(cells) < 0.9 * len(counted):
        return False
    stamps = _stamps(cells, parse_calendar)
    if np.count_nonzero(np.isfinite(stamps)) < 0.9 * len(counted):
        return False
    named = name.is_date or (name.strength == 2 and size > 8)
    # Ten digits that begin with 18 are also seconds since 1970, from 2027 on.
    if named and (size != 10 or all(cell.startswith(("19", "20")) for cell in cells)):
        return True
    return judge(stamps).steadiness > judge(np.array(cells, dtype=np.float64)).steadiness


def _calendar(read: dict[TimeColumn, Array], example: str, *, decided: bool) -> TimeColumn:
    """Of orders that fit, the one whose stamps rise steadily; where nothing decides, the day comes first."""
    quality = {form: judge(stamps).steadiness for form, stamps in read.items()}
    best = max(read, key=lambda form: (quality[form], ("mdy", "ymd", "dmy").index(form.order)))
    # Where both orders mean the same day (05/05) there is nothing to decide.
    others = [form for form in read if quality[form] == quality[best]]
    others = [form for form in others if not np.array_equal(read[form], read[best], equal_nan=True)]
    if decided or not others:
        return best
    names = {"dmy": "day first", "mdy": "month first", "ymd": "year first"}
    option = {"dmy": "--day-first", "mdy": "--month-first", "ymd": '--time-format "%y-%m-%d"'}
    note = Assumption(
        f"stamps such as {example} are read {names[best.order]} (assumed: the file does not show it);"
        f" they could also be {names[others[0].order]}: {option[others[0].order]}"
    )
    return replace(best, notes=(note,))


def _stamps(cells: Sequence[str], parse: StampParser) -> Array:
    return np.array([np.nan if (stamp := parse(cell)) is None else stamp for cell in cells])


# Which columns of a log hold its time, and the function that reads the stamp of a row.


DatePart = Literal["date", "year", "month", "day", "day of year"]
ClockPart = Literal["clock", "hour", "minute", "second", "millisecond"]
PartRole = DatePart | ClockPart | Literal["turns", "rest"]
StampParser = Callable[[str], "float | None"]

_MAX_STAMP = 1e20
"""A numeric stamp beyond this is damage: epoch nanoseconds are 1.8e18."""

_PARTS: dict[PartRole, tuple[float, float, float]] = {
    "year": (1800, 2200, 0),
    "month": (1, 12, 0),
    "day": (1, 31, 0),
    "day of year": (1, 366, 0),
    "hour": (0, 24, 3600e6),
    "minute": (0, 59, 60e6),
    "second": (0, 60.999999, 1e6),
    "millisecond": (0, 999.999, 1e3),
}
"""The least and the largest number of each part, and its microseconds; a year may have two digits."""


@dataclass(frozen=True)
class TimeColumn:
    """Which columns hold the time and how their cells are read."""

    index: int
    """Column of the stamp, or of the first of its parts, from 0."""
    kind: Literal["number", "calendar", "clock"]
    """Numbers, calendar stamps, or clock times without a date; the last two are read as microseconds."""
    unit: str = ""
    """Unit of a numeric stamp, a key of SECONDS_PER_UNIT; "" is decided by magnitude."""
    order: DateOrder = "ymd"
    """Order of the parts of a calendar stamp."""
    clock: ClockForm = "h:m:s"
    """How the clock is written, where one is alone or in a column of its own."""
    odd: str = ""
    """The format of `datetime.strptime` that the user gives; "" where our own forms fit."""
    parts: tuple[tuple[PartRole, int], ...] = ()
    """(role, column) of each part where the time is in several columns; () where it is in one."""
    day: float | None = None
    """The first readable date in µs since 1970, where date and clock are in two columns; for rows without one."""
    turn: float = 0.0
    """Length of what the first of two parts counts: 1000 where ms follow whole seconds, 604 800 s of a GPS week."""
    printed: bool = False
    """True where it is among labels or before them, as boards print: a whole number is `millis()` rather than s."""
    notes: tuple[str, ...] = ()
    """What was assumed, each a sentence."""

    @property
    def indices(self) -> tuple[int, ...]:
        """All columns that the time is made of."""
        return tuple(i for _, i in self.parts) or (self.index,)

    @property
    def turn_s(self) -> float:
        """Seconds after which a clock wraps to 0; 0 where it never does."""
        return 0.0 if self.kind != "clock" or self.clock in ("elapsed", "h:mm") else 86400.0


def row_stamp_parser(column: TimeColumn, decimal: str) -> Callable[[Sequence[str]], float | None]:
    """The function that reads the stamp of a row from all its cells, whatever columns it is made of.

    It returns microseconds for calendar stamps (since 1970, UTC where no zone is given) and clocks, the number
    itself for numbers, and None for a missing or damaged stamp.
    """
    parse, index = stamp_parser(column, decimal), column.index
    if not column.parts:
        return lambda cells: parse(cells[index])
    places = dict(column.parts)
    if column.turn:
        count, turn = places["turns"], column.turn
        return lambda cells: _plus(parse(cells[index]), parse(cells[count]), turn)
    date_at, clock_at = places.pop("date", None), places.pop("clock", None)
    parse_date, parse_clock = stamp_parser(replace(column, kind="calendar"), decimal), CLOCK_PARSERS[column.clock]
    last = [column.day]

    def parse_parts(cells: Sequence[str]) -> float | None:
        since = _of_parts(cells, places, decimal) if places else 0.0
        if date_at is not None:
            found = parse_date(cells[date_at])
            last[0] = last[0] if found is None else found  # a broken date is that of the row before
            since = _plus(since, last[0])
        return since if clock_at is None else _plus(since, parse_clock(cells[clock_at]))

    return parse_parts


def _plus(since: float | None, more: float | None, unit: float = 1.0) -> float | None:
    """The sum; None where a value is missing."""
    return None if since is None or more is None else since + more * unit


def parse_part(cell: str, role: PartRole, decimal: str = ".") -> float | None:
    """The number of a part; None where it is damaged."""
    low, high, _ = _PARTS[role]
    value = float(cell) if cell.isascii() and cell.isdecimal() else parse_number(cell, decimal)
    if value is None or (value % 1 and role not in ("second", "millisecond")):
        return None
    least = 0.0 if role == "year" and value < 100 else low
    return value if least <= value <= high else None


def _of_parts(cells: Sequence[str], places: dict[PartRole, int], decimal: str) -> float | None:
    """Microseconds from 1970 to a year and other parts, from midnight without a year; None: a part is damaged."""
    part, since = dict[PartRole, float](), 0.0
    for role, i in places.items():
        value = parse_part(cells[i], role, decimal)
        if value is None:
            return None
        part[role] = value
        since += round(value * _PARTS[role][2])
    if "month" not in part:
        since += (part.get("day of year", 1) - 1) * DAY_US
    if "year" not in part:
        return since
    return _plus(since, day_us(int(part["year"]), int(part.get("month", 1)), int(part.get("day", 1))))


def stamp_parser(column: TimeColumn, decimal: str) -> StampParser:
    """The function that reads one cell of a time column; it returns None for a missing or damaged stamp."""
    if column.odd:
        return partial(_parse_with_format, form=column.odd)
    if column.kind == "calendar":
        return partial(parse_calendar, order=column.order)
    if column.kind == "clock":
        return CLOCK_PARSERS[column.clock]

    def parse(cell: str) -> float | None:
        value = parse_number(cell, decimal)
        if value is None and (measure := split_measure(cell)) and measure[1].lower() in UNIT_OF_WORD:
            value = parse_number(measure[0], decimal)  # 10 ms
        # NaN fails the comparison as well.
        return value if value is not None and abs(value) <= _MAX_STAMP else None

    return parse
