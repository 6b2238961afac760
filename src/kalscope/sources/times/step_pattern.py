"""What the steps between stamps look like: a step per sample, a coarse clock, bursts, or samples that are lost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array, Indices, Mask

GAP_PERIODS = 1.5 * (1 + 1e-6)
"""A step longer than this many sample periods may be a gap: at least one sample is missing. 3 ms is 1.5 × 2 ms."""

_SOME_STEPS = 200_000
"""Spread and resolution are judged on at most this many steps, evenly chosen."""
_EVEN = 0.01
"""Steps this close to each other, as a share of the median step, are even."""
_MIN_RECURRENCES = 5
"""Fewest long steps that show whether they come regularly."""
_REGULAR = 0.35
"""Eight of ten distances between long steps are this close, as a share of their median, where they are regular."""
_MAX_BURST_ROWS = 64
"""More rows than this, evenly stamped between two long steps, are not a burst but a logger that pauses."""
_MAX_BURST_STEP = 0.1
"""Rows that come slower than this, s, do not come in a burst."""
_GRID_TICKS = 10
"""A step of at least this many clock ticks shows whether longer ones are its multiples."""
_MIN_REPEATS = 0.15
"""Least share of stamps that repeat the one before where the clock is coarse even if they come irregularly."""
_FEW_REPEATS = 0.03
"""Fewer than this are samples that were written twice."""


@dataclass(frozen=True)
class Steps:
    """The steps between stamps, in s, and their most used statistics."""

    all: Array
    """Each step, shape (n - 1,)."""
    forward: Array
    """Each step from the latest stamp so far: going forward again after a step back is not a gap."""
    median: float
    """Median positive step, to 9 digits."""
    low: float
    """The 5th percentile."""
    high: float
    """The 95th percentile."""

    @property
    def even(self) -> bool:
        """True where nine of ten steps are alike."""
        return self.high - self.low <= _EVEN * self.median


def steps_of(time: Array) -> Steps | None:
    """The steps of `time`, shape (n,); None where none is positive."""
    steps = np.diff(time)
    median = median_step(steps.copy())
    if median is None:
        return None
    forward = steps
    if float(steps.min()) < 0:
        forward = time[1:] - np.maximum.accumulate(time)[:-1]
    some = np.sort(_some(steps))
    low, high = (float(some[round(share * (some.size - 1))]) for share in (0.05, 0.95))
    return Steps(steps, forward, median, low, high)


def median_step(steps: Array) -> float | None:
    """Median positive step in s; None where none is positive. Reorders `steps`."""
    positive = steps if steps.size and float(steps.min()) > 0 else steps[steps > 0]
    if positive.size == 0:
        return None
    # The stamps were decimal text: 0.02 - 0.01 is 0.01 within 1e-9, not 0.010000000000000002.
    return float(f"{np.median(positive, overwrite_input=True):.9g}")


def is_coarse(steps: Steps) -> bool:
    """True where stamps repeat because the clock is coarser than the sample period: all its steps are alike."""
    positive = steps.all[steps.all > 0]
    repeats = np.flatnonzero(steps.all == 0)
    share = repeats.size / steps.all.size
    regular = share >= _FEW_REPEATS and repeats.size >= _MIN_RECURRENCES and _regular(np.diff(repeats))
    if share < _MIN_REPEATS and not regular:
        return False
    tick = steps.median
    alike = np.count_nonzero(np.abs(positive - tick) <= 0.25 * tick)
    longer = np.count_nonzero(positive > 1.25 * tick)
    # Where each step of the clock holds many samples, a short record has few steps, and pauses are many among them.
    pauses = 0.05 * positive.size + (6 if share >= 0.8 else 2)
    return bool(alike >= (0.6 if share >= 0.8 else 0.8) * positive.size and longer <= pauses)


def one_sample_a_step(steps: Steps, share: float = 0.8) -> bool:
    """True where a share of the steps is near the median one, or all are its multiples: samples were lost."""
    median, usual = steps.median, steps.all
    near = np.count_nonzero((usual >= 0.5 * median) & (usual <= GAP_PERIODS * median))
    if near >= share * usual.size:
        return True
    few_back = bool(np.count_nonzero(usual <= 0) <= 0.05 * usual.size)
    return few_back and _on_grid(usual[usual > 0], median)


def returns_to_grid(steps: Steps) -> bool:
    """True where most steps are alike and the others add up to them: single samples in between, or lost."""
    median = steps.median
    off = np.abs(steps.all - median) > _EVEN * median
    if np.count_nonzero(off) > 0.25 * off.size or median < 1.5 * _resolution(steps):
        return False
    edges = np.flatnonzero(np.diff(np.concatenate(([False], off, [False])).astype(np.int8)))
    starts, ends = edges[::2], edges[1::2]
    if not starts.size:
        return True
    total = np.concatenate(([0.0], np.cumsum(steps.all)))
    sums = (total[ends] - total[starts]) / median
    back = np.abs(sums - np.maximum(np.rint(sums), 1.0)) <= 2 * _EVEN
    return bool(np.count_nonzero(back) >= 0.9 * back.size)


def long_steps_recur(steps: Steps) -> bool:
    """True where long steps come so regularly that they show how rows are delivered, not that some are missing."""
    median = steps.median
    long = steps.forward > GAP_PERIODS * median
    where = np.flatnonzero(long)
    if where.size < _MIN_RECURRENCES:
        return False
    lengths, rows = steps.forward[where], np.diff(where)
    usual, fine = float(np.median(lengths)), median >= _GRID_TICKS * _resolution(steps)
    ordinary = np.where(steps.all > 2.5 * usual, median, np.maximum(steps.all, 0.0))
    if _made_up_for(ordinary, 4 * float(np.median(rows))):
        return not _sleeps(steps, long, rows, usual)
    if fine and _on_grid(lengths, median):
        return False  # lost samples of an even series
    # Of samples lost at random some are neighbours; of a coarse clock's steps hardly any is two samples too long.
    neighbours = where.size**2 / steps.all.size
    if not fine and neighbours >= 10 and np.count_nonzero(lengths > 2.5 * median) < 0.3 * neighbours:
        return True
    share = float(lengths.sum()) / float(steps.forward[steps.forward > 0].sum())
    recurs = _regular(rows) or (share > 0.5 and usual > 3 * median)
    return recurs and not _sleeps(steps, long, rows, usual)


def _sleeps(steps: Steps, long: Mask, rows: Indices, usual: float) -> bool:
    """True for a logger that records for a while, evenly, and then sleeps."""
    inner = np.sort(_some(steps.all[~long]))
    width = inner[round(0.95 * (inner.size - 1))] - inner[round(0.05 * (inner.size - 1))]
    slow = steps.median >= _MAX_BURST_STEP and usual >= 3 * steps.median
    return bool(width <= _EVEN * steps.median and (np.median(rows) > _MAX_BURST_ROWS or slow))


def _made_up_for(steps: Array, rows: float) -> bool:
    """True where a long step comes after short ones, as on a coarse clock: lost samples come at random."""
    size = int(max(8, min(rows, steps.size // 16)))
    sums = steps[: steps.size // size * size].reshape(-1, size).sum(axis=1)
    most = 0.3 if sums.size < 64 else 0.5
    return sums.size >= 16 and float(np.var(sums)) < most * size * float(np.var(steps))


def _regular(rows: Indices) -> bool:
    low, middle, high = np.quantile(rows, (0.1, 0.5, 0.9))
    return bool(high - low <= max(1.0, _REGULAR * middle))


def _on_grid(steps: Array, median: float) -> bool:
    """True where nearly all steps are multiples of the median one."""
    some = _some(steps) / median
    return bool(np.count_nonzero(np.abs(some - np.rint(some)) <= 0.15) >= 0.95 * some.size)


def _resolution(steps: Steps) -> float:
    """Least difference between two steps that differ: the step of the clock, or less."""
    unit = 1e-6 * steps.median
    between = np.diff(np.sort(np.append(np.rint(_some(steps.all) / unit), 0.0)))
    return float(np.min(between[between > 0], initial=np.inf)) * unit


def _some(steps: Array) -> Array:
    return steps[:: max(1, steps.size // _SOME_STEPS)]
