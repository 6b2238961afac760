"""The compiled loops of the filter with momentum, nothing else: one channel, contiguous float64, no checks.

The model: z = x + noise of variance r, dx = v dt, and v is an Ornstein-Uhlenbeck process of time constant τ whose
position gains the variance q per sample in the long run: v has the stationary variance q/(2τ). Over a step Δ

    F = [[1, f], [0, e]],  e = exp(-Δ/τ),  f = τ(1 - e),  Q = [[a, b], [b, c]]

(the continuous-time correlated random walk: Johnson et al. 2008, Ecology 89(5), equations 5 and 6; Singer 1970 is
one derivative higher). The variances of x and v are p and w, their covariance is g. Time counts in nominal sample
periods and velocity in units per period.

`step` is the only place where the update is written; every driver below calls it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.filtering.kernels import GATE_LIMIT, MISSING, REJECTED, START, UPDATED

Array = NDArray[np.float64]

SERIES_BELOW = 0.1
"""Steps shorter than this many τ take the series of `transition`: the closed form loses digits like (τ/Δ)²."""

BLOCK = 8
"""Samples that the settled filter advances at once."""

CHUNK = 256
"""Samples, a multiple of BLOCK, that the settled filter advances before it looks for a missing one."""

SETTLED_WITHIN = 4e-16
"""Relative change of the variances per sample below which the gains count as settled."""

Transition = tuple[float, float, float, float, float]
State = tuple[float, float, float, float, float]
Gains = tuple[float, float]


@compiled()
def transition(dt: float, q: float, tau: float) -> Transition:
    """e, f, a, b, c over `dt` periods, tau > 0."""
    h = dt / tau
    u = -math.expm1(-h)  # 1 - e
    if h < SERIES_BELOW:
        # h - 2(1 - e) + (1 - e²)/2 = Σ (-1)^(n+1) (2^(n-1) - 2) hⁿ/n! from n = 3
        a = -510.0 / 3628800.0
        a = 254.0 / 362880.0 + a * h
        a = -126.0 / 40320.0 + a * h
        a = 62.0 / 5040.0 + a * h
        a = -30.0 / 720.0 + a * h
        a = 7.0 / 60.0 + a * h
        a = -0.25 + a * h
        a = h * h * h * (1.0 / 3.0 + a * h)
    else:
        a = h - 2.0 * u - 0.5 * math.expm1(-2.0 * h)
    return math.exp(-h), tau * u, q * tau * a, 0.5 * q * u * u, -0.5 * q / tau * math.expm1(-2.0 * h)


@compiled(inline="always")
def predict(over: Transition, state: State) -> State:
    """The state one step later."""
    e, f, a, b, c = over
    x, v, p, g, w = state
    return x + f * v, e * v, p + f * (2.0 * g + f * w) + a, e * (g + f * w) + b, e * e * w + c


@compiled(inline="always")
def step(
    z: float, over: Transition, r: float, gate: float, state: State, rejected: int
) -> tuple[State, float, float, float, int]:
    """One sample: predict, then update; `rejected` counts gate rejections in a row.

    Returns the state, k, the innovation, its variance s and what was done, as the `step` of the five lines does. An
    infinite p is the exact diffuse start: the limit p → ∞, in which v keeps its stationary distribution.
    """
    x, v, p, g, w = predict(over, state)
    s = p + r
    if math.isnan(z):
        return (x, v, p, g, w), 0.0, math.nan, s, MISSING
    if math.isinf(p):
        return (z, 0.0, r, 0.0, w), 1.0, math.nan, math.inf, START
    innovation = 0.0 if math.isnan(x) else z - x
    if s == 0.0:  # estimate and sample both claim to be exact
        return (z if math.isnan(x) else x, v, p, g, w), 0.0, innovation, s, START if math.isnan(x) else MISSING
    k, ell = p / s, g / s
    kept = k * r, ell * r, w - ell * g
    if math.isnan(x):  # p0 is given, x0 is this first sample
        return (z, 0.0, kept[0], kept[1], kept[2]), k, math.nan, s, START
    if innovation * innovation > gate * s and rejected < GATE_LIMIT:
        return (x, v, p, g, w), 0.0, innovation, s, REJECTED
    return (x + k * innovation, v + ell * innovation, kept[0], kept[1], kept[2]), k, innovation, s, UPDATED


@compiled()
def filter_channel(
    z: Array,
    dt: Array,
    q: float,
    r: float,
    tau: float,
    gate: float,
    state: State,
    in_a_row: int,
    out: tuple[Array, Array, Array, Array, Array, Array, Array],
) -> tuple[State, float, int, int, int]:
    """Filter one channel into `out` = (x, p, k, innovation, s, v, w); `dt` empty means regular sampling.

    Returns the last state, the log-likelihood over the m scored innovations, m, the gate rejections, and those
    right at the end.
    """
    n, regular = z.shape[0], dt.shape[0] == 0
    last = 1.0
    over = transition(last, q, tau)
    chi2 = logdet = 0.0
    m = refused = 0
    for i in range(n):
        if not regular and dt[i] != last:
            last = dt[i]
            over = transition(last, q, tau)
        state, k, innovation, s, done = step(z[i], over, r, gate, state, in_a_row)
        out[0][i], out[1][i], out[2][i], out[3][i], out[4][i] = state[0], state[2], k, innovation, s
        out[5][i], out[6][i] = state[1], state[4]
        if done == UPDATED:
            m += 1
            chi2 += innovation / s * innovation
            logdet += math.log(s)
        if done == REJECTED:
            refused += 1
        in_a_row = in_a_row + 1 if done == REJECTED else (in_a_row if done == MISSING else 0)
    return state, -0.5 * (m * math.log(2.0 * math.pi) + logdet + chi2), m, refused, in_a_row


@compiled()
def denoise_channel(
    z: Array, dt: Array, q: float, r: float, tau: float, gate: float, state: State, out: Array
) -> int:
    """Filter one channel into `out` (not z itself), x only: in chunks once the gains have settled.

    Returns -1, or the index of the first infinite sample, where it stops.
    """
    n, regular = z.shape[0], dt.shape[0] == 0
    last = 1.0
    over = transition(last, q, tau)
    in_a_row = i = chunks_from = 0
    while i < n:
        if math.isinf(z[i]):
            return i
        if not regular and dt[i] != last:
            last = dt[i]
            over = transition(last, q, tau)
        before = state
        state, k, _, s, done = step(z[i], over, r, gate, state, in_a_row)
        in_a_row = in_a_row + 1 if done == REJECTED else (in_a_row if done == MISSING else 0)
        out[i] = state[0]
        i += 1
        if i >= chunks_from and regular and done == UPDATED and math.isinf(gate) and has_settled(before, state):
            gains = k, predict(over, state)[3] / s
            i, state = advance_settled(z, gains, over, state, i, out)
            chunks_from = after_missing(z, i)
    return -1


@compiled()
def after_missing(z: Array, i: int) -> int:
    """Where to try the next chunk after the one at `i` failed: after its first sample that is not finite."""
    for j in range(i, min(i + CHUNK, z.shape[0])):
        if not math.isfinite(z[j]):
            return j + 1
    return i + CHUNK


@compiled(inline="always")
def has_settled(before: State, after: State) -> bool:
    """True where no variance changed by more than rounding."""
    return (
        abs(after[2] - before[2]) <= SETTLED_WITHIN * after[2]
        and abs(after[3] - before[3]) <= SETTLED_WITHIN * abs(after[3])
        and abs(after[4] - before[4]) <= SETTLED_WITHIN * after[4]
    )


@compiled()
def advance_settled(
    z: Array, gains: Gains, over: Transition, state: State, i: int, out: Array
) -> tuple[int, State]:
    """Constant gains from sample `i` on, chunk by chunk, up to the first chunk with a sample that is not finite.

    Returns the first index not yet filtered and the state before it.
    """
    x, v, p, g, w = state
    response = np.empty((BLOCK, 5))
    block_response(gains, over, response)
    while i + CHUNK <= z.shape[0]:
        x_next, v_next = advance_chunk(z[i : i + CHUNK], gains, over, response, x, v, out[i : i + CHUNK])
        if not (math.isfinite(x_next) and math.isfinite(v_next)):
            break
        x, v = x_next, v_next
        i += CHUNK
    return i, (x, v, p, g, w)


@compiled()
def block_response(gains: Gains, over: Transition, response: Array) -> None:
    """How a block of the settled filter depends on the state before it: row j is sample j of BLOCK.

    Columns: the weights of x and v before the block in x_j, those in v_j, and the weight of z_j in the last v.
    """
    k, ell = gains
    e, f = over[0], over[1]
    m11, m12, m21, m22 = 1.0 - k, (1.0 - k) * f, -ell, e - ell * f
    a11, a12, a21, a22 = 1.0, 0.0, 0.0, 1.0
    for j in range(BLOCK):
        response[BLOCK - 1 - j, 4] = a21 * k + a22 * ell
        a11, a12, a21, a22 = (
            m11 * a11 + m12 * a21,
            m11 * a12 + m12 * a22,
            m21 * a11 + m22 * a21,
            m21 * a12 + m22 * a22,
        )
        response[j, 0], response[j, 1], response[j, 2], response[j, 3] = a11, a12, a21, a22


@compiled(fastmath={"contract"})
def advance_chunk(
    z: Array, gains: Gains, over: Transition, response: Array, x: float, v: float, out: Array
) -> tuple[float, float]:
    """Constant gains over one chunk, eight samples at once; returns the last x and v.

    Within a block c is x from the state 0, c_j = t c_(j-1) - d c_(j-2) + k z_j + b z_(j-1), the state equations
    with v eliminated; it does not wait for the block before. Then the faded state before the block is added.
    """
    k, ell = gains
    e, f = over[0], over[1]
    t, d, b = 1.0 - k + (e - ell * f), (1.0 - k) * e, ell * f - k * e
    px, pv, last, h = response[:, 0], response[:, 1], response[BLOCK - 1], response[:, 4]
    for i in range(0, CHUNK, BLOCK):
        z0, z1, z2, z3 = z[i], z[i + 1], z[i + 2], z[i + 3]
        z4, z5, z6, z7 = z[i + 4], z[i + 5], z[i + 6], z[i + 7]
        c0 = k * z0
        c1 = t * c0 + (k * z1 + b * z0)
        c2 = t * c1 + ((k * z2 + b * z1) - d * c0)
        c3 = t * c2 + ((k * z3 + b * z2) - d * c1)
        c4 = t * c3 + ((k * z4 + b * z3) - d * c2)
        c5 = t * c4 + ((k * z5 + b * z4) - d * c3)
        c6 = t * c5 + ((k * z6 + b * z5) - d * c4)
        c7 = t * c6 + ((k * z7 + b * z6) - d * c5)
        out[i] = c0 + (px[0] * x + pv[0] * v)
        out[i + 1] = c1 + (px[1] * x + pv[1] * v)
        out[i + 2] = c2 + (px[2] * x + pv[2] * v)
        out[i + 3] = c3 + (px[3] * x + pv[3] * v)
        out[i + 4] = c4 + (px[4] * x + pv[4] * v)
        out[i + 5] = c5 + (px[5] * x + pv[5] * v)
        out[i + 6] = c6 + (px[6] * x + pv[6] * v)
        own = ((h[0] * z0 + h[1] * z1) + (h[2] * z2 + h[3] * z3)) + (
            (h[4] * z4 + h[5] * z5) + (h[6] * z6 + h[7] * z7)
        )
        end = c7 + (px[7] * x + pv[7] * v)
        v = own + (last[2] * x + last[3] * v)
        out[i + 7] = x = end
    return x, v
