"""The compiled loop of the smoother with momentum, nothing else: one channel, contiguous float64, no checks."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.filtering.momentum.kernels import MISSING, REJECTED, State, Transition, predict, step, transition

Array = NDArray[np.float64]


@compiled()
def smooth_channel(
    z: Array,
    dt: Array,
    q: float,
    r: float,
    tau: float,
    gate: float,
    state: State,
    out: tuple[Array, Array, Array, Array],
) -> None:
    """Smooth one channel into `out` = (x, p, v, w); `dt` empty means regular sampling.

    Rauch, Tung & Striebel (1965), in the form (I - C F) P (I - C F)' + C Q C' + C P' C', which is never negative.
    """
    n, regular = z.shape[0], dt.shape[0] == 0
    out_x, out_p, out_v, out_w = out
    out_g = np.empty(n)
    start = state[0]
    last = 1.0
    over = transition(last, q, tau)
    in_a_row = 0
    for i in range(n):
        if not regular and dt[i] != last:
            last = dt[i]
            over = transition(last, q, tau)
        state, _, _, _, done = step(z[i], over, r, gate, state, in_a_row)
        in_a_row = in_a_row + 1 if done == REJECTED else (in_a_row if done == MISSING else 0)
        out_x[i], out_v[i], out_p[i], out_g[i], out_w[i] = state
        if math.isnan(start) and not math.isnan(state[0]):
            start = state[0]  # used for x0 where none was given
    if n > 0 and not math.isnan(start):
        smooth_backwards(dt, q, tau, start, (out_x, out_v, out_p, out_g, out_w))


@compiled()
def smooth_backwards(
    dt: Array, q: float, tau: float, start: float, out: tuple[Array, Array, Array, Array, Array]
) -> None:
    """The backward pass over filtered states, `out` = (x, v, p, g, w); `start` is used for x before it is known."""
    out_x, out_v, out_p, out_g, out_w = out
    end, regular = out_x.shape[0] - 1, dt.shape[0] == 0
    last = 1.0
    over = transition(last, q, tau)
    after = float(out_x[end]), float(out_v[end]), float(out_p[end]), float(out_g[end]), float(out_w[end])
    for i in range(end - 1, -1, -1):
        if not regular and dt[i + 1] != last:
            last = dt[i + 1]
            over = transition(last, q, tau)
        x = start if math.isnan(out_x[i]) else out_x[i]
        if math.isinf(out_p[i]):
            after = backwards(over, after)
        else:
            after = corrected(over, (x, out_v[i], out_p[i], out_g[i], out_w[i]), after)
        out_x[i], out_v[i], out_p[i], out_g[i], out_w[i] = after


@compiled(inline="always")
def backwards(over: Transition, after: State) -> State:
    """The state before a diffuse start: only what comes later is known, so the model is run back in time."""
    e, f, a, b, c = over
    return predict((e, -f, a, -b, c), after)


@compiled(inline="always")
def corrected(over: Transition, state: State, after: State) -> State:
    """The filtered `state`, given the smoothed state `after` it."""
    e, f, a, b, c = over
    x, v, p, g, w = state
    x_next, v_next, p_next, g_next, w_next = predict(over, state)
    # C = P F' / (F P F' + Q), multiplied out: what cancels in the products of large variances is left out
    to_x, to_v, own = p + f * g, g + f * w, p * w - g * g  # covariances with x of the next sample; det P
    det = (p_next - a) * c + (w_next - c) * a - 2.0 * (g_next - b) * b + (a * c - b * b) + e * e * own
    if det > 1e-14 * p_next * w_next:
        c11, c12 = (e * e * own + to_x * c - e * g * b) / det, (e * (g * a - f * own) - to_x * b) / det
        c21, c22 = (to_v * c - e * w * b) / det, (e * (own + w * a) - to_v * b) / det
    elif p_next > 0.0:  # x and v of the next sample carry the same information
        c11, c21 = to_x / p_next, to_v / p_next
        c12 = c22 = 0.0
    else:  # x is known exactly, so only v of the next sample adds information
        c11, c22 = 1.0, e * w / w_next if w_next > 0.0 else 0.0
        c12 = c21 = 0.0
    dx, dv = after[0] - x_next, after[1] - v_next
    # A = I - C F, and the variance that comes from the step and from what follows, M = Q + P'
    a11, a12 = 1.0 - c11, -(c11 * f + c12 * e)
    a21, a22 = -c21, 1.0 - (c21 * f + c22 * e)
    m11, m12, m22 = a + after[2], b + after[3], c + after[4]
    return (
        x + c11 * dx + c12 * dv,
        v + c21 * dx + c22 * dv,
        quadratic(a11, a12, a11, a12, p, g, w) + quadratic(c11, c12, c11, c12, m11, m12, m22),
        quadratic(a11, a12, a21, a22, p, g, w) + quadratic(c11, c12, c21, c22, m11, m12, m22),
        quadratic(a21, a22, a21, a22, p, g, w) + quadratic(c21, c22, c21, c22, m11, m12, m22),
    )


@compiled(inline="always")
def quadratic(a1: float, a2: float, b1: float, b2: float, p: float, g: float, w: float) -> float:
    """(a1, a2) [[p, g], [g, w]] (b1, b2)'."""
    return a1 * (p * b1 + g * b2) + a2 * (g * b1 + w * b2)
