"""The compiled loops of the fused filter, nothing else: readings on the scale of x, contiguous float64, no checks.

A row holds one reading of each sensor, NaN where it has none. The row predicts once; then the sensors update one
after the other, which gives what one update with all of them would (independent noises: Durbin & Koopman 2012,
section 6.4). The updates are those of the scalar filter, `filtering.kernels.step`, and of the filter with momentum,
`filtering.momentum.kernels.step`: no time passes before the second and later sensors.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.filtering.kernels import MISSING, REJECTED, START, UPDATED, step
from kalscope.filtering.momentum.kernels import State, transition
from kalscope.filtering.momentum.kernels import step as step_with_momentum

Array = NDArray[np.float64]
Counts = NDArray[np.int64]
Columns = tuple[Array, Array, Array, Array]
"""k, innovation, s and weight of each reading, shape (rows, sensors)."""
Tally = tuple[Counts, Counts, Counts]
"""Of each sensor: gate refusals in a row right before the next reading, all gate refusals, scored readings."""

NO_TIME = (1.0, 0.0, 0.0, 0.0, 0.0)
"""The transition over no time."""


@compiled(plain=True)
def fuse_rows(
    z: Array,
    dt: Array,
    q: float,
    r: Array,
    gate: float,
    x: float,
    p: float,
    tally: Tally,
    out: tuple[Array, Array],
    columns: Columns,
    sums: Array,
) -> tuple[float, float, float]:
    """Fuse the rows of z into `out` = (x, p) and `columns`; `dt` empty means regular sampling.

    `tally` goes on, `sums` of shape (sensors,) is overwritten. Returns x and p after the last row, and the
    log-likelihood of the scored readings. Where the variance repeats itself to the last bit from row to row, the
    gains are kept: the same numbers.
    """
    (out_x, out_p), (out_k, out_v, out_s, out_w) = out, columns
    in_a_row, _, scored = tally
    n, sensors = z.shape
    regular = dt.shape[0] == 0
    chi2 = logdet = 0.0
    m = i = 0
    while i < n:
        before, elapsed, updates = p, 1.0 if regular else dt[i], 0
        for j in range(sensors):
            x, p, k, v, s, done = step(z[i, j], elapsed, q, r[j], gate, x, p, in_a_row[j])
            elapsed = 0.0
            out_k[i, j], out_v[i, j], out_s[i, j] = k, v, s
            out_w[i, j] = 1.0 if done in (START, UPDATED) else 0.0
            count(done, j, tally)
            if done == UPDATED:
                updates += 1
                chi2 += v / s * v
                logdet += math.log(s)
        weigh(r, out_w, i)
        out_x[i], out_p[i] = x, p
        m += updates
        i += 1
        if regular and updates == sensors and p == before:
            last, first = i - 1, i
            i, x = advance_settled(z, gate, x, i, out, columns, sums)
            m += sensors * (i - first)
            for j in range(sensors):
                scored[j] += i - first
                chi2 += sums[j] / out_s[last, j]
                logdet += (i - first) * math.log(out_s[last, j])
    return x, p, -0.5 * (m * math.log(2.0 * math.pi) + logdet + chi2)


@compiled(plain=True)
def advance_settled(
    z: Array, gate: float, x: float, i: int, out: tuple[Array, Array], columns: Columns, sums: Array
) -> tuple[int, float]:
    """Go on with the gains of row i − 1, up to a row with a missing reading or one for the gate.

    Returns that row and x before it; `sums` are the sums of the squared innovations of each sensor.
    """
    (out_x, out_p), (out_k, out_v, out_s, out_w) = out, columns
    n, sensors = z.shape
    last = i - 1
    for j in range(sensors):
        sums[j] = 0.0
    while i < n:
        start = x
        for j in range(sensors):
            v = z[i, j] - x
            if not v * v <= gate * out_s[last, j]:
                return i, start
            x = x + out_k[last, j] * v
            out_v[i, j] = v
        for j in range(sensors):
            sums[j] += out_v[i, j] * out_v[i, j]
            out_k[i, j], out_s[i, j], out_w[i, j] = out_k[last, j], out_s[last, j], out_w[last, j]
        out_x[i], out_p[i] = x, out_p[last]
        i += 1
    return i, x


@compiled()
def fuse_rows_with_momentum(
    z: Array,
    dt: Array,
    q: float,
    r: Array,
    tau: float,
    gate: float,
    state: State,
    tally: Tally,
    out: tuple[Array, Array, Array, Array, Array],
    columns: Columns,
) -> tuple[State, float]:
    """As `fuse_rows` with momentum τ > 0, into `out` = (x, v, p, g, w): velocity v of variance w, covariance g."""
    out_x, out_v, out_p, out_g, out_w = out
    n, sensors = z.shape
    regular = dt.shape[0] == 0
    last = 1.0
    over = transition(last, q, tau)
    chi2 = logdet = 0.0
    m = 0
    for i in range(n):
        if not regular and dt[i] != last:
            last = dt[i]
            over = transition(last, q, tau)
        move = over
        for j in range(sensors):
            state, k, v, s, done = step_with_momentum(z[i, j], move, r[j], gate, state, tally[0][j])
            move = NO_TIME
            columns[0][i, j], columns[1][i, j], columns[2][i, j] = k, v, s
            columns[3][i, j] = 1.0 if done in (START, UPDATED) else 0.0
            count(done, j, tally)
            if done == UPDATED:
                m += 1
                chi2 += v / s * v
                logdet += math.log(s)
        weigh(r, columns[3], i)
        out_x[i], out_v[i], out_p[i], out_g[i], out_w[i] = state
    return state, -0.5 * (m * math.log(2.0 * math.pi) + logdet + chi2)


@compiled(plain=True, inline="always")
def count(done: int, j: int, tally: Tally) -> None:
    """Count what was done with a reading of sensor j."""
    in_a_row, refused, scored = tally
    if done == REJECTED:
        in_a_row[j] += 1
        refused[j] += 1
    elif done != MISSING:
        in_a_row[j] = 0
    if done == UPDATED:
        scored[j] += 1


@compiled(plain=True, inline="always")
def weigh(r: Array, weights: Array, i: int) -> None:
    """Row i of `weights`, 1 where a reading was used, becomes the shares of 1/r: sums of 1, or 0 without any."""
    lowest = math.inf
    for j in range(r.shape[0]):
        if weights[i, j] > 0.0:
            lowest = min(lowest, r[j])
    total = 0.0
    for j in range(r.shape[0]):
        if weights[i, j] > 0.0:
            weights[i, j] = 1.0 if r[j] == lowest else lowest / r[j]
            total += weights[i, j]
    for j in range(r.shape[0]):
        if weights[i, j] > 0.0:
            weights[i, j] /= total
