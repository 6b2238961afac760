"""Maximum likelihood with the exact diffuse start and the scale concentrated out: one search over ln λ.

Durbin & Koopman (2012), section 2.10. Nothing in it depends on the unit of the signal.
"""

from __future__ import annotations

import math

import numpy as np

from kalscope.common.progress import Progress
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.likelihood.search import Peak, find_peak, find_top_near, grid_for
from kalscope.estimation.methods.pair import Pair

_DERIVATIVE_STEP = 1e-3
"""Step in ln λ for the slope of ln r̂(λ), which only feeds standard errors."""


def search(data: Differences, progress: Progress) -> Peak:
    """The peak of the concentrated likelihood over λ, with its 95 % interval."""
    return find_peak(data.concentrated, grid_for(data.m), data.random_walk()[0], progress)


def fit_near(data: Differences, ratio: float, progress: Progress) -> Pair:
    """The pair of a record whose λ is probably near `ratio`: searched there first."""
    peak = find_top_near(data.concentrated, math.log(ratio)) if 0.0 < ratio < math.inf else None
    return fit(data, peak or search(data, progress))


def fit(data: Differences, peak: Peak) -> Pair:
    """The pair at the peak, and their standard errors from the observed information in (ln r, ln λ).

    There var(ln λ) = −1/ℓ″, and r given λ has var(ln r) = 2/m (m squared innovations), while the best r moves
    with λ by the slope b: var(ln r) = 2/m + b² var(ln λ), var(ln q) = 2/m + (1 + b)² var(ln λ).
    """
    spread = 2.0 / data.m
    if peak.log_ratio == math.inf:
        q = data.random_walk()[1]
        return Pair(q, 0.0, q * math.sqrt(spread), math.inf)
    near = peak.log_ratio + _DERIVATIVE_STEP * np.array([0.0, -1.0, 1.0])
    chi2 = data.sums(np.exp(near))[0]
    r = float(chi2[0]) / data.m
    if peak.log_ratio == -math.inf:
        return Pair(0.0, r, math.inf, r * math.sqrt(spread))
    variance = -1.0 / peak.curvature if peak.curvature < 0.0 else math.inf
    slope = float(np.log(chi2[2] / chi2[1])) / (2.0 * _DERIVATIVE_STEP)
    q = math.exp(peak.log_ratio) * r
    return Pair(
        q, r, q * math.sqrt(spread + (1.0 + slope) ** 2 * variance), r * math.sqrt(spread + slope**2 * variance)
    )
