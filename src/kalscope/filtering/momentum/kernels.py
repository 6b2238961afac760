"""The compiled loops of the filter with momentum, nothing else: one channel, contiguous float64, no checks.

The model: z = x + noise of variance r, dx = v dt, and v is an Ornstein-Uhlenbeck process of time constant τ whose
position moves by q a sample in the long run, so that v has the stationary variance q/(2τ). Then over a step Δ

    F = [[1, f], [0, e]],  e = exp(-Δ/τ),  f = τ(1 - e),  Q = [[a, b], [b, c]]

(the continuous-time correlated random walk: Johnson et al. 2008, Ecology 89(5), equations 5 and 6; Singer 1970 is
one derivative higher). The variances of x and v are p and w, their covariance is g. Time counts in nominal sample
periods and velocity in units a period.

`step` is the only place where the update stands; every driver below calls it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kalscope.filtering.kernels import GATE_LIMIT, MISSING, REJECTED, START, UPDATED

Array = NDArray[np.float64]

SERIES_BELOW = 0.1
"""Steps below so many τ take the series of `transition`: the closed form loses digits like (τ/Δ)²."""

BLOCK = 8
"""Samples that the settled filter advances at once."""

CHUNK = 256
"""Samples, a multiple of BLOCK, that the settled filter advances before it looks for a missing one."""

SETTLED_WITHIN = 4e-16
"""Relative change of the variances a sample below which the gains are taken as settled."""

Transition = tuple[float, float, float, float, float]
State = tuple[float, float, float, float, float]
Gains = tuple[float, float]


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True, inline="always")
def predict(over: Transition, state: State) -> State:
    """The state one step later."""
    e, f, a, b, c = over
    x, v, p, g, w = state
    return x + f * v, e * v, p + f * (2.0 * g + f * w) + a, e * (g + f * w) + b, e * e * w + c


@njit(cache=True, nogil=True, inline="always")
def step(
    z: float, over: Transition, r: float, gate: float, state: State, rejected: int
) -> tuple[State, float, float, float, int]:
    """One sample: predict, then update; `rejected` counts gate refusals in a row.

    Returns the state, k, the innovation, its variance s and what was done, as the `step` of the five lines does. An
    infinite p is the exact diffuse start: the limit p → ∞, in which v keeps its stationary law.
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
    kept = (1.0 - k) * p, (1.0 - k) * g, w - ell * g
    if math.isnan(x):  # p0 is given, x0 is this first sample
        return (z, 0.0, kept[0], kept[1], kept[2]), k, math.nan, s, START
    if innovation * innovation > gate * s and rejected < GATE_LIMIT:
        return (x, v, p, g, w), 0.0, innovation, s, REJECTED
    return (x + k * innovation, v + ell * innovation, kept[0], kept[1], kept[2]), k, innovation, s, UPDATED


@njit(cache=True, nogil=True)
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

    Returns the last state, the log-likelihood over the m scored innovations, m, the gate refusals, and those right
    at the end.
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


@njit(cache=True, nogil=True)
def denoise_channel(
    z: Array, dt: Array, q: float, r: float, tau: float, gate: float, state: State, out: Array
) -> int:
    """Filter one channel into `out` (not z itself), x only: in chunks once the gains have settled.

    Returns -1, or the index of the first infinite sample, where it stops.
    """
    n, regular = z.shape[0], dt.shape[0] == 0
    last = 1.0
    over = transition(last, q, tau)
    in_a_row = i = 0
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
        if regular and done == UPDATED and math.isinf(gate) and has_settled(before, state):
            gains = k, predict(over, state)[3] / s
            i, state = advance_settled(z, gains, over, state, i, out)
    return -1


@njit(cache=True, nogil=True, inline="always")
def has_settled(before: State, after: State) -> bool:
    """True where no variance changed by more than rounding."""
    return (
        abs(after[2] - before[2]) <= SETTLED_WITHIN * after[2]
        and abs(after[3] - before[3]) <= SETTLED_WITHIN * abs(after[3])
        and abs(after[4] - before[4]) <= SETTLED_WITHIN * after[4]
    )


@njit(cache=True, nogil=True)
def advance_settled(
    z: Array, gains: Gains, over: Transition, state: State, i: int, out: Array
) -> tuple[int, State]:
    """Constant gains from sample `i` on, chunk by chunk, up to the first chunk with a sample that is not finite.

    Returns the first index not yet filtered and the state before it.
    """
    x, v, p, g, w = state
    powers = np.empty((BLOCK, 4))
    response_powers(gains, over, powers)
    while i + CHUNK <= z.shape[0]:
        x_next, v_next = advance_chunk(z[i : i + CHUNK], gains, over, powers, x, v, out[i : i + CHUNK])
        if not (math.isfinite(x_next) and math.isfinite(v_next)):
            break
        x, v = x_next, v_next
        i += CHUNK
    return i, (x, v, p, g, w)


@njit(cache=True, nogil=True)
def response_powers(gains: Gains, over: Transition, powers: Array) -> None:
    """The first BLOCK powers of the settled filter's matrix: how a state fades while the samples are 0."""
    k, ell = gains
    e, f = over[0], over[1]
    m11, m12, m21, m22 = 1.0 - k, (1.0 - k) * f, -ell, e - ell * f
    a11, a12, a21, a22 = 1.0, 0.0, 0.0, 1.0
    for j in range(BLOCK):
        a11, a12, a21, a22 = (
            m11 * a11 + m12 * a21,
            m11 * a12 + m12 * a22,
            m21 * a11 + m22 * a21,
            m21 * a12 + m22 * a22,
        )
        powers[j, 0], powers[j, 1], powers[j, 2], powers[j, 3] = a11, a12, a21, a22


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def advance_chunk(
    z: Array, gains: Gains, over: Transition, powers: Array, x: float, v: float, out: Array
) -> tuple[float, float]:
    """Constant gains over one chunk, a block at once; returns the last x and v.

    Each block is first filtered from the state 0, which waits for nothing; then the faded state before it is added.
    """
    k, ell = gains
    e, f = over[0], over[1]
    last = BLOCK - 1
    for i in range(0, z.shape[0], BLOCK):
        own_x = own_v = 0.0
        for j in range(BLOCK):
            ahead = own_x + f * own_v
            innovation = z[i + j] - ahead
            own_x = ahead + k * innovation
            own_v = e * own_v + ell * innovation
            out[i + j] = own_x + (powers[j, 0] * x + powers[j, 1] * v)
        x, v = (
            own_x + (powers[last, 0] * x + powers[last, 1] * v),
            own_v + (powers[last, 2] * x + powers[last, 3] * v),
        )
    return x, v
