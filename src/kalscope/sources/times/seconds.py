"""Seconds from the stamps of a column, their unit by magnitude, and the nominal period."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np

from kalscope.common.array import Array
from kalscope.sources.grammar.time_units import SECONDS_PER_UNIT
from kalscope.sources.grammar.timestamps import TimeColumn

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_DAY_NUMBERS = (
    (40_000.0, 55_000.0, 25_569.0),  # spreadsheets: 2009 to 2050
    (725_000.0, 770_000.0, 719_529.0),  # MATLAB's datenum: 1984 to 2108
    (2_440_000.0, 2_490_000.0, 2_440_587.5),  # Julian dates: 1968 to 2105
)
"""Lowest and highest number of a day that is counted from a date long ago, and the number of 1970-01-01."""
_WHOLE_SECOND = 0.02
"""Days with seven or more decimals are this close, in s, to the whole seconds they mean."""


def unit_by_magnitude(stamps: Array) -> str:
    """Unit of numeric stamps that name none: epoch stamps by their size, others by their step.

    The most plausible rate decides, one between a sample every other second and 500 samples a second: integer
    steps below 2 are seconds, from 2 on milliseconds, from 2000 on microseconds, from two million on nanoseconds.
    Steps of whole minutes that divide an hour, and of hours, are seconds, as of a logger (60, 300, 3600; not 5,
    which is 5 ms of a board); steps of whole minutes in milliseconds are milliseconds. Fractions are seconds, or
    days where they are numbers of days that lie whole seconds apart (45123.506944444).
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
    if not whole and _day_of_1970(stamps) is not None and _are_seconds_in_days(stamps):
        return "day"
    minutes = step > 0 and step % 60 == 0
    if not whole or step < 2 or (minutes and (3600 % step == 0 or step % 3600 == 0)):
        return "s"
    if step < 2000 or step % 60_000 == 0:
        return "ms"
    return "us" if step < 2e6 else "ns"


def _day_of_1970(stamps: Array) -> float | None:
    """The number of 1970-01-01, where all stamps are numbers of days in one of the usual counts."""
    low, high = float(stamps.min()), float(stamps.max())
    return next((day for first, last, day in _DAY_NUMBERS if first <= low and high <= last), None)


def _are_seconds_in_days(stamps: Array) -> bool:
    """True where stamps of many decimals are whole seconds, up to an hour, apart as days: 1/144 is 10 min."""
    many = np.abs(stamps * 1e5 - np.round(stamps * 1e5)) > 0.01
    seconds: Array = (stamps - stamps[0]) * 86400.0
    near = np.abs(seconds - np.round(seconds)) <= _WHOLE_SECOND
    return float(many.mean()) >= 0.5 and float(near.mean()) >= 0.99 and 0.5 < _median_step(seconds) < 3601


def is_epoch(stamps: Array, unit: str) -> bool:
    """True where numeric stamps count from 1970: the first one lies between 2001 and 2100."""
    scale = SECONDS_PER_UNIT[unit]
    return scale <= 1.0 and 1e9 <= float(stamps[0]) * scale < 4.2e9


def to_seconds(stamps: Array, column: TimeColumn, start: float | None = None) -> tuple[Array, str]:
    """Seconds of the stamps, shape (n,), n >= 1, and a sentence that says how they were read.

    Calendar and epoch stamps count from the first sample; others, years among them, as the source counts them:
    their second 0 is `start`, in s since 1970, where that is known.
    """
    if column.kind == "calendar":
        first = date_text(float(stamps[0]) * 1e-6)
        return (stamps - stamps[0]) / 1e6, f"time counts from the first stamp, {first}"
    if column.kind == "clock":
        # A clock that jumps back by more than half a turn has wrapped.
        turn = column.turn_s
        turns = np.cumsum(np.diff(stamps, prepend=stamps[0]) < -0.5e6 * turn) if turn else np.zeros(len(stamps))
        seconds = (stamps - stamps[0]) / 1e6 + turn * turns
        clock = timedelta(microseconds=float(stamps[0]))
        what = "midnight" if turn == 86400.0 else "the hour"
        passed = f"; the clock passes {what} {times(int(turns[-1]))}" if turns[-1] else ""
        return seconds, f"time counts from the first stamp, {clock} on the clock{passed}"
    unit = column.unit or unit_by_magnitude(stamps)
    said = f"read as {unit}" if column.unit else f"read as {unit} (assumed from their size: --time-unit changes it)"
    scale = SECONDS_PER_UNIT[unit]
    if unit == "year":
        return stamps * scale, f"stamps are {said}"
    day_of_1970 = _day_of_1970(stamps) if unit == "day" else None
    if day_of_1970 is not None:
        first = date_text((float(stamps[0]) - day_of_1970) * scale)
        # The last of their digits is 10 µs and more.
        since = ((stamps - stamps[0]) * scale).round(3)
        return since, f"stamps are {said}; time counts from {first}"
    if is_epoch(stamps, unit):
        first = date_text(float(stamps[0]) * scale)
        return _scaled(stamps - stamps[0], scale), f"stamps are {said} since 1970; time counts from {first}"
    counted = "" if start is None else f"; time counts from {date_text(start)}"
    return _scaled(stamps, scale), f"stamps are {said}{counted}"


def _scaled(stamps: Array, scale: float) -> Array:
    # Dividing by 1000 rounds 3 ms to the double nearest 0.003; multiplying by 0.001 may not.
    return stamps / round(1 / scale) if scale < 1 else stamps if scale == 1 else stamps * scale


def times(count: int) -> str:
    """`once`, `2 times`."""
    return "once" if count == 1 else f"{count} times"


def date_text(seconds: float) -> str:
    """The date and clock, UTC, of seconds since 1970."""
    try:
        return (_EPOCH + timedelta(seconds=seconds)).isoformat()
    except OverflowError:  # a zone can push a stamp of year 1 or 9999 beyond the calendar
        return f"{seconds:g} s from 1970"


def _median_step(stamps: Array) -> float:
    steps = np.diff(stamps)
    positive = steps[steps > 0]
    return float(np.median(positive)) if positive.size else 0.0
