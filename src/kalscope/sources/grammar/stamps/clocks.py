"""Clock times and elapsed times in one cell: pure functions on text.

Each function returns None for any other text. All patterns have bounded repeats only.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import time
from typing import Literal

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
