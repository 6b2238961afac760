"""The settled filter over a long stretch of a record, in lanes, equal to that sample by sample to the last bit.

Without missing samples p and k repeat to the last bit after a while, every one to three samples. From then on x
forgets its start: two runs over the same samples converge to the same bits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kalscope.common.array import Array, Indices
from kalscope.filtering.pieces.lane_kernels import BLOCK, LANES, filter_lanes

PERIODS = (1, 2)
"""Samples after which p may repeat itself: rounding keeps some 2 % of the filters from a single value."""

FORGOTTEN = 48.0
"""Time constants after which two runs are the same: 36 bring 2⁵² to 1, the others end the last bit's difference."""

LONGEST = 16384
"""Samples of a lane, or four times its warm-up: after a missing one the rest of the stretch is filtered twice."""


@dataclass(frozen=True)
class Cycle:
    """What repeats itself in a settled filter."""

    p: Array
    """Posterior variance of the next samples, shape (period,)."""
    k: Array
    """Their gain."""
    s: Array
    """Their innovation variance."""

    @cached_property
    def block(self) -> tuple[Array, Array]:
        """Gain, and 1/s, of one block."""
        k, s = (np.tile(row, BLOCK // len(row)) for row in (self.k, self.s))
        return k, 1.0 / s

    @cached_property
    def warm(self) -> int:
        """Samples after which a lane no longer depends on where it began, most likely."""
        return BLOCK * math.ceil(FORGOTTEN / (float(self.k.mean()) * BLOCK))

    @cached_property
    def norm(self) -> float:
        """Mean of ln 2π + ln s."""
        return math.log(2.0 * math.pi) + float(np.log(self.s).mean())


@dataclass(frozen=True)
class Stretch:
    """The result of filtering a stretch in lanes."""

    tried: int
    """Samples tried; 0 = too few are left."""
    done: int
    """Samples that are filtered, from the first on: all, or those before a missing one."""
    x: float
    """Filtered value of the last of these."""
    loglik: float
    """Their log-likelihood."""


def cycle_of(p: Array, k: Array, s: Array) -> Cycle | None:
    """What repeats itself at the end of these rows; None = the filter has not settled, or its gain is 0."""
    for period in PERIODS:
        if len(p) > period and p[-1] == p[-1 - period] and (k[-period:] > 0.0).all():
            return Cycle(p[-period:].copy(), k[-period:].copy(), s[-period:].copy())
    return None


def filter_stretch(
    z: Array, cycle: Cycle, x: float, indices: Indices, first: int, out: tuple[Array, Array]
) -> Stretch:
    """Filter the first samples of z, as many as is worthwhile.

    Args:
        z: the samples that follow, shape (n,), with any strides.
        cycle: the settled gain.
        x: the filtered value before.
        indices: the samples to keep, ascending, none before z; more may follow.
        first: what the first sample of z is counted as there.
        out: where x and innovation of these go, each of the shape of indices.
    """
    warm = cycle.warm
    each = min((len(z) - warm) // LANES, max(LONGEST, 4 * warm)) // BLOCK * BLOCK
    if each < max(BLOCK, warm // 4):
        return Stretch(0, 0, x, 0.0)
    ends = warm + each * np.arange(1, LANES + 1)
    end = np.searchsorted(indices, first + ends).astype(np.intp)
    begin = np.concatenate(([0], end[:-1])).astype(np.intp)
    tried = np.ascontiguousarray(z[: ends[-1]])
    lanes, x, chi2 = filter_lanes(tried, warm, *cycle.block, x, indices[: end[-1]] - first, begin, end, out)
    done = int(ends[lanes - 1]) if lanes else 0
    loglik = -0.5 * (done * cycle.norm + chi2)
    return Stretch(len(tried), done, float(x), loglik)
