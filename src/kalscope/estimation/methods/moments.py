"""Moments of the differences: a quick estimate without a filter.

Δz has variance γ₀ = q + 2r, neighbours have covariance γ₁ = −r, and nothing is left further apart, so
r = −γ₁ and q = γ₀ + 2γ₁. Where γ₁ > 0, or more is left two samples apart, the model does not hold.
"""

from __future__ import annotations

import math

import numpy as np

from kalscope.common.text import correlation
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.methods.kernels import lagged_products
from kalscope.estimation.methods.pair import Pair


def fit(data: Differences) -> Pair:
    """The pair from γ₀ and γ₁, negative values set to 0; standard errors by Bartlett's formula."""
    m = data.m
    gap = float(np.mean(data.gap)) if len(data.gap) else 1.0
    g0, g1, _ = _products(data)
    var0, var1, cov = 2.0 * (g0**2 + 2.0 * g1**2) / m, (g0**2 + 3.0 * g1**2) / m, 4.0 * g0 * g1 / m
    r, q = -g1, (g0 + 2.0 * g1) / gap if gap > 0.0 else 0.0
    r_se, q_se = math.sqrt(var1), math.sqrt(max(var0 + 4.0 * var1 + 4.0 * cov, 0.0)) / max(gap, 1e-150)
    note = what_differences_say(data)
    if r <= 0.0:
        return Pair(g0 / gap if gap > 0.0 else 0.0, 0.0, q_se, r_se, note=note)
    if q <= 0.0:
        return Pair(0.0, g0 / 2.0, q_se, r_se, note=note)
    return Pair(q, r, q_se, r_se, note=note)


def what_differences_say(data: Differences) -> str:
    """How the differences of neighbouring samples contradict the model; "" where they do not."""
    m = data.m
    g0, g1, g2 = _products(data)
    if m < 20 or g0 == 0.0:
        return ""
    r1, r2 = g1 / g0, g2 / g0
    if r1 > 3.0 / math.sqrt(m):
        return (
            f"Successive changes have the same sign (correlation {correlation(r1)}; a random walk plus noise has 0 "
            "or less): the signal moves smoothly, or the sensor already smooths it."
        )
    if r1 < -0.5 - 3.0 / math.sqrt(m):
        return f"Successive changes alternate (correlation {correlation(r1)}, below −0.5): an oscillation or hum."
    if abs(r2) > 4.0 * math.sqrt((1.0 + 2.0 * r1**2) / m) + 0.02:
        return (
            f"Changes two samples apart are correlated ({correlation(r2)}): a trend, an oscillation or slow noise."
        )
    return ""


def _products(data: Differences) -> list[float]:
    """Mean products of differences 0, 1 and 2 apart, scale²."""
    sums = np.zeros(3)
    lagged_products(data.d, sums)
    return (sums / (data.m - np.arange(3.0))).tolist()
