"""From stamps to the time of the samples: wraps are undone, steps are judged, every decision is noted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kalscope.common.array import Array, Indices
from kalscope.common.checks import PERIODS
from kalscope.recording import Gaps, RateSource, Timing
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.times.even_time import place_evenly
from kalscope.sources.times.gaps import missing_rows
from kalscope.sources.times.sample_rate import SampleRate, find_rate
from kalscope.sources.times.seconds import date_text, times, to_seconds
from kalscope.sources.times.step_pattern import GAP_PERIODS
from kalscope.sources.times.summer_time import about_summer_time
from kalscope.sources.times.timing_text import with_words

_COUNTERS = {2.0**16: "16-bit counter", 2.0**32: "32-bit counter (millis() or micros())"}
_ALIKE = 0.02
"""A period that the file states is accepted where that of the stamps is this near, as a share of it."""


@dataclass(frozen=True)
class GivenPeriod:
    """Sample periods that are known besides the stamps, in s."""

    option: float | None = None
    """What the user chose; it outranks all others."""
    file: float | None = None
    """What the text of the file states."""


@dataclass(frozen=True)
class TimeAxis:
    """The time of all samples."""

    time: Array
    """Seconds, shape (n,)."""
    timing: Timing
    """The sample period, and how it was found."""
    pauses: Indices
    """Samples, from 0, after each of which samples are missing."""
    backward: int
    """Steps back in time."""
    notes: tuple[str, ...]
    """How the stamps were read and how even they are, each a sentence."""


def read_time(
    stamps: Array,
    column: TimeColumn,
    unit: str | None = None,
    given: GivenPeriod | None = None,
    gaps: Gaps = "rows",
    start: float | None = None,
) -> TimeAxis:
    """Time of the stamps, shape (n,), n >= 1, all finite, in the unit of their column.

    Args:
        stamps: As the cells were parsed: µs since 1970 for calendar stamps, µs for clocks, else numbers.
        column: What they are.
        unit: Unit of numeric stamps that outranks the column's; None = the column's own.
        given: Sample periods that are known besides.
        gaps: How gaps in time are to be read: no advice is given where that was chosen.
        start: What second 0 of numeric stamps is, in s since 1970; None where that is not known.
    """
    given = given or GivenPeriod()
    notes: list[str] = []
    if column.kind == "number":
        column = replace(column, unit=unit or column.unit)
        stamps, said = unwrap(stamps)
        notes += said
    time, how = to_seconds(stamps, column, start)
    rate = find_rate(time)
    crowded = rate is not None and rate.stamps in ("coarse", "bursts")
    steps = np.diff(time) if rate is None else rate.steps.all
    backward = int(np.count_nonzero(steps < 0)) if steps.size and float(steps.min()) < 0 else 0
    notes += [how, *_about_order(time, steps, backward, repeated=not crowded)]
    if rate is None:
        return _without_rate(time, given, backward, notes)
    if not PERIODS[0] <= rate.period <= PERIODS[1]:
        axis = counted_time(len(time), given)
        said = f"the stamps are {rate.period:.3g} s apart, which is not a time: the samples were counted"
        return replace(axis, notes=(*notes, said, *axis.notes))
    if column.kind == "calendar":
        notes += about_summer_time(stamps, rate.period)
    pauses = rate.pauses
    if crowded:
        time = place_evenly(time, rate)
    elif given.option is not None:
        pauses = np.flatnonzero(rate.steps.forward > GAP_PERIODS * given.option)
    timing = _timing(time, rate, pauses, given)
    usual = None if rate.steps.even else (rate.steps.low, rate.steps.high)
    timing = with_words(timing, usual, given.file, gaps, len(time))
    return TimeAxis(time, timing, pauses, backward, (*notes, *timing.notes))


def counted_time(n: int, given: GivenPeriod, offset: float = 0.0, start: float | None = None) -> TimeAxis:
    """Time of `n` samples without stamps: by the period that is given, else their numbers.

    Args:
        n: How many.
        given: Sample periods that are known.
        offset: Time of the first sample in s, where a period is given.
        start: When the first sample was taken, in s since 1970; None where that is not known.
    """
    period = given.option or given.file
    time = np.arange(n, dtype=np.float64)
    if period is not None:
        time = offset + time * period
    source: RateSource = "option" if given.option else "file" if given.file else "none"
    timing = with_words(Timing("none", source, period), None, given.file, "rows", n)
    notes: list[str] = []
    if period is not None and start is not None:
        notes = [f"time counts from {date_text(start)}"]
    return TimeAxis(time, timing, np.zeros(0, dtype=np.int64), 0, (*notes, *timing.notes))


def _without_rate(time: Array, given: GivenPeriod, backward: int, notes: list[str]) -> TimeAxis:
    """Time whose stamps never rise: all are one step of a coarse clock, unless it steps back."""
    axis = counted_time(len(time), given, float(time[0]))
    if given.file and len(time) > 1 and not backward:
        time = axis.time
    return replace(axis, time=time, backward=backward, notes=(*notes, *axis.notes))


def _timing(time: Array, rate: SampleRate, pauses: Indices, given: GivenPeriod) -> Timing:
    period, source = _chosen(rate, given)
    steps = time[pauses + 1] - time[pauses]
    return Timing(
        stamps=rate.stamps,
        source=source,
        period=period,
        error=rate.error / rate.period if np.isfinite(rate.error) else None,
        stamps_period=rate.period,
        pauses=int(pauses.size),
        missing=int(missing_rows(time, pauses, period).sum()),
        first_pause=int(pauses[0]) + 1 if pauses.size else 0,
        longest_pause=float(steps.max(initial=0.0)),
        resolution=rate.longest if rate.stamps == "coarse" else None,
    )


def _chosen(rate: SampleRate, given: GivenPeriod) -> tuple[float, RateSource]:
    """The period that is used, and its source."""
    if given.option is not None:
        return given.option, "option"
    if given.file is not None and _supports(rate, given.file):
        return given.file, "file"
    return rate.period, "stamps"


def _supports(rate: SampleRate, stated: float) -> bool:
    """True where the stamps leave the period open, and the one that the file states, in s, may be it.

    Where there is no rate at which they come steadily, the period lies between the median and the mean step: late
    rows and lost samples lengthen the mean, bursts shorten the median.
    """
    if np.isfinite(rate.error):
        off = abs(stated - rate.period)
        return rate.stamps in ("coarse", "bursts") and off <= max(_ALIKE * stated, 3 * rate.error)
    steps = rate.steps.all
    mean = float(steps[steps >= 0].mean())
    margin = max(_ALIKE * stated, rate.longest / len(steps))
    return min(rate.period, mean) - margin <= stated <= max(rate.period, mean) + margin


def unwrap(stamps: Array) -> tuple[Array, list[str]]:
    """Unwrap whole stamps that jump back by a counter's full range; return them and remarks about it.

    Only where the step over the wrap is an ordinary one: a device that restarts jumps back to 0 from
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


def _about_order(time: Array, steps: Array, backward: int, *, repeated: bool) -> list[str]:
    """Steps back, and, where `repeated`, stamps that come twice: at once, or again after a step back."""
    notes: list[str] = []
    if backward:
        first = int(np.argmax(steps < 0))
        notes.append(
            f"time steps back {times(backward)}, first by {-float(steps[first]):.9g} s at sample {first + 2}:"
            " the order of the file was kept"
        )
    if repeated and steps.size and not float(steps.min()) > 0:
        twice = len(time) - int(np.unique(time).size)
        if twice:
            same = np.flatnonzero(steps == 0)
            where = f", first at sample {int(same[0]) + 2}" if same.size else ""
            notes.append(f"{twice} {'samples repeat' if twice > 1 else 'sample repeats'} an earlier stamp{where}")
    return notes
