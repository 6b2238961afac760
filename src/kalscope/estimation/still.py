"""Finds the still stretch of a record: where the readings show noise alone, while elsewhere they move.

The record is cut into short blocks. A window of blocks is still where the noise within the blocks is white and
equally large, and the means of the blocks lie on a line that hardly drifts. That happens by chance on a random walk
too: the window must be so much more likely as noise than under the most likely random walk of the whole record that
fewer than one walk of a thousand has such a window. A likelihood ratio exceeds c once in c times at most by chance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from kalscope.common.numbers import Array
from kalscope.estimation import kernels
from kalscope.estimation.likelihood import differences, fit_maximum_likelihood, search_records
from kalscope.estimation.noise import resolution_of
from kalscope.filtering.filter import filter_pieces
from kalscope.filtering.params import FilterParams, one_record

BLOCK = 13
"""Samples of a block."""
MIN_BLOCKS = 4
"""Blocks of the shortest stretch."""
MIN_SAMPLES = MIN_BLOCKS * BLOCK
"""Samples of the shortest stretch."""
GROUPS = 8
"""Groups of blocks whose means and variances are compared, at most."""
FALSE_ALARM = 1e-3
"""Share of random walks in which a still stretch is found, at most."""
FITTED = 3
"""Numbers that are fitted to a window: level, slope and variance. Each costs half the logarithm of its samples."""
ALL_STILL = -0.5
"""How much less likely noise may be than a random walk where the whole record is taken for still, logarithm."""
EDGES = 16
"""One block in this many is left out at each end, at least one."""
QUIET = 2.0
"""Variance of a still window over that of the quietest quarter of the blocks, at most."""
MAX_DRIFT = 3.0
"""Drift over the stretch, in standard deviations of the noise."""
SURE = 3.3
"""Standard deviations up to which a statistic of white noise may be off."""
_SPIKE = 6.0
"""Standard deviations from the centred median beyond which a sample is ignored."""
_NORMAL = 2.1
"""Standard deviation of white noise over the median distance from its centred median of five."""


def find_still_stretch(z: ArrayLike, dt: ArrayLike | None = None) -> tuple[int, int] | None:
    """The best stretch in which only noise shows, for `noise_from_still`.

    Args:
        z: measurements of one channel, shape (n,); NaN is a missing sample.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.

    Returns:
        Its first sample and one past its last, 52 samples or more; None where there is none: a random walk all
        over, a movement without a pause, a signal without noise.

    Raises:
        BadSetting: z holds inf or has another shape; dt does not fit z.
    """
    column, steps = one_record(z, dt)
    place = np.flatnonzero(np.isfinite(column))
    unit = _unit(column[place])
    column, step = column / unit, resolution_of(column[place]) / unit
    good = place[~_far(column[place], step)]
    count = len(good) // BLOCK
    if count < MIN_BLOCKS:
        return None
    del place
    surprise = _surprise(column, steps, good)
    blocks = _Blocks.of(column[good], np.diff(good) == 1, surprise, step, count)
    del surprise, column
    stretch = _best(blocks)
    return None if stretch is None else (int(good[stretch[0] * BLOCK]), int(good[stretch[1] * BLOCK - 1]) + 1)


@dataclass(frozen=True)
class _Blocks:
    """What is known of each block of samples, shape (k,) each."""

    mean: Array
    """Mean of the samples."""
    squares: Array
    """Sum of the squares about it."""
    jumps: Array
    """Sum of the squared differences of neighbouring samples."""
    pairs: Array
    """Their number."""
    surprise: Array
    """Minus the log-likelihood of the samples under the random walk of the whole record."""
    floor: float
    """The variance of rounding."""
    loudest: float
    """The largest variance of a still window: no burst, however white, is still where other blocks are quieter."""

    @staticmethod
    def of(z: Array, follows: NDArray[np.bool_], surprise: Array, step: float, count: int) -> _Blocks:
        rows = z[: count * BLOCK].reshape(count, BLOCK)
        mean = rows.mean(axis=1)
        together = np.append(follows, False)[: count * BLOCK].reshape(count, BLOCK)[:, :-1]
        squares = ((rows - mean[:, None]) ** 2).sum(axis=1)
        changing, floor = squares[squares > 0.0], step * step / 12.0
        quiet = float(np.quantile(changing, 0.25)) / (BLOCK - 1) if len(changing) else 0.0
        return _Blocks(
            mean,
            squares,
            (np.diff(rows, axis=1) ** 2 * together).sum(axis=1),
            together.sum(axis=1).astype(np.float64),
            surprise[: count * BLOCK].reshape(count, BLOCK).sum(axis=1),
            floor,
            max(QUIET * quiet, floor),
        )

    def windows(self, size: int, first: int, last: int, hop: int) -> tuple[Array, Array]:
        """Windows of `size` blocks, beginning at first, first + hop, … up to last.

        Returns:
            Whether each shows noise alone, and by how much more likely that is than the random walk, the logarithm;
            shape (w,) each.
        """
        mean, squares, jumps, pairs, surprise = (
            sliding_window_view(values[first : last + size], size)[::hop]
            for values in (self.mean, self.squares, self.jumps, self.pairs, self.surprise)
        )
        samples = size * BLOCK
        noise = squares.sum(axis=1) / (samples - size)
        variance = np.maximum(noise, self.floor)
        with np.errstate(divide="ignore", invalid="ignore"):
            white = jumps.sum(axis=1) / pairs.sum(axis=1) / (2.0 * noise)
            still = np.abs(white - 1.0) < SURE / math.sqrt(samples)
            still &= (noise > 0.0) & (variance <= self.loudest)
            still &= _level(mean, variance)
            still &= _even(squares, size)
            squared = squares.sum(axis=1) + BLOCK * _line(mean)[1]
            gain = surprise.sum(axis=1) - 0.5 * (samples * np.log(2.0 * math.pi * variance) + squared / variance)
            gain -= 0.5 * FITTED * math.log(samples)
        return still, gain


def _line(means: Array) -> tuple[Array, Array]:
    """Slope of the straight line through each row, and the sum of squared distances from it, shape (w,) each."""
    middle = np.arange(means.shape[1], dtype=np.float64) - 0.5 * (means.shape[1] - 1)
    slope: Array = means @ middle / (middle @ middle)
    off: Array = means - means.mean(axis=1, keepdims=True) - slope[:, None] * middle
    return slope, (off * off).sum(axis=1)


def _level(mean: Array, noise: Array) -> Array:
    """Whether the means of groups of blocks lie on a line that hardly drifts, as means of white noise do."""
    size = mean.shape[1]
    groups = min(size, GROUPS)
    each = size // groups
    means = mean[:, : groups * each].reshape(-1, groups, each).mean(axis=2)
    slope, squared = _line(means)
    chi2, freedom = squared * each * BLOCK / noise, groups - 2
    on_line = chi2 < freedom + SURE * math.sqrt(2.0 * freedom) + 3.0
    return on_line & (np.abs(slope) * groups < MAX_DRIFT * np.sqrt(noise))


def _even(squares: Array, size: int) -> Array:
    """Whether the noise is as large in all groups of blocks."""
    groups = min(size, GROUPS)
    each = size // groups
    sums = squares[:, : groups * each].reshape(-1, groups, each).sum(axis=2)
    spread = 2.0 * SURE * math.sqrt(2.0 / (each * (BLOCK - 1)))
    return np.log(sums.max(axis=1) / sums.min(axis=1)) < spread


def _best(blocks: _Blocks) -> tuple[int, int] | None:
    """First block and one past the last of the most likely still window."""
    count = len(blocks.mean)
    still, gain = blocks.windows(count, 0, 0, 1)
    if still[0] and gain[0] + 0.5 * FITTED * math.log(count * BLOCK) > ALL_STILL:
        return 0, count
    best, stretch, looked = -math.inf, None, 0
    size = MIN_BLOCKS
    while size <= count:
        hop = max(size // 4, 1)
        still, gain = blocks.windows(size, 0, count - size, hop)
        looked += len(gain)
        gain = np.where(still, gain, -math.inf)
        at = int(np.argmax(gain))
        if gain[at] > best:
            best, stretch = float(gain[at]), (at * hop, at * hop + size)
        size = max(size + 1, size * 5 // 4)
    if stretch is None or best < math.log(looked / FALSE_ALARM):
        return None
    return _trimmed(*stretch, count)


def _unit(readings: Array) -> float:
    """A power of two near the largest reading: its multiples have the same digits, and squares that stay finite."""
    _, exponent = math.frexp(float(np.abs(readings).max(initial=0.0)))
    return math.ldexp(1.0, min(max(exponent, -1000), 1023))


def _trimmed(first: int, last: int, count: int) -> tuple[int, int]:
    """Without the blocks at the ends, in which the movement may begin; the ends of the record stay."""
    edge = max(1, (last - first) // EDGES)
    start, stop = first + (edge if first > 0 else 0), last - (edge if last < count else 0)
    return (start, stop) if stop - start >= MIN_BLOCKS else (first, last)


def _far(readings: Array, step: float) -> NDArray[np.bool_]:
    """The samples far from the centred median of five: spikes."""
    distance, scale = np.empty(len(readings)), np.empty(len(readings))
    kernels.median_distances(readings, 5, distance)
    last = max(len(readings) - MIN_SAMPLES - 1, 0) // MIN_SAMPLES * MIN_SAMPLES  # the last part may be longer
    scale[:last].reshape(-1, MIN_SAMPLES)[:] = np.median(distance[:last].reshape(-1, MIN_SAMPLES), axis=1)[:, None]
    scale[last:] = np.median(distance[last:]) if len(distance) else 0.0
    scale *= _NORMAL
    np.maximum(scale, 0.5 * step, out=scale)
    scale *= _SPIKE
    return distance > scale


def _surprise(column: Array, steps: Array, good: NDArray[np.intp]) -> Array:
    """Minus the log-likelihood of each good sample under the most likely random walk of the record."""
    z = np.full(len(column), np.nan)
    z[good] = column[good] - column[good[0]]
    data = differences(z, steps)
    if not data.d.any():
        return np.zeros(len(good))
    pair = fit_maximum_likelihood(data, search_records(data.records).one())
    scale = data.scale * data.scale
    params = FilterParams(q=pair.q * scale, r=pair.r * scale)
    del data
    surprise = np.empty(len(z))
    for first, one in filter_pieces(z, params, steps if len(steps) else None):
        v, s = one.innovation, one.s
        with np.errstate(divide="ignore", invalid="ignore"):
            surprise[first : first + len(v)] = 0.5 * (np.log(2.0 * math.pi * s) + v * v / s)
    surprise = surprise[good]
    surprise[0] = np.mean(surprise[1:])  # the first sample sets the start: no worse than the others
    return surprise
