"""The compiled loops of the likelihood of several sensors of one quantity, nothing else.

A record is a list of readings: the value, which sensor it comes from, and the periods since the reading before it,
0 within a row. Reading j of sensor i is b_i + c_i x plus noise of variance r_i; x moves as in `filtering.momentum`,
for τ = 0 as a random walk. Each reading is one scalar update; the first one sets the exact diffuse start and is
not scored. Source: Durbin & Koopman (2012), section 6.4; the scores: Koopman & Shephard (1992), Biometrika 79, 823.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.filtering.kernels import transition

Array = NDArray[np.float64]
Whole = NDArray[np.int64]
Transition = tuple[float, float, float, float, float]

FULL = 1e100
"""A product of variances beyond this, or below its inverse, is turned into its logarithm."""

TAU_STEP = 1e-4
"""Relative step in τ for the derivatives of the transition."""

# What `filter_readings` keeps of each reading: its innovation over the variance s of it, s, the gains of position
# and velocity, and the state after it with its variances.
ERROR, S, KX, KV, X, V, P, G, W = 0, 1, 2, 3, 4, 5, 6, 7, 8
KEPT = 9


@compiled(inline="always")
def over_gap(gap: float, q: float, tau: float) -> Transition:
    """What `gap` periods do to the state: e, f, a, b, c of `filtering.momentum`."""
    return transition(gap, q, tau) if tau > 0.0 else (0.0, 0.0, q * gap, 0.0, 0.0)


@compiled(error_model="numpy")
def offset_equations(
    value: Array, sensor: Whole, gap: Array, q: float, tau: float, r: Array, c: Array, matrix: Array, right: Array
) -> None:
    """Add up `matrix` and `right` of the normal equations, matrix b = right, of the most likely offsets b.

    The innovations are linear in b: v = v(0) + Σ d_l b_l. The filters of v(0) and of the d_l share their gains.
    """
    count, sensors = value.shape[0], r.shape[0]
    place, speed, d = np.zeros(sensors), np.zeros(sensors), np.zeros(sensors)
    i = int(sensor[0])
    x, v, p, g = value[0] / c[i], 0.0, r[i] / (c[i] * c[i]), 0.0
    w = 0.5 * q / tau if tau > 0.0 else 0.0
    place[i] = -1.0 / c[i]
    last = 1.0
    e, f, a, b, grown = over_gap(last, q, tau)
    for j in range(1, count):
        if gap[j] > 0.0:
            if gap[j] != last:
                last = gap[j]
                e, f, a, b, grown = over_gap(last, q, tau)
            if tau > 0.0:
                x, v = x + f * v, e * v
                p, g, w = p + f * (2.0 * g + f * w) + a, e * (g + f * w) + b, e * e * w + grown
                for k in range(sensors):
                    place[k] += f * speed[k]
                    speed[k] *= e
            else:
                p += a
        i = int(sensor[j])
        s = c[i] * c[i] * p + r[i]
        part = 1.0 / s
        kx, kv = c[i] * p * part, c[i] * g * part
        innovation = value[j] - c[i] * x
        x, v = x + kx * innovation, v + kv * innovation
        for k in range(sensors):
            d[k] = -c[i] * place[k]
        d[i] -= 1.0
        for k in range(sensors):
            right[k] -= d[k] * innovation * part
            for m in range(k + 1):
                matrix[k, m] += d[k] * d[m] * part
            place[k] += kx * d[k]
            speed[k] += kv * d[k]
        w -= kv * c[i] * g
        p, g = p * r[i] * part, g * r[i] * part
    for k in range(sensors):
        for m in range(k):
            matrix[m, k] = matrix[k, m]


@compiled(error_model="numpy")
def filter_readings(
    value: Array,
    sensor: Whole,
    gap: Array,
    q: float,
    tau: float,
    r: Array,
    c: Array,
    offset: Array,
    kept: Array,
) -> tuple[float, float]:
    """Filter the readings, keep what the scores need in `kept`, (readings, KEPT); returns Σ v²/s and Σ ln s."""
    count = value.shape[0]
    i = int(sensor[0])
    x, v, p, g = (value[0] - offset[i]) / c[i], 0.0, r[i] / (c[i] * c[i]), 0.0
    w = 0.5 * q / tau if tau > 0.0 else 0.0
    keep(kept, 0, 0.0, math.inf, (0.0, 0.0), (x, v, p, g, w))
    chi2, logdet, product, last = 0.0, 0.0, 1.0, 1.0
    e, f, a, b, grown = over_gap(last, q, tau)
    for j in range(1, count):
        if gap[j] > 0.0:
            if gap[j] != last:
                last = gap[j]
                e, f, a, b, grown = over_gap(last, q, tau)
            if tau > 0.0:
                x, v = x + f * v, e * v
                p, g, w = p + f * (2.0 * g + f * w) + a, e * (g + f * w) + b, e * e * w + grown
            else:
                p += a
        i = int(sensor[j])
        s = c[i] * c[i] * p + r[i]
        part = 1.0 / s
        kx, kv = c[i] * p * part, c[i] * g * part
        innovation = value[j] - offset[i] - c[i] * x
        x, v = x + kx * innovation, v + kv * innovation
        w -= kv * c[i] * g
        p, g = p * r[i] * part, g * r[i] * part
        chi2 += innovation * innovation * part
        product *= s
        if not 1.0 / FULL < product < FULL:
            logdet += math.log(product)
            product = 1.0
        keep(kept, j, innovation * part, s, (kx, kv), (x, v, p, g, w))
    return chi2, logdet + math.log(product)


@compiled(inline="always")
def keep(
    kept: Array,
    j: int,
    error: float,
    s: float,
    gains: tuple[float, float],
    state: tuple[float, float, float, float, float],
) -> None:
    """Write one row of `kept`."""
    kept[j, ERROR], kept[j, S], kept[j, KX], kept[j, KV] = error, s, gains[0], gains[1]
    kept[j, X], kept[j, V], kept[j, P], kept[j, G], kept[j, W] = state


@compiled(error_model="numpy")
def score_readings(
    value: Array,
    sensor: Whole,
    gap: Array,
    q: float,
    tau: float,
    r: Array,
    c: Array,
    offset: Array,
    kept: Array,
    by_r: Array,
    by_c: Array,
) -> tuple[float, float]:
    """Derivatives of the log-likelihood by q and τ, and by r and c of each sensor (into `by_r` and `by_c`).

    Backwards over what `filter_readings` kept: (y, u) is the score of the state, n its information.
    """
    by_q = by_tau = y = speed = n11 = n12 = n22 = 0.0
    last = 1.0
    over, change = over_gap(last, 1.0, tau), change_with_tau(last, tau)
    for j in range(value.shape[0] - 1, 0, -1):
        i = int(sensor[j])
        part, kx, kv, p, g = 1.0 / kept[j, S], kept[j, KX], kept[j, KV], kept[j, P], kept[j, G]
        u = kept[j, ERROR] - kx * y - kv * speed
        by_r[i] += 0.5 * (u * u - part - kx * kx * n11 - 2.0 * kx * kv * n12 - kv * kv * n22)
        smoothed = kept[j, X] + p * y + g * speed
        by_c[i] += u * smoothed - kx + kx * (n11 * p + n12 * g) + kv * (n12 * p + n22 * g)
        y += c[i] * u
        left, turned = 1.0 - kx * c[i], kv * c[i]
        n11 = left * left * n11 - 2.0 * left * turned * n12 + turned * turned * n22 + c[i] * c[i] * part
        n12 = left * n12 - turned * n22
        if not gap[j] > 0.0:
            continue
        if gap[j] != last:
            last = gap[j]
            over, change = over_gap(last, 1.0, tau), change_with_tau(last, tau)
        e, f, a, b, grown = over
        yy, yu, uu = y * y - n11, y * speed - n12, speed * speed - n22
        by_q += 0.5 * (a * yy + 2.0 * b * yu + grown * uu)
        if tau > 0.0:
            de, df, da, db, dc = change
            by_tau += 0.5 * q * (da * yy + 2.0 * db * yu + dc * uu)
            g, w = kept[j - 1, G], kept[j - 1, W]
            ahead = kept[j - 1, V] + g * y + w * (f * y + e * speed)
            by_tau += df * (y * ahead - n11 * (g + f * w) - n12 * e * w)
            by_tau += de * (speed * ahead - n12 * (g + f * w) - n22 * e * w)
        speed = f * y + e * speed
        n22 = f * f * n11 + 2.0 * f * e * n12 + e * e * n22
        n12 = f * n11 + e * n12
    i = int(sensor[0])
    by_r[i] += 0.5 * (y * y - n11) / (c[i] * c[i])
    by_c[i] -= y * (value[0] - offset[i]) / (c[i] * c[i]) + (y * y - n11) * r[i] / (c[i] * c[i] * c[i])
    if tau > 0.0:
        by_q += 0.25 * (speed * speed - n22) / tau
        by_tau -= 0.25 * (speed * speed - n22) * q / (tau * tau)
    return by_q, by_tau


@compiled()
def change_with_tau(gap: float, tau: float) -> Transition:
    """Derivatives of the transition for q = 1 by τ; 0 without momentum."""
    if not tau > 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    h = TAU_STEP * tau
    more, less = transition(gap, 1.0, tau + h), transition(gap, 1.0, tau - h)
    half = 0.5 / h
    return (
        half * (more[0] - less[0]),
        half * (more[1] - less[1]),
        half * (more[2] - less[2]),
        half * (more[3] - less[3]),
        half * (more[4] - less[4]),
    )
