"""The likelihood of q, r and τ, the scale concentrated out: over ln of the step variance by r, and over ln τ.

As in `likelihood.profile` the first sample sets the exact diffuse start and is not scored, so the values compare
with those of the random walk. The pair is measured by the variance of one step of the signal over that of the
noise: on that scale the likelihood of every τ has its maximum near the same place, where q/r would run away as τ².
"""

from __future__ import annotations

import math

import numpy as np

from kalscope.common.array import Array
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.momentum import kernels
from kalscope.filtering.kernels import transition


def moving_sums(data: Differences, q: Array, r: Array, tau: Array) -> tuple[Array, Array]:
    """Σv²/s (in scale²) and Σln s for each triple, shape (k,); those of one τ should be adjacent."""
    k = len(q)
    q, r, tau = (np.concatenate([part, np.full(-k % kernels.LANES, part[-1])]) for part in (q, r, tau))
    chi2, logdet = np.empty_like(q), np.empty_like(q)
    kernels.scan_lanes(data.d, data.gap, q, r, tau, chi2, logdet)
    return chi2[:k], logdet[:k]


def concentrated(data: Differences, log_moves: Array, tau: Array) -> tuple[Array, Array]:
    """Log-likelihood of each ln(variance of one step / r), ∓inf allowed, and its best scale, in scale²."""
    chi2, logdet = moving_sums(data, *pairs(log_moves, tau), tau)
    loglik = data.from_sums(chi2, logdet)
    # Without noise two samples at one instant, s = 0, contradict each other.
    return np.where(np.isnan(loglik), -math.inf, loglik), chi2 / data.m


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
