"""From stamps to the time of the samples: wraps are undone, steps are judged, every decision is noted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kalscope.common.array import Array
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.times.seconds import nominal_period, times, to_seconds

GAP_PERIODS = 1.5
"""A step longer than this many nominal periods is a gap: at least one sample is missing."""

_COUNTERS = {2.0**16: "16-bit counter", 2.0**32: "32-bit counter (millis() or micros())"}
_FEW_STEPS = 200_000
"""Jitter is judged on at most as many steps, evenly chosen."""


@dataclass(frozen=True)
class TimeAxis:
    """The time of all samples."""

    time: Array
    """Seconds, shape (n,)."""
    period: float | None
    """Median step in s; None where no step is positive."""
    backward: int
    """Steps back in time."""
    notes: tuple[str, ...]
    """How the stamps were read and how even they are, each a sentence."""


def read_time(stamps: Array, column: TimeColumn, unit: str | None = None) -> TimeAxis:
    """Time of the stamps, shape (n,), n >= 1, all finite, in the unit of their column.

    Args:
        stamps: As the cells were parsed: µs since 1970 for calendar stamps, µs for clocks, else numbers.
        column: What they are.
        unit: Unit of numeric stamps that outranks the column's; None = the column's own.
    """
    notes: list[str] = []
    if column.kind == "number":
        column = replace(column, unit=unit or column.unit)
        stamps, said = unwrap(stamps)
        notes += said
    time, how = to_seconds(stamps, column)
    steps = np.diff(time)
    backward = int(np.count_nonzero(steps < 0)) if steps.size and float(steps.min()) < 0 else 0
    notes += [how, *_about_order(time, steps, backward)]
    some = np.sort(steps[:: max(1, steps.size // _FEW_STEPS)])
    period = nominal_period(time, steps)
    if period is not None:
        notes += _about_steps(time, steps, some, period)
    return TimeAxis(time, period, backward, tuple(notes))


def unwrap(stamps: Array) -> tuple[Array, list[str]]:
    """Whole stamps that fall back by a counter's full range are unwrapped; and remarks about it.

    Only where the step over the wrap is an ordinary one: a device that restarts falls back to 0 from
    anywhere, and stays a step back.
    """
    back = np.flatnonzero(stamps[1:] < stamps[:-1])
    if back.size == 0 or stamps.min() < 0 or not bool(np.all(stamps == np.floor(stamps))):
        return stamps, []
    steps = np.diff(stamps)
    forward = steps[steps > 0]
    usual = 50 * max(float(np.median(forward)), 1.0) if forward.size else 0.0
    for size, name in _COUNTERS.items():
        if stamps.max() >= size:
            continue
        over = steps[back] + size
        wraps = back[(over > 0) & (over <= min(usual, size / 4))]
        if wraps.size:
            turns = np.zeros(len(stamps))
            turns[wraps + 1] = 1
            said = f"the stamps wrap {times(wraps.size)}, like a {name}, and were unwrapped"
            return stamps + size * np.cumsum(turns), [said]
    return stamps, []


def _about_order(time: Array, steps: Array, backward: int) -> list[str]:
    """Steps back, and stamps that come twice: at once, or again after a step back."""
    notes: list[str] = []
    if backward:
        first = int(np.argmax(steps < 0))
        notes.append(
            f"time steps back {times(backward)}, first by {-float(steps[first]):.9g} s at sample {first + 2}:"
            " the order of the file was kept"
        )
    if steps.size and not float(steps.min()) > 0:
        twice = len(time) - int(np.unique(time).size)
        if twice:
            same = np.flatnonzero(steps == 0)
            where = f", first at sample {int(same[0]) + 2}" if same.size else ""
            notes.append(f"{twice} {'samples repeat' if twice > 1 else 'sample repeats'} an earlier stamp{where}")
    return notes


def _about_steps(time: Array, steps: Array, some: Array, period: float) -> list[str]:
    """Jitter and gaps, in s: `steps` in any order, `some` of them in rising order."""
    notes: list[str] = []
    low, high = (float(some[round(share * (some.size - 1))]) for share in (0.05, 0.95))
    if some.size > 1 and high - low > 0.01 * period:
        notes.append(
            f"the nominal period, {period:.6g} s, is the median step; nine of ten steps lie between"
            f" {low:.6g} and {high:.6g} s"
        )
    longest = float(steps.max())
    if longest > GAP_PERIODS * period and high <= GAP_PERIODS * period:
        count = int(np.count_nonzero(steps > GAP_PERIODS * period))
        first = int(np.argmax(np.diff(time) > GAP_PERIODS * period))
        gaps = "a gap" if count == 1 else f"{count} gaps"
        notes.append(
            f"time has {gaps}, first after sample {first + 1}, the longest {longest:.6g} s; read it with"
            " --gaps missing (missing samples) or --gaps dt (elapsed time)"
        )
    return notes
