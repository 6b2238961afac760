"""The sample period by the stamps, and the pauses: robust against jitter, bursts, coarse clocks and lost samples.

A line through the stamps against the sample number is not bent by stamps that are late for a while: rows that
come in bursts, and clocks that show whole seconds, have its slope. Pauses bend it, so a recording is split there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array, Indices
from kalscope.recording import Stamps
from kalscope.sources.times.step_pattern import (
    GAP_PERIODS,
    Steps,
    is_coarse,
    long_steps_recur,
    one_sample_a_step,
    returns_to_grid,
    steps_of,
)
from kalscope.sources.times.stretches import Stretches, lasting_steps, pooled_slope, slope_error, split

_SANE = (1e-100, 1e100)
"""Steps and stamps in s whose squares are still numbers."""
_NO_PAUSES = np.zeros(0, dtype=np.int64)
_MIN_BLOCKS = 8
_MIN_CHANGES = 3
"""Fewest changes of a coarse clock that show its rate."""
_STEADY = 0.1
"""Width of the middle half of the spacings of blocks, as a share of their median, where rows come steadily."""
_BURST_SHARE = 2 / 3
"""Where more of the time passes in steps longer than 1.5 periods, the rows come in bursts."""


@dataclass(frozen=True)
class SampleRate:
    """What the stamps say about the sampling."""

    stamps: Stamps
    """Their pattern."""
    period: float
    """Sample period in s."""
    error: float
    """Standard error of the period in s; 0 for even stamps, inf where it is not known."""
    pauses: Indices
    """Samples, from 0, after each of which samples are missing."""
    stretches: Stretches
    """The samples between pauses and steps back."""
    steps: Steps
    """The steps between the stamps."""
    longest: float
    """The longest usual step in s: that of a coarse clock, the time between two deliveries, or the period."""


@dataclass(frozen=True)
class _Guess:
    """A first guess that shows which steps are pauses."""

    stamps: Stamps
    period: float
    usual: float
    """The longest usual step in s."""
    shortest_pause: float
    """Longer steps may be pauses, s."""


def find_rate(time: Array) -> SampleRate | None:
    """Sample period and pauses of the stamps `time` in s, shape (n,); None where no step is positive."""
    steps = steps_of(time)
    if steps is None:
        return None
    median = steps.median
    if not (_SANE[0] < median and float(np.max(np.abs(time))) < _SANE[1]):
        return _unsteady(time, steps)
    recur = long_steps_recur(steps)
    if not recur and (_is_even(steps) or returns_to_grid(steps)):
        return _with_median(time, steps, "even" if steps.even else "uneven")
    guess = _guess(time, steps, recur=recur)
    if guess is None:
        return _unsteady(time, steps)
    return _fitted(time, steps, guess)


def _unsteady(time: Array, steps: Steps) -> SampleRate:
    """There is no scale at which the rows come steadily: the usual step is all that is known."""
    whole = split(len(time), _NO_PAUSES)
    return SampleRate("uneven", steps.median, math.inf, _NO_PAUSES, whole, steps, steps.median)


def _is_even(steps: Steps) -> bool:
    """Even, and the few steps that differ do not show that the true period is another one."""
    if not steps.even:
        return False
    usual = steps.all[(steps.all >= 0) & (steps.all <= GAP_PERIODS * steps.median)]
    return abs(float(usual.mean()) - steps.median) <= 0.005 * steps.median


def _with_median(time: Array, steps: Steps, stamps: Stamps) -> SampleRate:
    median = steps.median
    pauses = np.flatnonzero(steps.forward > GAP_PERIODS * median)
    pauses = lasting_steps(time, steps.all, pauses, median, 4)
    return SampleRate(stamps, median, 0.0, pauses, _stretches(steps, pauses, median), steps, median)


def _guess(time: Array, steps: Steps, *, recur: bool) -> _Guess | None:
    median = steps.median
    if is_coarse(steps):
        changes = np.flatnonzero(steps.all > 0)
        period = median * (changes.size - 1) / max(1, int(changes[-1] - changes[0])) if changes.size > 1 else median
        return _Guess("coarse", period, median, max(GAP_PERIODS * median, median + 2 * period))
    near = steps.all[np.abs(steps.all - median) <= 0.5 * median]
    jitter = float(np.std(near)) if near.size else 0.0
    single = _Guess("uneven", median, median, max(GAP_PERIODS * median, median + 5 * jitter))
    if not recur and one_sample_a_step(steps):
        return single
    scale = _steady_scale(time)
    if scale is None:
        return single if one_sample_a_step(steps, 0.5) else None
    period, rows = scale
    whole = steps.all[: steps.all.size // rows * rows].reshape(-1, rows)
    usual = max(float(np.median(whole.max(axis=1))), period)
    return _Guess("bursts", period, usual, 2.5 * usual)


def _steady_scale(time: Array) -> tuple[float, int] | None:
    """(period, rows): the fewest rows, a power of 2, whose mean stamps come steadily, and their spacing per row.

    Where none do, those that come most steadily, if they do so at all.
    """
    means, rows = time, 1
    best, least = None, 0.35
    while len(means) > 2 * _MIN_BLOCKS:
        half = len(means) // 2
        means, rows = (means[0 : 2 * half : 2] + means[1 : 2 * half : 2]) / 2, 2 * rows
        spacing = np.diff(means) / rows
        low, middle, high = np.quantile(spacing, (0.25, 0.5, 0.75))
        if middle <= 0 or high - low >= least * middle:
            continue
        long = spacing > GAP_PERIODS * middle
        pauses = np.count_nonzero(np.diff(long.astype(np.int8)) == 1) + int(long[0])
        few = pauses < 5 or float(spacing[long].sum()) <= 0.5 * float(spacing[spacing > 0].sum())
        near = np.count_nonzero(np.abs(spacing - middle) <= 0.5 * middle)
        if few and near >= 0.75 * spacing.size:
            best, least = (float(middle), rows), float((high - low) / middle)
            if least <= _STEADY:
                break
    return best


def _fitted(time: Array, steps: Steps, guess: _Guess) -> SampleRate:
    """Refine the guess: find its pauses, then fit a line to the stamps of each stretch."""
    rows = max(4, math.ceil(2 * guess.usual / guess.period))
    candidates = np.flatnonzero(steps.forward > guess.shortest_pause)
    pauses = lasting_steps(time, steps.all, candidates, guess.period, rows)
    stretches = _stretches(steps, pauses, guess.usual)
    usual_rows = guess.usual / guess.period
    fitted = _slope_of_changes(time, steps, stretches) if guess.stamps == "coarse" else None
    error = slope_error(time, stretches)
    if fitted is not None:
        slope, error = fitted[0], min(fitted[1], error)
    else:
        slope = pooled_slope(time, np.arange(len(time)), stretches, usual_rows)
    if slope is None or slope <= 0:
        slope = guess.period
    if guess.stamps == "uneven" and abs(slope - steps.median) <= 3 * error:
        slope = steps.median  # the usual step agrees
    stamps = guess.stamps
    if stamps == "bursts" and not _in_bursts(steps, pauses, slope):
        stamps = "uneven"
    return SampleRate(stamps, float(f"{slope:.9g}"), error, pauses, stretches, steps, guess.usual)


def _stretches(steps: Steps, pauses: Indices, usual: float) -> Stretches:
    back = np.flatnonzero(steps.all < -2 * usual) if steps.forward is not steps.all else _NO_PAUSES
    return split(steps.all.size + 1, np.union1d(pauses, back))


def _slope_of_changes(time: Array, steps: Steps, stretches: Stretches) -> tuple[float, float] | None:
    """Seconds per sample and their standard error by the first rows of each new stamp; None where there are few.

    The row at which a coarse clock moves on is exact to a sample.
    """
    first = np.concatenate(([False], steps.all > 0))
    first[stretches.starts] = False  # after a pause a stamp may have begun before
    at = np.flatnonzero(first)
    if at.size < _MIN_CHANGES:
        return None
    run = stretches.spread(np.arange(len(stretches.sizes)))[at]
    slope = pooled_slope(time[at], at, split(at.size, np.flatnonzero(np.diff(run))), 0.0)
    same = np.diff(run) == 0
    if slope is None or not same.any():
        return None
    rows = np.diff(at)[same]
    late = np.diff(time[at])[same] - slope * rows
    return slope, math.sqrt(1.2 * (float(np.mean(late**2)) * late.size + slope**2)) / float(rows.sum())


def _in_bursts(steps: Steps, pauses: Indices, period: float) -> bool:
    usual = np.ones(steps.all.size, dtype=bool)
    usual[pauses] = False
    passing = steps.all[usual & (steps.all > 0)]
    return float(passing[passing > GAP_PERIODS * period].sum()) > _BURST_SHARE * float(passing.sum())
