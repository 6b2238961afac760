"""Maximum likelihood of q and r, or of q alone, where the momentum is given: one search, as without momentum."""

from __future__ import annotations

import math

import numpy as np

from kalscope.common.array import Array
from kalscope.common.progress import Progress
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.likelihood.search import Peak, find_peak, grid_for
from kalscope.estimation.momentum.fit import MomentumFit
from kalscope.estimation.momentum.likelihood import concentrated, moving_sums, pairs, ratio_of, step_variance

_DERIVATIVE_STEP = 1e-3
"""Step in ln(step variance / r) for the slope of the scale, which only feeds standard errors."""


def fit_at(data: Differences, tau: float, progress: Progress) -> MomentumFit:
    """The best q and r of one τ > 0."""

    def loglik(log_moves: Array) -> Array:
        return concentrated(data, log_moves, np.full(len(log_moves), tau))[0]

    at_infinity = float(loglik(np.array([math.inf]))[0])
    peak = find_peak(loglik, grid_for(data.m), at_infinity, progress)
    near = peak.log_ratio + _DERIVATIVE_STEP * np.array([0.0, -1.0, 1.0])
    q, r = pairs(near, np.full(3, tau))
    unit = concentrated(data, near, np.full(3, tau))[1] * data.scale * data.scale
    q, r = q * unit, r * unit
    errors = [_relative_error(value, peak, data.m) for value in (q, r)]
    low, high = (ratio_of(end, tau) for end in peak.interval)
    return MomentumFit(
        q=float(q[0]),
        r=float(r[0]),
        tau=tau,
        loglik=peak.loglik,
        q_se=float(q[0]) * errors[0] if q[0] > 0.0 else math.inf,
        r_se=float(r[0]) * errors[1] if r[0] > 0.0 else math.inf,
        tau_interval=(tau, tau),
        region=((low, tau), (high, tau)),
    )


def fit_movement(data: Differences, tau: float, r: float, progress: Progress) -> MomentumFit:
    """The best q of one τ > 0 where r, unit², is known."""
    scaled = r / data.scale / data.scale
    constant = data.m * (math.log(2.0 * math.pi) + 2.0 * math.log(data.scale))

    def loglik(log_moves: Array) -> Array:
        q, size = np.exp(log_moves) * scaled / step_variance(tau), len(log_moves)
        chi2, logdet = moving_sums(data, q, np.full(size, scaled), np.full(size, tau))
        return -0.5 * (constant + logdet + chi2)

    # a step can hardly vary by more than the largest squared difference (at most 1 in this scale)
    peak = find_peak(loglik, grid_for(data.m, max(24.0, 4.0 - math.log(scaled))), -math.inf, progress)
    low, high = (ratio_of(end, tau) for end in peak.interval)
    q = ratio_of(peak.log_ratio, tau) * r
    return MomentumFit(
        q=q,
        r=r,
        tau=tau,
        loglik=peak.loglik,
        q_se=q / math.sqrt(-peak.curvature) if peak.curvature < 0.0 else math.inf,
        r_se=0.0,
        tau_interval=(tau, tau),
        region=((low, tau), (high, tau)),
    )


def _relative_error(near: Array, peak: Peak, m: int) -> float:
    """Standard error of ln of a variance, known at the peak and beside it; see `maximum_likelihood.fit`."""
    if not math.isfinite(peak.log_ratio):
        return math.sqrt(2.0 / m)
    if not peak.curvature < 0.0:
        return math.inf
    slope = float(np.log(near[2] / near[1])) / (2.0 * _DERIVATIVE_STEP)
    return math.sqrt(2.0 / m - slope * slope / peak.curvature)
