"""What each channel of a recording is: a measurement, or a counter, a clock, a flag, a code, a position.

The values decide; names only tell apart what looks alike, such as a clock of odd steps and a rising measurement.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kalscope.common.numbers import Array
from kalscope.recording import Recording

MEASUREMENT = ""
"""The kind of a channel that measures something."""

POSITION, RISING, SPARSE, CODE = "a position", "rises at every sample", "mostly missing", "a code"
FLAG, TIME_STEP, DATE_PART = "only two values", "the time between samples", "part of a date or time"
COUNTER, CLOCK, CONSTANT, EMPTY = "a counter", "a clock", "constant", "empty"
KINDS = (MEASUREMENT, POSITION, RISING, SPARSE, CODE, FLAG, TIME_STEP, DATE_PART, COUNTER, CLOCK, CONSTANT, EMPTY)
"""From the channel to tune to the one that nothing can be learnt from."""

MIN_SAMPLES = 8
"""Fewer show no pattern: 1, 2, 3 may be a counter or a temperature."""
MIN_SHARE = 0.1
"""A channel with a smaller part of the samples of the fullest one is mostly missing."""
MAX_CODES = 12
"""Distinct whole numbers of a code: a status, a class."""
MIN_RISES = 100
"""This many rising samples without a fall are not a measurement, whatever their name: noise falls now and then."""
_BLOCK = 2000


def _words(name: str) -> frozenset[str]:
    """The words of a name in lower case: "gpsLat_2" gives gps, lat."""
    spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return frozenset(re.findall(r"[a-z]+", spaced.lower()))


_CODE_WORDS = {
    *("id", "status", "state", "flag", "qc", "quality", "code", "error", "err", "mode", "class", "label"),
    *("version", "event", "accuracy", "type", "fix", "sats"),
}
_TIME_WORDS = {
    *("t", "time", "timestamp", "stamp", "date", "datetime", "clock", "rtc", "local", "utc", "gmt", "epoch"),
    *("unix", "elapsed", "uptime", "millis", "micros", "seconds", "sec", "ms", "us", "tick", "ticks"),
}
_COUNT_WORDS = {
    *("n", "no", "nr", "count", "counter", "index", "idx", "seq", "sequence", "record", "row", "sample", "samples"),
    *("entry", "packet", "frame", "scan", "num", "number", "line", "cycle"),
}
_STEP_WORDS = {"dt", "delta", "interval", "step", "period", "loop"}
_PLACE_WORDS = {"lat", "latitude", "lon", "long", "lng", "longitude"}
_NO_NAME = {"value", "column"}
"""What a column without a name is called."""
_DATE_PARTS = {
    **dict.fromkeys(("year", "yyyy"), (1900, 2200)),
    **dict.fromkeys(("doy", "jday", "yday"), (1, 366)),
    **dict.fromkeys(("day", "weekday"), (0, 31)),
    **dict.fromkeys(("minute", "second"), (0, 60)),
    "month": (1, 12),
    "hour": (0, 24),
    "hhmm": (0, 2400),
}
"""Limits of a part of a date or clock, by the words of its name."""
_DATE_WORDS = _DATE_PARTS.keys() | {"yr", "mon", "mm", "dd", "hr", "hh", "min", "ss"}
"""The same words and those that mean something else as well: a minimum, millimetres."""
EPOCH = 9e8
"""Stamps since 1970 are larger, in every unit."""


def default_channel(recording: Recording) -> str:
    """The first channel that measures something; else the one whose kind comes first in KINDS."""
    kinds = channel_kinds(recording)
    return min(recording.names, key=lambda name: KINDS.index(kinds[name]))  # the first of equals


def channel_kinds(recording: Recording) -> dict[str, str]:
    """The kind of each channel, one of KINDS, by its name. A long recording is judged by parts of it."""
    n = len(recording)
    judged = np.arange(n)
    if n > 3 * _BLOCK:  # runs at the beginning, in the middle and at the end
        judged = np.concatenate([start + np.arange(_BLOCK) for start in (0, (n - _BLOCK) // 2, n - _BLOCK)])
    values, steps = recording.values[judged], np.diff(recording.time[judged])
    fullest = int(np.isfinite(values).sum(axis=0).max(initial=0))
    return {
        name: _Channel(column, _words(name), steps, fullest).kind
        for name, column in zip(recording.names, values.T, strict=True)
    }


def with_kinds(recording: Recording, names: list[str]) -> list[str]:
    """These names of channels, each with its kind in brackets unless it measures something."""
    kinds = channel_kinds(recording)
    return [f"{name} ({kinds[name]})" if kinds[name] else name for name in names]


@dataclass(frozen=True)
class _Channel:
    """One channel, as the rules below look at it."""

    column: Array
    """Its samples, NaN where missing, shape (n,)."""
    words: frozenset[str]
    """The words of its name."""
    steps: Array
    """The time between the samples, s, shape (n - 1,)."""
    fullest: int
    """Samples of the channel that has most."""

    @property
    def kind(self) -> str:
        return next((kind for kind, holds in _RULES if holds(self)), MEASUREMENT)

    @cached_property
    def z(self) -> Array:
        """The samples that are there."""
        return self.column[np.isfinite(self.column)]

    @cached_property
    def distinct(self) -> int:
        return len(np.unique(self.z))

    @cached_property
    def whole(self) -> bool:
        return bool(np.all(self.z == np.rint(self.z)))

    @cached_property
    def rise(self) -> _Rise | None:
        """How the samples rise; None where they do anything but rise, start again or step back a little."""
        z, steps = self.z, np.diff(self.z)
        up, falls = steps[steps > 0.0], np.flatnonzero(steps < 0.0)
        if not len(up) or len(falls) > 0.2 * len(steps):
            return None
        # A wrapped value falls to where it began. A fall where runs of a long recording join means nothing.
        low, high = (float(end) for end in np.quantile(z, (0.01, 0.99)))
        grows = float(-np.sum(steps[falls])) <= 0.05 * float(np.sum(up))
        begins_again = np.count_nonzero(z[falls + 1] <= low + 0.1 * (high - low)) + 2 >= 0.9 * len(falls)
        if not begins_again and not grows:
            return None
        usual = float(np.median(up))
        even = np.count_nonzero(up == usual) / len(up)
        return _Rise(len(steps), len(up) + len(falls), len(falls), usual, even, grows)


@dataclass(frozen=True)
class _Rise:
    """Samples that rise, and sometimes start again."""

    steps: int
    """Steps from one sample to the next."""
    moves: int
    """Those that are not 0."""
    falls: int
    """Those that fall."""
    usual: float
    """The median of those that rise."""
    even: float
    """The part of those that rise by exactly that, 0…1."""

    grows: bool
    """Whether what falls is little of what rises, as where packets arrive out of order."""

    @property
    def always(self) -> bool:
        """Whether every sample is above the one before; two joints of runs aside."""
        return self.moves == self.steps and self.falls <= 2

    @property
    def counts(self) -> bool:
        """Whether it rises by one amount, at half of the samples at least."""
        return self.even >= 0.9 and self.moves >= max(0.5 * self.steps, MIN_SAMPLES - 1)


def _is_time_step(it: _Channel) -> bool:
    """Whether a column repeats the time between the stamps, in s, ms or µs."""
    forward = it.steps > 0.0
    with np.errstate(over="ignore"):  # beside such a number no time fits
        ratio = np.abs(it.column[1:][forward]) / it.steps[forward]
    scale = float(np.nanmedian(ratio)) if np.isfinite(ratio).any() else math.nan
    return bool(it.words & _STEP_WORDS) and any(0.5 * unit <= scale <= 2.0 * unit for unit in (1.0, 1e3, 1e6))


def _is_date_part(it: _Channel) -> bool:
    limits = [_DATE_PARTS[word] for word in it.words if word in _DATE_PARTS]
    if it.whole and any(first <= np.min(it.z) and np.max(it.z) <= last for first, last in limits):
        return True
    rise, named = it.rise, it.words <= (_TIME_WORDS | _DATE_WORDS) or it.words <= _NO_NAME
    return bool(rise and it.whole and named and rise.usual == 1.0 and rise.even >= 0.9 and not rise.counts)


def _is_counter(it: _Channel) -> bool:
    rise, named = it.rise, bool(it.words & _COUNT_WORDS)
    if rise is None or not it.whole:
        return False
    return (rise.counts and (rise.usual == 1.0 or named)) or (named and (rise.falls <= 2 or rise.grows))


def _is_clock(it: _Channel) -> bool:
    rise, named = it.rise, bool(it.words & (_TIME_WORDS | _DATE_WORDS))
    if rise is None:
        return False
    if rise.falls <= 2 and (np.min(it.z) > EPOCH or it.words & (_TIME_WORDS - {"t"})):  # t may be a temperature
        return True
    return (it.whole and rise.counts) or (rise.always and (named or (it.whole and rise.steps >= 20)))


_RULES: tuple[tuple[str, Callable[[_Channel], bool]], ...] = (
    (EMPTY, lambda it: not len(it.z)),
    (MEASUREMENT, lambda it: it.fullest < MIN_SAMPLES),
    (CONSTANT, lambda it: it.distinct == 1),
    (SPARSE, lambda it: len(it.z) < max(MIN_SHARE * it.fullest, MIN_SAMPLES)),
    (FLAG, lambda it: it.distinct == 2),
    (TIME_STEP, _is_time_step),
    (DATE_PART, _is_date_part),
    (COUNTER, _is_counter),
    (CLOCK, _is_clock),
    (RISING, lambda it: it.rise is not None and it.rise.always and it.rise.steps >= MIN_RISES),
    (CODE, lambda it: it.whole and it.distinct <= MAX_CODES and bool(it.words & _CODE_WORDS)),
    (POSITION, lambda it: bool(it.words & _PLACE_WORDS) and float(np.max(np.abs(it.z))) <= 360.0),
)
"""The first rule that holds decides; a channel for which none holds measures something."""
