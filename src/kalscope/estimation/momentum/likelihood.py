"""The likelihood of q, r and τ, the scale concentrated out: over ln of the step variance by r, and over ln τ.

As in `likelihood.profile` the first sample sets the exact diffuse start and is not scored, so the values compare
with those of the random walk. The pair is measured by the variance of one step of the signal over that of the
noise: on that scale the likelihood of every τ has its maximum near the same place, where q/r would run away as τ².
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.momentum import kernels
from kalscope.filtering.kernels import transition


@dataclass(frozen=True)
class Samples:
    """One channel as input of the likelihood with momentum."""

    z: Array
    """Finite samples less the first one, divided by `scale`, shape (m + 1,)."""
    gap: Array
    """Nominal sample periods before each but the first, shape (m,); empty = 1 each."""
    scale: float
    """A power of two, unit: dividing by it costs no digit."""

    @property
    def m(self) -> int:
        """Scored innovations."""
        return len(self.z) - 1

    @staticmethod
    def of(data: Differences) -> Samples:
        """The samples whose differences are known."""
        return Samples(np.concatenate([[0.0], np.cumsum(data.d)]), data.gap, data.scale)

    @property
    def span(self) -> float:
        """Sample periods from the first sample to the last."""
        return float(self.gap.sum()) if len(self.gap) else float(self.m)

    def without(self, first: int, stop: int) -> Samples:
        """The record with the samples from `first` to before `stop` missing."""
        kept = np.r_[0:first, stop : len(self.z)]
        times = np.arange(len(self.z), dtype=np.float64)
        if len(self.gap):
            times[1:] = np.cumsum(self.gap)
        gap = np.diff(times[kept])
        return Samples(self.z[kept] - self.z[kept[0]], np.empty(0) if np.all(gap == 1.0) else gap, self.scale)

    def differences(self) -> Differences:
        """The same record as the likelihood without momentum takes it."""
        return Differences(np.diff(self.z), self.gap, self.scale)

    def sums(self, q: Array, r: Array, tau: Array) -> tuple[Array, Array]:
        """Σv²/s (in scale²) and Σln s for each triple, shape (k,); those of one τ should be adjacent."""
        k = len(q)
        q, r, tau = (np.concatenate([part, np.full(-k % kernels.LANES, part[-1])]) for part in (q, r, tau))
        chi2, logdet = np.empty_like(q), np.empty_like(q)
        kernels.scan_lanes(self.z, self.gap, q, r, tau, chi2, logdet)
        return chi2[:k], logdet[:k]

    def concentrated(self, log_moves: Array, tau: Array) -> tuple[Array, Array]:
        """Log-likelihood of each ln(variance of one step / r), ∓inf allowed, and its best scale, in scale²."""
        chi2, logdet = self.sums(*pairs(log_moves, tau), tau)
        unit = chi2 / self.m
        with np.errstate(divide="ignore"):
            log_unit = np.log(unit) + 2.0 * math.log(self.scale)
        loglik = -0.5 * (self.m * (math.log(2.0 * math.pi) + 1.0 + log_unit) + logdet)
        # Without noise two samples at one instant, s = 0, contradict each other.
        return np.where(np.isnan(loglik), -math.inf, loglik), unit


def pairs(log_moves: Array, tau: Array) -> tuple[Array, Array]:
    """Q and r up to their scale, for each ln(variance of one step / r); exact at ∓inf."""
    with np.errstate(over="ignore"):
        return 1.0 / (1.0 + np.exp(-log_moves)) / step_variances(tau), 1.0 / (1.0 + np.exp(log_moves))


def ratio_of(log_moves: float, tau: float) -> float:
    """q/r of ln(variance of one step / r), 0 … inf."""
    return math.exp(log_moves) / step_variance(tau) if log_moves < 700.0 else math.inf


def step_variances(tau: Array) -> Array:
    """Variance of one step of the signal for q = 1, shape of `tau`."""
    values = tau.tolist()
    known = {value: step_variance(value) for value in set(values)}  # many lanes have one τ
    return np.array([known[value] for value in values])


def step_variance(tau: float) -> float:
    """Variance of one step of the signal for q = 1."""
    _, f, a, _, _ = transition(1.0, 1.0, tau)
    return float(a + 0.5 * f * f / tau)
