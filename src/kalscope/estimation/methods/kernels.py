"""The compiled loops of the compared estimators, nothing else: EM's pass, and innovations under a fixed gain."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled

Array = NDArray[np.float64]


@compiled(error_model="numpy")
def em_pass(z: Array, gap: Array, q: float, r: float, x: Array, p: Array) -> tuple[float, float, float]:
    """One EM step from q, r > 0: filter forward, smooth backward, new variances. Works in `x` and `p`.

    `z` holds the finite samples, `gap[i]` the periods from z[i] to z[i + 1] (empty: 1 each). Returns the new q,
    the new r, and the log-likelihood of the old pair. Shumway & Stoffer (1982), with the exact diffuse start.
    """
    n, regular = z.shape[0], gap.shape[0] == 0
    x[0], p[0] = z[0], r
    chi2 = logdet = 0.0
    for i in range(1, n):
        predicted = p[i - 1] + q * (1.0 if regular else gap[i - 1])
        f = predicted + r
        v = z[i] - x[i - 1]
        chi2 += v * v / f
        logdet += math.log(f)
        x[i] = x[i - 1] + predicted / f * v
        p[i] = predicted * (r / f)
    xs, vs = x[n - 1], p[n - 1]  # smoothed mean and variance of the sample after
    noise, movement, moves = (z[n - 1] - xs) ** 2 + vs, 0.0, 0
    for i in range(n - 2, -1, -1):
        g = 1.0 if regular else gap[i]
        j = p[i] / (p[i] + q * g)
        x_here = x[i] + j * (xs - x[i])
        v_here = p[i] + j * j * (vs - p[i] - q * g)
        if g > 0.0:
            # V(i) + V(i+1) − 2 J V(i+1), written without its cancellation
            both = (1.0 - j) ** 2 * vs + j * q * g
            movement += ((xs - x_here) ** 2 + both) / g
            moves += 1
        noise += (z[i] - x_here) ** 2 + v_here
        xs, vs = x_here, v_here
    loglik = -0.5 * ((n - 1) * math.log(2.0 * math.pi) + logdet + chi2)
    return movement / max(moves, 1), noise / n, loglik


@compiled(fastmath={"contract", "reassoc"})
def lagged_products(v: Array, sums: Array) -> None:
    """Σ v(i) v(i + j) into `sums[j]`; numpy's dot would start threads for it, which wait for each other."""
    for j in range(sums.shape[0]):
        total = 0.0
        for i in range(v.shape[0] - j):
            total += v[i] * v[i + j]
        sums[j] = total


@compiled()
def fixed_gain_innovations(d: Array, gap: Array, gain: float, warm_up: int, out: Array) -> None:
    """Innovations v' = d + (1 − gain) v of the filter with a fixed gain; NaN for `warm_up` samples after a gap."""
    v, left = 0.0, warm_up
    for i in range(d.shape[0]):
        if gap.shape[0] > 0 and gap[i] != 1.0:
            v, left = 0.0, warm_up
            out[i] = math.nan
            continue
        v = d[i] + (1.0 - gain) * v
        out[i] = math.nan if left > 0 else v
        left -= 1
