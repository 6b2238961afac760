"""The compiled loops of the fused filter, nothing else: contiguous float64, no checks.

A row holds one reading of each sensor, NaN where it has none. The row predicts once; then the sensors update one
after the other, which gives what one update with all of them would (independent noises: Durbin & Koopman 2012,
section 6.4). The updates are those of the scalar filter, `filtering.kernels.step`, and of the filter with momentum,
`filtering.momentum.kernels.step`, from readings as values of x, (z − offset)/gain. No time passes between sensors.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.filtering.kernels import MISSING, REJECTED, UPDATED, step
from kalscope.filtering.momentum.kernels import State, transition
from kalscope.filtering.momentum.kernels import step as step_with_momentum

Array = NDArray[np.float64]
Counts = NDArray[np.int64]
Sensors = tuple[Array, Array, Array]
"""Of each sensor, shape (sensors,): offset, gain, and noise variance on the scale of x."""
Tally = tuple[Counts, Counts, Counts]
"""Of each sensor, shape (sensors,): gate rejections in a row before the next reading; in all; scored readings."""
Columns = tuple[Array, Array, Array]
"""k, innovation and s of each reading on the scale of x, shape (rows, sensors)."""

NO_TIME = (1.0, 0.0, 0.0, 0.0, 0.0)
"""The transition over no time."""

# The loops unpack their tuples once and call nothing with an array for each reading: numba counts the references.


@compiled(plain=True)
def fuse_rows(
    z: Array,
    dt: Array,
    q: float,
    sensors: Sensors,
    gate: float,
    x: float,
    p: float,
    tally: Tally,
    out: tuple[Array, Array],
    columns: Columns,
    sums: Array,
) -> tuple[float, float, float]:
    """Fuse the rows of z into `out` = (x, p) and `columns`; `dt` empty means regular sampling.

    `tally` is continued, `sums` of shape (sensors,) is overwritten. Returns x and p after the last row, and the
    log-likelihood of the scored readings. Where the variance repeats itself to the last bit from row to row, the
    gains are kept: the same numbers.
    """
    (out_x, out_p), (out_k, out_v, out_s) = out, columns
    (in_a_row, refused, scored), (offset, gain, r) = tally, sensors
    n, width, regular = z.shape[0], z.shape[1], dt.shape[0] == 0
    chi2 = logdet = 0.0
    m = i = 0
    while i < n:
        before, elapsed, updates = p, 1.0 if regular else dt[i], 0
        for j in range(width):
            y = (z[i, j] - offset[j]) / gain[j]
            x, p, k, v, s, done = step(y, elapsed, q, r[j], gate, x, p, in_a_row[j])
            elapsed = 0.0
            out_k[i, j], out_v[i, j], out_s[i, j] = k, v, s
            if done == REJECTED:
                in_a_row[j] += 1
                refused[j] += 1
            elif done != MISSING:
                in_a_row[j] = 0
                if done == UPDATED:
                    scored[j] += 1
                    updates += 1
                    chi2 += v / s * v
                    logdet += math.log(s)
        out_x[i], out_p[i] = x, p
        m += updates
        i += 1
        if regular and updates == width and p == before:
            last, first = i - 1, i
            i, x = advance_settled(z, sensors, gate, x, i, out, columns, sums)
            m += width * (i - first)
            for j in range(width):
                scored[j] += i - first
                chi2 += sums[j] / out_s[last, j]
                logdet += (i - first) * math.log(out_s[last, j])
    return x, p, -0.5 * (m * math.log(2.0 * math.pi) + logdet + chi2)


@compiled(plain=True)
def advance_settled(
    z: Array,
    sensors: Sensors,
    gate: float,
    x: float,
    i: int,
    out: tuple[Array, Array],
    columns: Columns,
    sums: Array,
) -> tuple[int, float]:
    """Continue with the gains of row i − 1, up to a row with a missing reading or one beyond the gate.

    Returns that row and x before it; `sums` are the sums of the squared innovations of each sensor.
    """
    (out_x, out_p), (out_k, out_v, out_s) = out, columns
    offset, gain = sensors[0], sensors[1]
    n, width, last = z.shape[0], z.shape[1], i - 1
    for j in range(width):
        sums[j] = 0.0
    while i < n:
        start = x
        for j in range(width):
            v = (z[i, j] - offset[j]) / gain[j] - x
            if not v * v <= gate * out_s[last, j]:
                return i, start
            x = x + out_k[last, j] * v
            out_v[i, j] = v
        for j in range(width):
            sums[j] += out_v[i, j] * out_v[i, j]
            out_k[i, j], out_s[i, j] = out_k[last, j], out_s[last, j]
        out_x[i], out_p[i] = x, out_p[last]
        i += 1
    return i, x


@compiled()
def fuse_rows_with_momentum(
    z: Array,
    dt: Array,
    q: float,
    sensors: Sensors,
    tau: float,
    gate: float,
    state: State,
    tally: Tally,
    out: tuple[Array, Array, Array, Array, Array],
    columns: Columns,
) -> tuple[State, float]:
    """As `fuse_rows` with momentum τ > 0, into `out` = (x, v, p, g, w): velocity v of variance w, covariance g."""
    (out_x, out_u, out_p, out_g, out_w), (out_k, out_v, out_s) = out, columns
    (in_a_row, refused, scored), (offset, gain, r) = tally, sensors
    n, width, regular = z.shape[0], z.shape[1], dt.shape[0] == 0
    last = 1.0
    over = transition(last, q, tau)
    chi2 = logdet = 0.0
    m = 0
    for i in range(n):
        if not regular and dt[i] != last:
            last = dt[i]
            over = transition(last, q, tau)
        move = over
        for j in range(width):
            y = (z[i, j] - offset[j]) / gain[j]
            state, k, v, s, done = step_with_momentum(y, move, r[j], gate, state, in_a_row[j])
            move = NO_TIME
            out_k[i, j], out_v[i, j], out_s[i, j] = k, v, s
            if done == REJECTED:
                in_a_row[j] += 1
                refused[j] += 1
            elif done != MISSING:
                in_a_row[j] = 0
                if done == UPDATED:
                    scored[j] += 1
                    m += 1
                    chi2 += v / s * v
                    logdet += math.log(s)
        out_x[i], out_u[i], out_p[i], out_g[i], out_w[i] = state
    return state, -0.5 * (m * math.log(2.0 * math.pi) + logdet + chi2)
