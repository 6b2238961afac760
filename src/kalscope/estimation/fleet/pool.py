"""The parts of a pooled likelihood: sums over the devices of a batch, which add up to those of a fleet of any size.

Each device gives its log-likelihood with r = 1 at every ln λ of one grid; a batch keeps only the sums over its
devices, five numbers a λ, so a million devices need as much memory as one. Between the points of the grid the sums
are smooth (analytic within ±π of the real axis): a polynomial through the nearest 24 points finds ln λ of the
maximum to 1e-6 of that of a direct search.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.array import Array
from kalscope.errors import BadSetting
from kalscope.estimation.fleet import pool_kernels as kernels
from kalscope.estimation.fleet.many.series import Series, series_of
from kalscope.estimation.likelihood.profile import DEFAULT_LOG_RATIOS

_NEAREST = 24
"""Points of the grid that the polynomial between two of them goes through."""


@dataclass(frozen=True)
class Pool:
    """Sums over the devices of a batch, or of a fleet: `a + b` is the pool of both.

    Sums of floating-point numbers depend on their order in the last digit: add parts in one order (that of their
    names) for the same result after every restart.
    """

    sums: Array
    """Σ m ln r̂, Σ ln r̂, ΣΣv²/f (unit²), ΣΣln f and Σ(slope)² at each of the 121 ln λ of DEFAULT_LOG_RATIOS, at
    λ = 0 and at λ = ∞ (where q̂ replaces r̂), shape (5, 123)."""
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

    def loglik(self, log_ratios: Array, common: bool) -> Array:
        """The summed log-likelihood at each ln λ, ∓inf allowed: with the best common r, or the best r of each."""
        return self._between(self._logliks(common), log_ratios)

    def noise(self, log_ratio: float, common: bool) -> float:
        """The best r at ln λ, unit²: the common one, or the geometric mean of those of the devices; q at inf."""
        with np.errstate(divide="ignore"):
            total = np.log(self.sums[kernels.CHI2] / self.innovations)
        level = total if common else self.sums[kernels.LOG_R] / self.devices
        level[:-2] += np.logaddexp(0.0, DEFAULT_LOG_RATIOS)  # ln r(1 + λ) is level at both ends
        size = float(self._between(level, np.array([log_ratio]))[0])
        return math.exp(size - (np.logaddexp(0.0, log_ratio) if math.isfinite(log_ratio) else 0.0))

    def slopes(self, log_ratio: float) -> float:
        """The sum over the devices of their squared slopes of the log-likelihood by ln λ, each with its best r."""
        return max(float(self._between(self.sums[kernels.SLOPES], np.array([log_ratio]))[0]), 0.0)

    def _logliks(self, common: bool) -> Array:
        m, sums = self.innovations, self.sums
        with np.errstate(divide="ignore"):
            scales = m * np.log(sums[kernels.CHI2] / m) if common else sums[kernels.M_LOG_R]
        return -0.5 * (m * (math.log(2.0 * math.pi) + 1.0) + scales + sums[kernels.LOGDET])

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


def refuse_empty(pool: Pool) -> None:
    """BadSetting where no device counts."""
    if pool.devices == 0:
        raise BadSetting("the fleet must hold at least one series that can be fitted (got none)")


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
