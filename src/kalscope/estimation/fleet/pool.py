"""One filter for a whole fleet, by the sum of its likelihoods: what each batch adds, and the maximum."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.array import Array
from kalscope.common.checks import above_zero
from kalscope.common.progress import Progress
from kalscope.errors import BadSetting
from kalscope.estimation.fleet import kernels
from kalscope.estimation.fleet.many.series import Series, series_of
from kalscope.estimation.likelihood.profile import DEFAULT_LOG_RATIOS
from kalscope.estimation.likelihood.search import Peak, find_peak
from kalscope.estimation.verdict.conclude import exp
from kalscope.filtering.params import MAX_VARIANCE, FilterParams

_NEAREST = 24
"""Points of the grid that the polynomial between two of them goes through."""


@dataclass(frozen=True)
class Pool:
    """Sums over the devices of a batch, or of a fleet: `a + b` is the pool of both.

    Sums of floating-point numbers depend on their order in the last digit: add parts in one order (that of their
    names) for the same result after every restart.
    """

    sums: Array
    """Σ m ln r̂, Σ ln r̂, ΣΣln f and Σ(slope)² at each of the 121 ln λ of DEFAULT_LOG_RATIOS, at
    λ = 0 and at λ = ∞ (where q̂ replaces r̂), shape (4, 123)."""
    devices: int
    """Series that count: those that can be fitted."""
    innovations: int
    """Their scored innovations."""

    def __add__(self, other: Pool) -> Pool:
        return Pool(self.sums + other.sums, self.devices + other.devices, self.innovations + other.innovations)

    @staticmethod
    def empty() -> Pool:
        """The pool of no device: where a sum of pools begins."""
        return Pool(np.zeros((kernels.SUMS, len(DEFAULT_LOG_RATIOS) + 2)), 0, 0)

    def loglik(self, log_ratios: Array) -> Array:
        """The summed log-likelihood at each ln λ, ∓inf allowed, with the best r of each device."""
        terms = self.innovations * (math.log(2.0 * math.pi) + 1.0)
        return self._between(-0.5 * (terms + self.sums[kernels.M_LOG_R] + self.sums[kernels.LOGDET]), log_ratios)

    def noise(self, log_ratio: float) -> float:
        """The geometric mean of the best r of the devices at ln λ, unit²; that of q at inf."""
        level = self.sums[kernels.LOG_R] / self.devices
        level[:-2] += np.logaddexp(0.0, DEFAULT_LOG_RATIOS)  # ln r(1 + λ) is level at both ends
        size = float(self._between(level, np.array([log_ratio]))[0])
        return math.exp(size - (np.logaddexp(0.0, log_ratio) if math.isfinite(log_ratio) else 0.0))

    def slopes(self, log_ratio: float) -> float:
        """The sum over the devices of their squared slopes of the log-likelihood by ln λ, each with its best r."""
        return max(float(self._between(self.sums[kernels.SLOPES], np.array([log_ratio]))[0]), 0.0)

    def _between(self, row: Array, log_ratios: Array) -> Array:
        """A row that is level at both ends at each ln λ; beyond the grid its end is kept."""
        grid = DEFAULT_LOG_RATIOS
        out = np.empty(len(log_ratios))
        zero, infinite = np.isneginf(log_ratios), np.isposinf(log_ratios)
        out[zero], out[infinite] = row[-2], row[-1]
        inner = ~(zero | infinite)
        ends = row[-2], row[-1] if np.isfinite(row[-1]) else row[-3]
        longer = np.concatenate([np.full(_NEAREST, ends[0]), row[:-2], np.full(_NEAREST, ends[1])])
        step = float(grid[1] - grid[0])
        out[inner] = _interpolated(
            longer, (np.clip(log_ratios[inner], grid[0], grid[-1]) - grid[0]) / step + _NEAREST
        )
        return out


def pool_of(
    series: Series | ArrayLike | Sequence[ArrayLike], dt: ArrayLike | Sequence[ArrayLike] | None = None
) -> Pool:
    """The pool of some devices, one compiled call. Series that cannot be fitted do not count.

    Args:
        series: as `estimate_many` takes them.
        dt: nominal sample periods before each sample, shaped like `series`; None = 1 each.

    Raises:
        BadSetting: the series or dt have another shape.

    Source: Durbin & Koopman (2012), section 2.10, for the likelihood; independent devices add.
    """
    many = series_of(series, dt)
    pool = Pool.empty()
    if not len(many):
        return pool
    counts: NDArray[np.int64] = np.zeros(2, np.int64)
    kernels.add_up(many.values, many.steps, many.starts, DEFAULT_LOG_RATIOS.copy(), pool.sums, counts)
    return Pool(pool.sums, int(counts[0]), int(counts[1]))


def _interpolated(values: Array, where: Array) -> Array:
    """Values at 0, 1, 2 …, read between them: the polynomial through the nearest points, barycentric."""
    first = np.clip(np.floor(where).astype(np.int64) - _NEAREST // 2 + 1, 0, len(values) - _NEAREST)
    points = first[:, None] + np.arange(_NEAREST)
    away = where[:, None] - points
    exact = np.abs(away) < 1e-12
    weights = np.array([(-1.0) ** j * math.comb(_NEAREST - 1, j) for j in range(_NEAREST)])
    terms = weights / np.where(exact, 1.0, away)
    base = values[points[:, :1]]
    smooth = np.sum(terms * (values[points] - base), axis=1) / np.sum(terms, axis=1) + base[:, 0]
    return np.where(exact.any(axis=1), values[points[np.arange(len(points)), exact.argmax(axis=1)]], smooth)


@dataclass(frozen=True)
class PooledFit:
    """One filter for all devices of a fleet: one λ, and the geometric mean of the r that suit the devices best."""

    q: float
    """Process-noise variance per nominal sample period, unit²; 0 for "no_movement"."""
    r: float
    """Measurement-noise variance, unit²; 0 for "no_noise"."""
    ratio: float
    """λ = q/r that all share, 0 … inf."""
    loglik: float
    """Summed log-likelihood there."""
    ratio_interval: tuple[float, float]
    """The λ that another fleet of such devices may have as its best one, 95 %: profile likelihood, wider where the
    devices differ. It is narrow for a large fleet, and does not show how far its devices differ: see `outliers`."""
    verdict: str
    """"ok", "no_noise", "no_movement" or "flat", as in `Estimate`; "given" where a target fixed λ."""

    @property
    def params(self) -> FilterParams | None:
        """The filter that all get, diffuse start; None where q or r is 0."""
        return FilterParams(q=self.q, r=self.r) if self.q > 0.0 and self.r > 0.0 else None


def fit_pool(pool: Pool) -> PooledFit:
    """The most likely λ for all devices of a fleet, every device with its r, concentrated out.

    Args:
        pool: of the fleet, the sum of the pools of its batches.

    Raises:
        BadSetting: no device counts.
    """
    _refuse_empty(pool)
    at_infinity = float(pool.loglik(np.array([math.inf]))[0])
    peak = find_peak(pool.loglik, DEFAULT_LOG_RATIOS[::2], at_infinity, Progress())
    low, high = _interval(pool, peak, at_infinity)
    noise = pool.noise(peak.log_ratio)
    q, r = exp(peak.log_ratio) * noise, noise
    verdict = "flat" if (low, high) == (-math.inf, math.inf) else "ok"
    if peak.log_ratio == math.inf:
        q, r, verdict = noise, 0.0, "no_noise"
    elif peak.log_ratio == -math.inf:
        q, verdict = 0.0, "no_movement"
    return PooledFit(q, r, exp(peak.log_ratio), peak.loglik, (exp(low), exp(high)), verdict)


def _interval(pool: Pool, peak: Peak, at_infinity: float) -> tuple[float, float]:
    """The interval of ln λ, which accounts for how much the devices differ.

    The slopes of the devices at the top scatter by the curvature where all share λ, by more where they do not; the
    likelihood is flattened by that factor.

    Source: Kent (1982), Biometrika 69, 19, for the likelihood ratio of a model that is not quite true.
    """
    if not (math.isfinite(peak.log_ratio) and peak.curvature < 0.0):
        return peak.interval
    factor = pool.slopes(peak.log_ratio) / -peak.curvature
    if factor <= 1.0:
        return peak.interval

    def flattened(at: Array) -> Array:
        return pool.loglik(at) / factor

    return find_peak(flattened, DEFAULT_LOG_RATIOS[::2], at_infinity / factor, Progress()).interval


def pool_at(pool: Pool, ratio: float) -> PooledFit:
    """The filter of a given λ (of `ratio_for` a lag, say) for all devices of a fleet, with the r that fits it best.

    Args:
        pool: of the fleet.
        ratio: λ = q/r, > 0.

    Raises:
        BadSetting: no device counts; ratio is not above 0.
    """
    _refuse_empty(pool)
    chosen = above_zero("ratio", ratio, MAX_VARIANCE)
    r, loglik = pool.noise(math.log(chosen)), float(pool.loglik(np.array([math.log(chosen)]))[0])
    return PooledFit(chosen * r, r, chosen, loglik, fit_pool(pool).ratio_interval, "given")


def _refuse_empty(pool: Pool) -> None:
    if pool.devices == 0:
        raise BadSetting("the fleet must hold at least one series that can be fitted (got none)")
