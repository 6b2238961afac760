"""What is left in the residuals at the best q and r, and whether momentum describes it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kalscope.analysis.fit.record import Record, finite
from kalscope.analysis.fit.spikes import ALARM
from kalscope.analysis.residual_tests import SPIKE, correlation, dot, low_frequency_share, normality
from kalscope.common.array import Array
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.momentum.likelihood import concentrated

MIN_SHARE = 0.04
"""Share of the residuals' variance that must be predictable before a misfit of the model is reported."""

MOMENTA = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)
"""Momenta that are tried, in sample periods."""

NEARER = (0.6, 1.0, 1.7)
"""Factors of the best of them that are tried next: advice needs no precision, the estimate gives it."""

LOG_MOVES = np.linspace(-16.0, 16.0, 17)
"""ln(step variance / r) at which each is tried; next in steps of a quarter."""

QUARTERS = np.linspace(-2.0, 2.0, 9)

MIN_LOGLIK_GAIN = 6.0
"""Least gain in log-likelihood: the information criterion then wins by 10."""

MIN_GAIN_A_SAMPLE = 0.02
"""Least gain in log-likelihood a sample: 2 % of the error in predicting the next one."""

MAX_PARTS, MIN_PART = 8, 50
"""Parts of the record whose variances are compared, and the residuals that each of them needs."""

MIN_CHANGE = 2.0
"""Ratio of the largest to the least of these variances that is worth reporting."""


MAX_SKEWNESS, MIN_EXCESS = 0.7, -0.8
"""Residuals more skewed than this, or flatter (a sine has −1.5), are a mixture of several kinds."""


@dataclass(frozen=True)
class Free:
    """The best fits to a record with momentum and without, as near as advice needs them."""

    log_moves: float
    """ln(step variance / r) with momentum."""
    momentum: float
    """Sample periods."""
    log_ratio: float
    """ln(q/r) without."""
    gain: float
    """What momentum adds to the log-likelihood; below 0 where it fits worse."""

    @property
    def best(self) -> tuple[float, float]:
        """ln(step variance / r) and momentum of the likelier of the two."""
        return (self.log_moves, self.momentum) if self.gain > 0.0 else (self.log_ratio, 0.0)

    def predicts_better(self, m: int) -> bool:
        """Whether momentum is worth advice in a record of m innovations."""
        return self.gain > max(MIN_LOGLIK_GAIN, MIN_GAIN_A_SAMPLE * m)


@dataclass(frozen=True)
class Structure:
    """Residuals that are not white."""

    low_share: float
    """Share of their power that low frequencies hold, beyond that of white noise; 0 = they are only correlated."""
    momentum: float = 0.0
    """Momentum that describes it or a part of it, sample periods; 0 = none does, or the filter has one."""
    whole: bool = False
    """Whether nothing is left with that momentum."""


def find_structure(e: Array, lags: int) -> Structure | None:
    """Low frequencies or correlation in the residuals e, shape (n,), NaN where not scored; None for neither."""
    e = calmed(e)
    share, _, p = low_frequency_share(finite(e))
    if p < ALARM and share >= MIN_SHARE:
        return Structure(share)
    left = correlation(e, lags, fitted=True)
    scored = np.count_nonzero(np.isfinite(e))
    return Structure(0.0) if left.p < ALARM and left.q >= MIN_SHARE * scored else None


def find_free(record: Record) -> Free:
    """The best fits to a record, whatever the momentum of its filter."""
    searched = list(record.searched())
    tau, moves = _best(searched, MOMENTA, LOG_MOVES)
    tau, moves = _best(searched, [tau * factor for factor in NEARER], moves + QUARTERS)
    best, _ = concentrated(record.data, np.array([moves]), np.array([tau]))
    walk, log_ratio = _best_walk(record.data)
    return Free(moves, tau, log_ratio, float(best[0]) - walk)


def find_change(e: Array) -> float:
    """Largest over least variance of the residuals among up to eight parts of the record; 1 where it is chance.

    The chance is that of the means of e² given how much e² scatters within the parts, so that heavy tails do not
    count as a change.
    """
    from scipy.special import chdtri

    calm = finite(calmed(e))
    count = min(MAX_PARTS, len(calm) // MIN_PART)
    if count < 2:
        return 1.0
    parts = np.array_split(calm, count)
    sizes = np.array([len(part) for part in parts])
    means = np.array([np.square(part).mean() for part in parts])
    scatter = float(np.mean([np.square(part).var() for part in parts]))
    spread = float(np.sum(sizes * (means - np.average(means, weights=sizes)) ** 2))
    if float(means.max()) < MIN_CHANGE * float(means.min()) or spread <= float(chdtri(count - 1, ALARM)) * scatter:
        return 1.0
    seen = np.array([(part**2).mean() for part in np.array_split(finite(e), count)])
    return float(seen.max()) / max(float(seen.min()), 1e-12 * float(seen.max()))


def find_shape(e: Array) -> tuple[float, float]:
    """Skewness and excess kurtosis of residuals, shape (N,), far from a normal distribution; else 0, 0.

    Long tails on both sides do not count: they are reported as spikes.
    """
    if len(e) < MIN_PART:
        return 0.0, 0.0
    skewness, excess, _, p = normality(e)
    return (skewness, excess) if p < ALARM and (abs(skewness) > MAX_SKEWNESS or excess < MIN_EXCESS) else (0.0, 0.0)


def calmed(e: Array) -> Array:
    """The residuals with those beyond 4 σ (1.4826 · median) clipped there: a few must not outweigh all others."""
    sizes = np.abs(finite(e))
    size = math.sqrt(dot(sizes, sizes) / max(len(sizes), 1))
    scale = 1.4826 * float(np.median(sizes, overwrite_input=True)) if len(sizes) else 0.0
    if scale <= 0.01 * size:  # most of it is constant, or nearly
        return e
    return np.clip(e, -SPIKE * scale, SPIKE * scale)


def _best(
    searched: list[Differences], momenta: tuple[float, ...] | list[float], moves: Array
) -> tuple[float, float]:
    """The momentum and ln(step variance / r) of the highest likelihood over all stretches."""
    tau = np.repeat(np.array(momenta), len(moves))
    grid = np.tile(moves, len(momenta))
    total = np.sum([concentrated(one, grid, tau)[0] for one in searched], axis=0)
    at = int(np.argmax(total))
    return float(tau[at]), float(grid[at])


def _best_walk(data: Differences) -> tuple[float, float]:
    """The highest log-likelihood without momentum, and its ln(q/r)."""
    near = float(LOG_MOVES[int(np.argmax(data.concentrated(LOG_MOVES)))]) + QUARTERS
    heights = data.concentrated(near)
    at = int(np.argmax(heights))
    return max((float(heights[at]), float(near[at])), (data.random_walk()[0], float(LOG_MOVES[-1])))
