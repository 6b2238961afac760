"""How well a pair (q, r) explains a record: the exact log-likelihood, and its profile over λ = q/r.

Convention: the sum over the m scored innovations of −½(ln 2π + ln s + v²/s); the first finite sample sets the
exact diffuse start and is not scored (KFAS and R's arima agree; Stata and statsmodels count it, −½ ln 2π more).
With r = 1 and q = λ the filter gives Σv²/f and Σln f; r = Σv²/f / m is then the best r of that λ, so that one
search over ln λ finds both (scale concentrated out: Durbin & Koopman 2012, section 2.10).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.errors import BadSetting
from kalscope.estimation.likelihood import kernels as profile_kernels
from kalscope.filtering.arrays import one_record
from kalscope.filtering.filter import kalman_filter
from kalscope.filtering.params import FilterParams

DEFAULT_LOG_RATIOS = np.linspace(-24.0, 24.0, 121)
"""ln λ from a lag of 160,000 samples to no filtering at all, in steps in which the likelihood is smooth."""
DEFAULT_LOG_RATIOS.setflags(write=False)

MAX_LOG_RATIO = 300.0
"""Largest |ln λ| of a profile."""

_MAX_GAP = 1e150
"""Periods; a longer gap changes nothing, and its product with λ must fit a double."""


@dataclass(frozen=True)
class Differences:
    """One channel as input of the likelihood: the differences of neighbouring finite samples."""

    d: Array
    """Differences divided by `scale`, shape (m,), largest between ½ and 1; m = 0 for fewer than two samples."""
    gap: Array
    """Nominal sample periods between the two samples, shape (m,), ≥ 0; empty = 1 each."""
    scale: float
    """A power of two, unit: dividing by it costs no digit, so the answers do not depend on the unit."""

    @property
    def m(self) -> int:
        """Scored innovations."""
        return len(self.d)

    @property
    def span(self) -> float:
        """Sample periods from the first sample to the last."""
        return float(self.gap.sum()) if len(self.gap) else float(self.m)

    def parts(self, stretches: Iterable[tuple[int, int]]) -> Differences:
        """The record with only the samples from each first to before its stop; the others are missing."""
        gap = self.gap if len(self.gap) else np.ones(self.m)
        kept_d, kept_gap, last = list[Array](), list[Array](), -1
        for first, stop in stretches:
            if first < stop:
                if last >= 0:
                    kept_d.append(self.d[last:first].sum(keepdims=True))
                    kept_gap.append(gap[last:first].sum(keepdims=True))
                kept_d.append(self.d[first : stop - 1])
                kept_gap.append(gap[first : stop - 1])
                last = stop - 1
        gap = np.concatenate(kept_gap)
        return Differences(np.concatenate(kept_d), np.empty(0) if np.all(gap == 1.0) else gap, self.scale)

    def sums(self, ratios: Array) -> tuple[Array, Array]:
        """Σv²/f (in scale²) and Σln f for each λ ≥ 0, shape of `ratios`, in any order; r = 1."""
        order = np.argsort(-ratios)
        lanes = len(ratios) + -len(ratios) % profile_kernels.LANES
        filled = np.full(lanes, ratios[order[-1]])
        filled[: len(ratios)] = ratios[order]
        chi2, logdet = np.empty(lanes), np.empty(lanes)
        profile_kernels.scan_ratios(self.d, self.gap, filled, chi2, logdet)
        out = np.empty_like(ratios), np.empty_like(ratios)
        out[0][order], out[1][order] = chi2[: len(ratios)], logdet[: len(ratios)]
        return out

    def concentrated(self, log_ratios: Array) -> Array:
        """Log-likelihood of the data for each ln λ (−inf is λ = 0) with the best r of that λ."""
        chi2, logdet = self.sums(np.exp(log_ratios))
        return self.from_sums(chi2, logdet)

    def from_sums(self, chi2: Array, logdet: Array) -> Array:
        """−½[m ln 2π + m + m ln(χ²/m) + Σln f] in the unit of the data."""
        with np.errstate(divide="ignore"):
            log_r = np.log(chi2 / self.m) + 2.0 * math.log(self.scale)
        return -0.5 * (self.m * (math.log(2.0 * math.pi) + 1.0 + log_r) + logdet)

    def random_walk(self) -> tuple[float, float]:
        """λ = ∞, no measurement noise: the concentrated log-likelihood and q in scale².

        Two samples at one instant that differ rule it out: −inf.
        """
        if len(self.gap) == 0:
            q = float(np.mean(self.d * self.d))
            return float(self.from_sums(np.array(q * self.m), np.zeros(()))), q
        gap = self.gap
        moved = gap > 0.0
        if np.any(self.d[~moved] != 0.0) or not moved.any():
            return -math.inf, 0.0
        q = float(np.mean(self.d[moved] ** 2 / gap[moved]))
        loglik = self.from_sums(np.array(q * self.m), np.log(gap[moved]).sum())
        return float(loglik), q


def differences(column: Array, steps: Array) -> Differences:
    """The finite samples of one channel, shape (n,), as differences; `steps` empty means regular sampling."""
    finite = np.isfinite(column)
    if finite.all():
        samples, gap = column, steps[1:]
    else:
        where = np.flatnonzero(finite)
        samples = column[where]
        if len(where) < 2:
            gap = np.empty(0)
        elif len(steps):
            gap = np.add.reduceat(steps[: where[-1] + 1], where[:-1] + 1)
        else:
            gap = np.subtract(where[1:], where[:-1], out=np.empty(len(where) - 1))
        del where
    if len(gap) and np.all(gap == 1.0):
        gap = np.empty(0)
    half = np.diff(0.5 * samples)  # halved: two values near the largest double may lie two of them apart
    largest = max(float(half.max(initial=0.0)), -float(half.min(initial=0.0)))
    if largest == 0.0:
        return Differences(half, np.minimum(gap, _MAX_GAP), 1.0)
    exponent = min(math.frexp(largest)[1], 1022)
    return Differences(
        np.ldexp(half, -exponent, out=half), np.minimum(gap, _MAX_GAP), math.ldexp(1.0, exponent + 1)
    )


@dataclass(frozen=True)
class Profile:
    """The likelihood of one channel over λ; one scan of the data, from which every (q, r) can be read."""

    log_ratios: Array
    """ln λ, shape (k,), ascending."""
    loglik: Array
    """Concentrated log-likelihood: each λ with its best r, shape (k,)."""
    r: Array
    """That best r = χ²/m, unit², shape (k,); q = λ r."""
    chi2: Array
    """Σv²/f with r = 1, unit², shape (k,)."""
    logdet: Array
    """Σln f with r = 1, shape (k,)."""
    m: int
    """Scored innovations."""
    step: float = 1.0
    """Variance of one step of the signal for q = 1: 1 without momentum, less with it."""

    def loglik_at(self, q: ArrayLike, r: ArrayLike) -> Array:
        """Log-likelihood at q and r ≥ 0, unit², arrays that broadcast; outside the profile its end is kept.

        Read between the points by a cubic spline of χ²(1 + cλ) and Σln f − m ln(1 + cλ), which are level at
        both ends, c = `step`; with the default 121 points good to about 3e-6 m (a map, not the last digit).
        """
        from scipy.interpolate import CubicSpline

        q, r = np.asarray(q, dtype=np.float64), np.asarray(r, dtype=np.float64)
        log_total = np.logaddexp(0.0, self.log_ratios + math.log(self.step))  # ln(1 + cλ)
        level = np.stack([self.chi2 * np.exp(log_total), self.logdet - self.m * log_total], axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            wanted = np.clip(np.log(q) - np.log(r), self.log_ratios[0], self.log_ratios[-1])
            chi2, logdet = np.moveaxis(CubicSpline(self.log_ratios, level)(wanted), -1, 0)
            total = self.step * q + r
            return -0.5 * (self.m * (math.log(2.0 * math.pi) + np.log(total)) + logdet + chi2 / total)


def walk_profile(z: ArrayLike, log_ratios: ArrayLike | None = None, dt: ArrayLike | None = None) -> Profile:
    """`likelihood_profile` without momentum."""
    data, grid = profile_input(z, log_ratios, dt)
    chi2, logdet = data.sums(np.exp(grid))
    return profile_of(data, grid, chi2, logdet)


def profile_input(
    z: ArrayLike, log_ratios: ArrayLike | None, dt: ArrayLike | None, default: Array = DEFAULT_LOG_RATIOS
) -> tuple[Differences, Array]:
    """The record and the ln λ of a profile, checked as `likelihood_profile` says."""
    samples, steps = one_record(z, dt)
    grid = default if log_ratios is None else np.asarray(log_ratios, dtype=np.float64)
    if grid.ndim != 1 or len(grid) < 2 or not np.all(np.diff(grid) > 0) or not np.abs(grid).max() <= MAX_LOG_RATIO:
        raise BadSetting(f"log_ratios must be two or more ascending numbers within ±300 (got {log_ratios})")
    data = differences(samples, steps)
    if data.m < 1:
        raise BadSetting("z must hold at least two finite samples (got fewer)")
    return data, grid


def profile_of(data: Differences, grid: Array, chi2: Array, logdet: Array, step: float = 1.0) -> Profile:
    """The profile of Σv²/f (in scale²) and Σln f at each ln λ, r = 1."""
    loglik = data.from_sums(chi2, logdet)
    with np.errstate(over="ignore", under="ignore"):
        chi2 = chi2 * data.scale * data.scale
    return Profile(grid, loglik, chi2 / data.m, chi2, logdet, data.m, step)


def loglik_map(profile: Profile, log_q: ArrayLike, log_r: ArrayLike) -> Array:
    """Log-likelihood over a grid of ln q and ln r (unit²), shape (len(log_r), len(log_q)), from one profile."""
    q, r = np.exp(np.asarray(log_q, dtype=np.float64)), np.exp(np.asarray(log_r, dtype=np.float64))
    return profile.loglik_at(q[None, :], r[:, None])


def log_likelihood(z: ArrayLike, params: FilterParams, dt: ArrayLike | None = None) -> float | Array:
    """Log-likelihood of a record under given parameters (p0, x0 and gate included).

    Args:
        z: measurements, shape (n,) or (n, channels: independent filters); NaN is a missing sample.
        params: q, r, p0, x0, gate, scalars or (channels,) arrays.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.

    Returns:
        The sum over the scored innovations, a float, or shape (channels,) for 2-D z.

    Raises:
        BadSetting: as `kalman_filter`.
    """
    return kalman_filter(z, params, dt).loglik
