"""ALS: the autocovariances of a running filter's innovations, solved for q and r by least squares.

With any fixed gain L the prediction error has variance P = (q + L²r)/(1 − (1 − L)²), and the innovations have
C₀ = P + r and C_j = (1 − L)^(j−1) [(1 − L)P − L r]: linear in q and r. All C_j vanish where L is the best gain.
Mehra (1970), IEEE Trans. Automatic Control 15(2); least squares after Odelson, Rajamani & Rawlings (2006).
"""

from __future__ import annotations

import math

import numpy as np

from kalscope.common.array import Array
from kalscope.estimation.likelihood.profile import Differences
from kalscope.estimation.methods.kernels import fixed_gain_innovations, lagged_products
from kalscope.estimation.methods.pair import Pair

TOO_SHORT = "This method needs a longer stretch of regular samples without gaps than this record has."

_NOTHING = 1e-12
"""A variance this much smaller than the other is a rounded 0."""

_ROUNDS = 5
_GAINS = 0.02, 0.95
"""Range of the fixed gain: below it forgets too slowly, above it is insensitive to r."""


def fit(data: Differences) -> Pair:
    """The pair from the innovations' autocovariances; the filter is re-tuned a few times."""
    gain, pair = 0.3, None
    for _ in range(_ROUNDS):
        lags = max(4, math.ceil(3.0 / gain))
        innovations = np.empty(data.m)
        fixed_gain_innovations(data.d, data.gap, gain, lags + 1, innovations)
        present = int(np.isfinite(innovations).sum())
        if present < 3 * lags + 10:
            break
        pair = solve(_design(gain, lags), *_autocovariances(innovations, lags))
        gain = min(max(_gain(pair.q, pair.r), _GAINS[0]), _GAINS[1])
    if pair is None or pair.q == pair.r:  # no innovations, or only zeros: all changes are across gaps
        return Pair(0.0, 0.0, math.inf, math.inf, verdict="too_few", text=TOO_SHORT)
    return pair


def _design(gain: float, lags: int) -> Array:
    """Rows C₀ … C_lags, columns q and r."""
    kept = 1.0 - gain
    per_q = 1.0 / (1.0 - kept * kept)
    per_r = gain * gain * per_q
    decay = kept ** np.arange(lags)
    later = np.outer(decay, [kept * per_q, kept * per_r - gain])
    return np.vstack([[per_q, per_r + 1.0], later])


def _autocovariances(innovations: Array, lags: int) -> tuple[Array, Array]:
    """C₀ … C_lags over the pairs that are both present, and their standard errors where v is nearly white."""
    present = np.isfinite(innovations)
    v, there = np.where(present, innovations, 0.0), present.astype(np.float64)
    pairs, c = np.empty(lags + 1), np.empty(lags + 1)
    lagged_products(there, pairs)
    lagged_products(v, c)
    pairs = pairs.clip(1.0)
    c /= pairs
    return c, max(c[0], 1e-100) * np.sqrt(np.where(np.arange(lags + 1) == 0, 2.0, 1.0) / pairs)


def solve(design: Array, seen: Array, errors: Array) -> Pair:
    """Weighted least squares for q, r ≥ 0, with the standard errors that the weights imply."""
    weighted = design / errors[:, None]
    q, r = not_negative(weighted, seen / errors)
    covariance = np.linalg.pinv(weighted.T @ weighted)
    q_se, r_se = np.sqrt(np.diag(covariance))
    q, r = (float(q) if q > _NOTHING * r else 0.0), (float(r) if r > _NOTHING * q else 0.0)
    return Pair(q, r, float(q_se), float(r_se))


def not_negative(a: Array, b: Array) -> tuple[float, float]:
    """The pair x ≥ 0 with the least ‖a x − b‖, a of shape (m, 2).

    What is minimised is convex: where the pair without bounds has a negative part, the best one has a part of 0.
    """
    free = np.linalg.lstsq(a, b, rcond=None)[0]
    if free.min() >= 0.0:
        return float(free[0]), float(free[1])
    squares, products = np.sum(a * a, axis=0), a.T @ b
    alone = np.divide(products, squares, out=np.zeros(2), where=squares > 0.0).clip(0.0)
    gained = alone * products  # what each takes off ‖b‖²
    return (float(alone[0]), 0.0) if gained[0] >= gained[1] else (0.0, float(alone[1]))


def _gain(q: float, r: float) -> float:
    if q <= 0.0:
        return 0.0
    return 2.0 / (1.0 + math.sqrt(1.0 + 4.0 * r / q))
