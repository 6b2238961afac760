"""The compiled loop of the smoother, nothing else: one channel, contiguous float64, no checks.

It releases the GIL and is cached on disk, as the loops of `kernels` are; the filter's five lines stand there.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.filtering.kernels import MISSING, REJECTED, UPDATED, step

Array = NDArray[np.float64]


@compiled()
def smooth_channel(
    z: Array, dt: Array, q: float, r: float, gate: float, x: float, p: float, out_x: Array, out_p: Array
) -> None:
    """Smooth one channel into `out_x`, `out_p`, which hold the filtered values in between.

    `dt` empty means regular sampling. No other memory is used: the way back replaces each filtered value once
    it has been read.
    """
    n = z.shape[0]
    filter_forward(z, dt, q, r, gate, x, p, out_x, out_p)
    first = 0
    while first < n and math.isnan(out_x[first]):
        first += 1
    if first == n:
        return
    start = out_x[first]  # what stands for x0 where none was given
    x, p = float(out_x[n - 1]), float(out_p[n - 1])
    regular = dt.shape[0] == 0
    for i in range(n - 2, -1, -1):
        grown = q if regular else q * dt[i + 1]
        p_i = out_p[i]
        if math.isinf(p_i):  # before a diffuse start nothing but what comes later is known
            p = p + grown
        else:
            p_pred = p_i + grown
            j = p_i / p_pred if p_pred > 0.0 else 1.0
            x_i = out_x[i] if i >= first else start
            x = x_i + j * (x - x_i)
            p = j * grown + j * j * p  # = p_i + j² (p − p_pred), without the cancellation
        out_x[i], out_p[i] = x, p


@compiled()
def filter_forward(
    z: Array, dt: Array, q: float, r: float, gate: float, x: float, p: float, out_x: Array, out_p: Array
) -> None:
    """The filter's x and p only; the same numbers as `kernels.filter_channel`, bit for bit."""
    n, regular = z.shape[0], dt.shape[0] == 0
    in_a_row = i = 0
    while i < n:
        before = p
        x, p, k, _, s, done = step(z[i], 1.0 if regular else dt[i], q, r, gate, x, p, in_a_row)
        out_x[i], out_p[i] = x, p
        i += 1
        in_a_row = in_a_row + 1 if done == REJECTED else (in_a_row if done == MISSING else 0)
        if regular and done == UPDATED and p == before:
            limit = gate * s
            while i < n:
                v = z[i] - x
                if not v * v <= limit:  # a missing sample, or one for the gate
                    break
                x = x + k * v
                out_x[i], out_p[i] = x, p
                i += 1
