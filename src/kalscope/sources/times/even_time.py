"""Samples placed evenly in time, where stamps come in bursts or from a clock coarser than the sample period."""

from __future__ import annotations

import numpy as np

from kalscope.common.array import Array, Indices, Mask
from kalscope.sources.times.sample_rate import SampleRate
from kalscope.sources.times.step_pattern import GAP_PERIODS
from kalscope.sources.times.stretches import Stretches

_BLOCK = 8
"""Usual deliveries in one block, whose samples are placed around their mean stamp."""
_BURST_SHARE = 2 / 3
_MANY_REPEATS = 0.15


def place_evenly(time: Array, rate: SampleRate) -> Array:
    """Time of each sample, shape (n,): on the line through the stamps of its stretch.

    Where the true rate drifts, so that one line would miss the stamps by more than half a usual delivery, the
    line bends: it goes through the mean stamp of each block of samples. Stretches with a step per sample keep
    their stamps.
    """
    stretches, n = rate.stretches, len(time)
    local = np.arange(n) - stretches.spread(stretches.starts)
    means = _means(time, stretches)
    slopes = _slopes(time, stretches, rate)
    middle = (stretches.sizes - 1) / 2
    placed = stretches.spread(means) + stretches.spread(slopes) * (local - stretches.spread(middle))
    rows = max(2, round(_BLOCK * rate.longest / rate.period))
    bent = _bent(time - placed, stretches, rows, rate.longest)
    if bent.any():
        chosen = stretches.spread(bent)
        placed[chosen] += _followed(time - placed, stretches, bent, rows)[chosen]
    kept = ~_crowded(rate)
    if kept.any():
        chosen = stretches.spread(kept)
        placed[chosen] = time[chosen]
    if rate.stamps == "coarse":
        # A clock shows its last step: the samples of a second lie after it.
        placed += max(0.0, rate.longest - rate.period) / 2
    # Stretches end a little before the next begins, whatever their lines say.
    return np.maximum.accumulate(placed) if rate.steps.forward is rate.steps.all else placed


def _means(values: Array, stretches: Stretches) -> Array:
    origin = values[stretches.starts]
    return origin + np.add.reduceat(values - stretches.spread(origin), stretches.starts) / stretches.sizes


def _slopes(time: Array, stretches: Stretches, rate: SampleRate) -> Array:
    """Slope of the line through each stretch, s per sample; a short one takes that of all."""
    sizes = stretches.sizes.astype(np.float64)
    x = np.arange(len(time)) - stretches.spread(stretches.starts + (sizes - 1) / 2)
    t = time - stretches.spread(time[stretches.starts])
    spread = np.add.reduceat(x * x, stretches.starts)
    own = np.add.reduceat(x * t, stretches.starts) / np.where(spread > 0, spread, 1.0)
    long = sizes * rate.period > 4 * _BLOCK * rate.longest
    return np.where(long & (own > 0), own, rate.period)


def _blocks(stretches: Stretches, rows: int) -> tuple[Indices, Indices]:
    """First sample of each whole block of `rows` samples, and the stretch that it is in."""
    local = np.arange(int(stretches.sizes.sum())) - stretches.spread(stretches.starts)
    whole = stretches.spread(stretches.sizes // rows * rows)
    first = np.flatnonzero((local < whole) & (local % rows == 0))
    return first, stretches.spread(np.arange(len(stretches.sizes)))[first]


def _block_means(values: Array, first: Indices, rows: int) -> Array:
    total = np.concatenate(([0.0], np.cumsum(values)))
    return (total[first + rows] - total[first]) / rows


def _bent(residual: Array, stretches: Stretches, rows: int, longest: float) -> Mask:
    """True for each stretch whose line misses the mean stamps of its blocks."""
    first, run = _blocks(stretches, rows)
    bent = np.zeros(len(stretches.sizes), dtype=bool)
    bent[run[np.abs(_block_means(residual, first, rows)) > 0.5 * longest]] = True
    return bent


def _followed(residual: Array, stretches: Stretches, bent: Mask, rows: int) -> Array:
    """How much later the stamps are than the line, between the middles of the blocks, shape (n,)."""
    first, run = _blocks(stretches, rows)
    # The last block of a stretch goes up to its end, so that no sample lies far from a middle.
    ends = (stretches.starts + stretches.sizes - rows)[bent & (stretches.sizes >= rows)]
    first = np.union1d(first[bent[run]], ends)
    middle, late = first + (rows - 1) / 2, _block_means(residual, first, rows)
    # Before the first middle and after the last one the line continues as between the nearest two.
    starts, stops = stretches.starts[bent], (stretches.starts + stretches.sizes - 1)[bent]
    lowest, highest = np.searchsorted(middle, starts), np.searchsorted(middle, stops) - 1
    edges = np.concatenate((starts, stops))
    outer = np.concatenate((lowest, highest))
    inner = np.concatenate((np.minimum(lowest + 1, highest), np.maximum(highest - 1, lowest)))
    apart = middle[inner] - middle[outer]
    slope = (late[inner] - late[outer]) / np.where(apart == 0.0, 1.0, apart)
    at = np.concatenate((middle, edges))
    values = np.concatenate((late, late[outer] + slope * (edges - middle[outer])))
    order = np.argsort(at, kind="stable")
    return np.interp(np.arange(len(residual)), at[order], values[order])


def _crowded(rate: SampleRate) -> Mask:
    """True for each stretch with several samples per step: stamps that repeat, or most time in long steps."""
    stretches, steps = rate.stretches, rate.steps.all
    inside = np.append(steps, 0.0)
    inside[stretches.starts[1:] - 1] = 0.0
    repeats = np.add.reduceat((inside == 0.0).astype(np.float64), stretches.starts) - 1
    positive = np.maximum(inside, 0.0)
    waiting = np.where(positive > GAP_PERIODS * rate.period, positive, 0.0)
    spent, waited = (np.add.reduceat(values, stretches.starts) for values in (positive, waiting))
    many = repeats > _MANY_REPEATS * stretches.sizes
    return many | (waited > _BURST_SHARE * spent) | (rate.stamps == "coarse")
