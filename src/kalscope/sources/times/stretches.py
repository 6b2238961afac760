"""Stretches of a recording without pauses: where they end, and the straight line through the stamps of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from kalscope.common.array import Array, Indices

_Value = TypeVar("_Value", bound=np.generic)

_WINDOW_CELLS = 1 << 20
_MAX_LATE_ROWS = 1024
"""A delivery that is later than this many samples is a pause."""
_MIN_BLOCKS = 8
_BLOCKS = 32
"""The error of a rate is judged by how much it differs between this many parts of the recording."""


@dataclass(frozen=True)
class Stretches:
    """Runs of samples between pauses and steps back."""

    starts: Indices
    """First sample of each run, from 0, shape (runs,)."""
    sizes: Indices
    """Samples in each run, shape (runs,)."""

    def spread(self, values: NDArray[_Value]) -> NDArray[_Value]:
        """One value per run to one per sample, shape (n,)."""
        return np.repeat(values, self.sizes)


def split(n: int, ends: Indices) -> Stretches:
    """Stretches of `n` samples of which those at `ends`, in rising order, are each the last of one."""
    starts = np.concatenate(([0], ends + 1)).astype(np.int64)
    return Stretches(starts, np.diff(np.append(starts, n)))


def lasting_steps(time: Array, steps: Array, candidates: Indices, period: float, rows: int) -> Indices:
    """Those of the long steps that no later row makes up for, as a late delivery is made up for.

    The rows after a late delivery come faster than the samples were taken. After a pause all rows are later.

    Args:
        time: Stamps in s, shape (n,).
        steps: Length of each step in s, shape (n - 1,).
        candidates: Steps to be judged, from 0 and in rising order, shape (k,).
        period: Sample period in s.
        rows: How many rows hold a usual delivery; after a longer step as many as are due are looked at.
    """
    if not candidates.size:
        return candidates
    time = np.maximum.accumulate(time)  # a row that is out of order makes up for nothing
    # In all, no more rows are looked at than a few times those of the recording.
    most = max(rows, min(_MAX_LATE_ROWS, 16 * len(time) // candidates.size))
    due = np.clip(np.ceil(steps[candidates] / period) + 2, rows, most)
    # Steps of about the same length are judged together.
    groups = np.ceil(np.log2(due)).astype(np.int64)
    lasting = np.zeros(candidates.size, dtype=bool)
    for group in range(int(groups.min()), int(groups.max()) + 1):
        members = np.flatnonzero(groups == group)
        part = max(1, _WINDOW_CELLS >> group)
        for start in range(0, members.size, part):
            some = members[start : start + part]
            at = candidates[some, None]
            before, after = at - np.arange(rows), at + 1 + np.arange(1 << group)
            lasting[some] = _least(time, after, period) - _least(time, before, period) > 0.5 * (
                steps[candidates[some]] - period
            )
    return candidates[lasting]


def _least(time: Array, rows: Indices, period: float) -> Array:
    """How little the stamps are late in each line of `rows`, s, shape (lines,)."""
    rows = np.clip(rows, 0, len(time) - 1)
    return np.min(time[rows] - period * rows, axis=1)


def pooled_slope(time: Array, index: Indices, stretches: Stretches, usual_rows: float) -> float | None:
    """Seconds per sample: the slopes of the lines through the stamps of each stretch, weighed by length.

    Stretches shorter than a few times `usual_rows`, the rows of one delivery, weigh less still: their slope
    depends on where they begin. `index` is the number of each sample, shape (n,).
    """
    starts, sizes = stretches.starts, stretches.sizes.astype(np.float64)
    x = (index - stretches.spread(index[starts])).astype(np.float64)
    t = time - stretches.spread(time[starts])
    sum_x, sum_t = (np.add.reduceat(values, starts) for values in (x, t))
    t *= x
    together = np.add.reduceat(t, starts) - sum_x * sum_t / sizes
    x *= x
    spread = np.add.reduceat(x, starts) - sum_x * sum_x / sizes
    known = spread > 0
    if not known.any():
        return None
    slopes = together[known] / spread[known]
    length = np.sqrt(12.0 * spread[known] / sizes[known])
    weight = length**3 / (length**2 + (8.0 * usual_rows) ** 2)
    return float(np.sum(weight * slopes) / np.sum(weight))


def slope_error(time: Array, stretches: Stretches) -> float:
    """Standard error of the slope in s, by how much it differs between parts of the stretches; inf if unknown."""
    steps = int(stretches.sizes.sum()) - len(stretches.sizes)
    usual = float(np.median(stretches.spread(stretches.sizes)))
    rows = int(max(1, min(steps // _BLOCKS, usual // 3)))
    while True:
        parts = _block_steps(time, stretches, rows)
        if parts.size >= _MIN_BLOCKS or rows == 1:
            break
        rows = max(1, rows // 2)
    if parts.size < 2:
        return np.inf
    # Means of blocks of a random walk differ by 2/3 of what its end points do; a line through it loses 1.2.
    return float(np.sqrt(1.2 * 1.5 * np.var(parts, ddof=1) / (rows * steps)))


def _block_steps(time: Array, stretches: Stretches, rows: int) -> Array:
    """Steps between the mean stamps of blocks of `rows` samples that follow each other in a stretch."""
    local = np.arange(len(time)) - stretches.spread(stretches.starts)
    whole = stretches.spread(stretches.sizes // rows * rows)
    kept = np.flatnonzero(local < whole)
    first = kept[local[kept] % rows == 0]
    if not first.size:
        return np.zeros(0)
    origin = stretches.spread(time[stretches.starts])[kept]
    means = (time[kept] - origin).reshape(-1, rows).mean(axis=1)
    run = stretches.spread(np.arange(len(stretches.sizes)))[first]
    return np.diff(means)[np.diff(run) == 0]
