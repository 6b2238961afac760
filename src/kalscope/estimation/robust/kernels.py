"""The compiled loop of the spike-proof fit, nothing else: which samples the past does not predict.

One run of the filter over a record, in which the samples beyond the gate change nothing. A spike, or a few side by
side, is refused, and the sample after it is predicted well again. Where one sample more is refused than may stand
side by side the signal has moved: the filter starts again at the first of them, and they count as predicted.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kalscope.filtering import kernels as plain
from kalscope.filtering.kernels import MISSING, REJECTED, START
from kalscope.filtering.momentum import kernels as moving

Array = NDArray[np.float64]


@njit(cache=True, nogil=True)
def refused_samples(
    z: Array, dt: Array, q: float, r: float, tau: float, gate: float, longest: int, out: Array
) -> None:
    """Write v²/s of each refused sample into `out`, 0 for all others; `longest` may stand side by side.

    `z` holds NaN where missing, `dt` may be empty, `tau` = 0 is the filter without momentum. The first sample has
    nothing before it that could predict it: inf. So have those that follow it, if there are no more than `longest`
    of them before the filter starts again.
    """
    n, regular = z.shape[0], dt.shape[0] == 0
    last = 1.0
    over = moving.transition(last, q, tau) if tau > 0.0 else (0.0, 0.0, 0.0, 0.0, 0.0)
    w = 0.5 * q / tau if tau > 0.0 else 0.0
    state = (math.nan, 0.0, math.inf, 0.0, w)
    first = run = taken = i = 0
    at_start = True
    while i < n:
        step = 1.0 if regular else dt[i]
        if tau > 0.0:
            if step != last:
                last = step
                over = moving.transition(last, q, tau)
            state, _, v, s, done = moving.step(z[i], over, r, gate, state, 0)
        else:
            x, p, _, v, s, done = plain.step(z[i], step, q, r, gate, state[0], state[2], 0)
            state = (x, 0.0, p, 0.0, 0.0)
        out[i] = 0.0
        if done == REJECTED:
            first = i if run == 0 else first
            run += 1
            out[i] = v / s * v
        elif done != MISSING:
            run = 0
            taken += 1
            if done == START and at_start:
                out[i] = math.inf
        if run > longest:
            out[first : i + 1] = 0.0
            if at_start and taken <= longest:
                for j in range(first):
                    out[j] = 0.0 if math.isnan(z[j]) else math.inf
            state, at_start, run, i = (math.nan, 0.0, math.inf, 0.0, w), False, 0, first
            continue
        i += 1
