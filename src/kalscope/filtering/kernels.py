"""The compiled loops of the filter and its smoother, nothing else: contiguous float64, no checks.

The model: sensor i reads z = offset + gain x + noise of variance r. x is a random walk of variance q per sample, or
with momentum dx = v dt, where v is an Ornstein-Uhlenbeck process of time constant tau whose position gains q per
sample in the long run: v has the stationary variance q/(2 tau). Over a step of dt nominal sample periods

    F = [[1, f], [0, e]],  e = exp(-dt/tau),  f = tau (1 - e),  Q = [[a, b], [b, c]]

(the continuous-time correlated random walk: Johnson et al. 2008, Ecology 89(5), equations 5 and 6; Singer 1970 is
one derivative higher). The variances of x and v are p and w, their covariance is g; velocity is in units per
period.

Each loop is written once. An argument that is None leaves out what it stands for: `tau` None is the random walk
without a velocity, `scales` None one sensor that reads x itself. numba compiles each case apart and drops the
branches of the other. A row predicts once; then its sensors update one after the other, which gives what one update
with all of them would (independent noises: Durbin & Koopman 2012, section 6.4).

Every loop releases the GIL (a reader thread must not starve) and is cached on disk. None is parallel, and none is
made by a function: numba would not find it in its cache.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled

Array = NDArray[np.float64]
Counts = NDArray[np.int64]

MISSING, START, REJECTED, UPDATED = 0, 1, 2, 3
"""What `step` did with a reading: predicted only; set the start; rejected it at the gate; updated."""

GATE_LIMIT = 5
"""Readings in a row that the outlier gate may reject; the next one is used, so the filter cannot get stuck."""

BLOCK = 8
"""Samples that the settled filter advances at once."""

CHUNK = 256
"""Samples, a multiple of BLOCK, that the settled filter advances before it looks for a missing one."""

MIN_BLOCK_GAIN = 1e-3
"""Below this gain the settled random walk stays sample by sample: rounding grows like 1/gain (limit 1e-12)."""

SETTLED_WITHIN = 4e-16
"""Relative change of the variances per sample below which the gains count as settled."""

SERIES_BELOW = 0.1
"""Steps shorter than this many tau take the series of `transition`: the closed form loses digits like (tau/dt)²."""

_SERIES = (-510 / 3628800, 254 / 362880, -126 / 40320, 62 / 5040, -30 / 720, 7 / 60, -0.25, 1 / 3)
"""Of h - 2(1 - e) + (1 - e²)/2 = Σ (-1)^(n+1) (2^(n-1) - 2) hⁿ/n!, n from 10 down to 3."""

Transition = tuple[float, float, float, float, float]
"""e, f, a, b and c."""
State = tuple[float, float, float, float, float]
"""x, v, p, g and w; without momentum v, g and w are 0."""
States = tuple[Array, Array, Array, Array, Array]
"""x, v, p, g and w of each row, shape (rows,)."""
Readings = tuple[Array, Array, Array]
"""k, innovation and s of each reading, shape (rows, sensors)."""
Scales = tuple[Array, Array]
"""Offset and gain of each sensor, shape (sensors,)."""
Tally = tuple[Counts, Counts, Counts]
"""Of each sensor, shape (sensors,): gate rejections in a row before the next reading; in all; scored readings."""


@compiled(plain=True)
def transition(dt: float, q: float, tau: float | None) -> Transition:
    """The transition over `dt` periods."""
    if tau is None:
        return 1.0, 0.0, q * dt, 0.0, 0.0
    h = dt / tau
    u = -math.expm1(-h)  # 1 - e
    if h < SERIES_BELOW:
        a = 0.0
        for factor in _SERIES:
            a = factor + a * h
        a = h * h * h * a
    else:
        a = h - 2.0 * u - 0.5 * math.expm1(-2.0 * h)
    return math.exp(-h), tau * u, q * tau * a, 0.5 * q * u * u, -0.5 * q / tau * math.expm1(-2.0 * h)


@compiled(plain=True, inner=True, inline="always")
def predict(over: Transition, state: State) -> State:
    """The state one step later."""
    e, f, a, b, c = over
    x, v, p, g, w = state
    return x + f * v, e * v, p + f * (2.0 * g + f * w) + a, e * (g + f * w) + b, e * e * w + c


@compiled(plain=True, forceinline=True)
def step(  # noqa: PLR0911 - one for each that can happen
    y: float, over: Transition, r: float, gate: float, state: State, rejected: int, tau: float | None
) -> tuple[State, float, float, float, float, int]:
    """One reading: predict over a step, then update; `rejected` counts gate rejections in a row.

    Returns the state, its gains k (of x) and ell (of v), the innovation, its variance s and what was done. Without
    momentum these are the five lines: interactive matter (2009), C listing; Ma'arif et al. (2019), equations
    (11)-(15), whose last line, p = (1 - k) p, is p = k r here: the same number without the cancellation where p is
    much larger than r. An infinite p is the exact diffuse start: the limit p -> inf, in which v keeps its
    stationary distribution.
    """
    x, v, p, g, w = state
    if tau is not None:
        x, v, p, g, w = predict(over, state)
    else:
        p = p + over[2]
    s = p + r
    if math.isnan(y):
        return (x, v, p, g, w), 0.0, 0.0, math.nan, s, MISSING
    if math.isinf(p):
        return (y, 0.0, r, 0.0, w), 1.0, 0.0, math.nan, math.inf, START
    if s == 0.0 and not math.isnan(x):  # estimate and reading both claim to be exact: keep the estimate
        return (x, v, p, g, w), 0.0, 0.0, y - x, s, MISSING
    k = p / s if s > 0.0 else 0.0
    ell = g / s if s > 0.0 else 0.0
    if math.isnan(x):  # p0 is given, x0 is this first reading
        return (y, 0.0, k * r, ell * r, w - ell * g), k, ell, math.nan, s, START
    e = y - x
    if e * e > gate * s and rejected < GATE_LIMIT:
        return (x, v, p, g, w), 0.0, 0.0, e, s, REJECTED
    if tau is not None:
        return (x + k * e, v + ell * e, k * r, ell * r, w - ell * g), k, ell, e, s, UPDATED
    return (x + k * e, 0.0, k * r, 0.0, 0.0), k, 0.0, e, s, UPDATED


@compiled(plain=True, inner=True)
def filter_settled_rows(
    z: Array,
    i: int,
    over: Transition,
    tau: float | None,
    scales: Scales | None,
    gate: float,
    gains: tuple[float, float, float],
    ells: Array,
    x: float,
    v: float,
    states: States,
    readings: Readings,
    chi2: float,
    keep: bool | None,
) -> tuple[int, float, float, float]:
    """The rows of z from row i on, for `filter_rows`, with the variances and gains of the row before.

    `gains` are k, ell and s of its last sensor. Returns the first row that misses a reading or holds one for the
    gate, x and v before it, and `chi2` with Σ v²/s of the rows added.
    """
    out_x, out_v, out_p, out_g, out_w = states
    out_k, out_e, out_s = readings
    k, ell, s = gains
    row, limit, total = i - 1, gate * s, 0.0
    while i < z.shape[0]:
        x_next, v_next = x, v
        if tau is not None:
            x_next, v_next = x + over[1] * v, over[0] * v
        if scales is None:
            e = z[i, 0] - x_next
            if not e * e <= limit:  # a missing reading, or one for the gate
                break
            x_next = x_next + k * e
            if tau is not None:
                v_next = v_next + ell * e
            if keep is not None:
                total += e * e
                out_k[i, 0], out_e[i, 0], out_s[i, 0] = k, e, s
        else:
            good = True
            for j in range(z.shape[1]):
                e = (z[i, j] - scales[0][j]) / scales[1][j] - x_next
                good = good and e * e <= gate * out_s[row, j]
                x_next = x_next + out_k[row, j] * e
                if tau is not None:
                    v_next = v_next + ells[j] * e
                out_e[i, j] = e
            if not good:
                break
            for j in range(z.shape[1]):
                chi2 += out_e[i, j] / out_s[row, j] * out_e[i, j]
                out_k[i, j], out_s[i, j] = out_k[row, j], out_s[row, j]
        x, v = x_next, v_next
        out_x[i], out_p[i] = x, out_p[row]
        if tau is not None:
            out_v[i], out_g[i], out_w[i] = v, out_g[row], out_w[row]
        i += 1
    return i, x, v, chi2 + total / s


@compiled(plain=True)
def filter_rows(  # noqa: PLR0912, PLR0915 - one loop in place of six
    z: Array,
    dt: Array,
    q: float,
    tau: float | None,
    scales: Scales | None,
    r: Array,
    gate: float,
    state: State,
    tally: Tally,
    states: States,
    readings: Readings,
    ells: Array,
    keep: bool | None,
) -> tuple[State, float]:
    """Filter the rows of z (n, sensors) into `states` = (x, v, p, g, w) and `readings` = (k, innovation, s).

    `r` is on the scale of x, as are the readings. `dt` empty means regular sampling. Without momentum v, g and w
    are not written. `tally` is continued; `ells` (sensors,) is scratch. Returns the last state, and the
    log-likelihood of the scored readings. Of one sensor that reads x itself, `keep` None leaves out `readings` and
    the likelihood. Where the variances repeat themselves to the last bit, the gains are kept: the same numbers.
    """
    out_x, out_v, out_p, out_g, out_w = states
    out_k, out_e, out_s = readings
    in_a_row, refused, scored = tally
    n, width, regular = z.shape[0], z.shape[1], dt.shape[0] == 0
    last, over = 1.0, transition(1.0, q, tau)
    no_time = (1.0, 0.0, 0.0, 0.0, 0.0)
    chi2 = logdet = k = ell = s = 0.0
    m = i = 0
    if scales is None:
        width = 1
    while i < n:
        if not regular:
            if tau is None:
                over = (1.0, 0.0, q * dt[i], 0.0, 0.0)
            elif dt[i] != last:
                last = dt[i]
                over = transition(last, q, tau)
        before, move, updates = state, over, 0
        for j in range(width):
            y = z[i, j]
            if scales is not None:
                y = (y - scales[0][j]) / scales[1][j]
            state, k, ell, e, s, done = step(y, move, r[j], gate, state, in_a_row[j], tau)
            move = no_time
            if keep is not None:
                out_k[i, j], out_e[i, j], out_s[i, j] = k, e, s
            if tau is not None and scales is not None:
                ells[j] = ell
            if done == REJECTED:
                in_a_row[j] += 1
                refused[j] += 1
            elif done != MISSING:
                in_a_row[j] = 0
                if done == UPDATED:
                    scored[j] += 1
                    updates += 1
                    if keep is not None:
                        chi2 += e / s * e
                        logdet += math.log(s)
        x, v, p, g, w = state
        out_x[i], out_p[i] = x, p
        if tau is not None:
            out_v[i], out_g[i], out_w[i] = v, g, w
        m += updates
        i += 1
        if regular and updates == width and p == before[2] and g == before[3] and w == before[4]:
            first, gains = i, (k, ell, s)
            i, x, v, chi2 = filter_settled_rows(
                z, i, over, tau, scales, gate, gains, ells, x, v, states, readings, chi2, keep
            )
            state = x, v, p, g, w
            m += width * (i - first)
            for j in range(width):
                scored[j] += i - first
                if keep is not None:
                    logdet += (i - first) * math.log(out_s[first - 1, j])
    return state, -0.5 * (m * math.log(2.0 * math.pi) + logdet + chi2)


@compiled()
def denoise_samples(
    z: Array, dt: Array, q: float, tau: float | None, r: float, gate: float, state: State, out: Array
) -> int:
    """X only, of one sensor that reads x itself, into `out` (not z itself): in chunks once the gains have settled.

    Returns -1, or the index of the first infinite sample, where it stops.
    """
    n, regular = z.shape[0], dt.shape[0] == 0
    last, over, response = 1.0, transition(1.0, q, tau), np.empty((BLOCK, 5))
    in_a_row = i = chunks_from = 0
    while i < n:
        if math.isinf(z[i]):
            return i
        if not regular:
            if tau is None:
                over = (1.0, 0.0, q * dt[i], 0.0, 0.0)
            elif dt[i] != last:
                last = dt[i]
                over = transition(last, q, tau)
        before = state
        state, k, ell, _, _, done = step(z[i], over, r, gate, state, in_a_row, tau)
        in_a_row = in_a_row + 1 if done == REJECTED else (in_a_row if done == MISSING else 0)
        out[i] = state[0]
        i += 1
        if i < chunks_from or not regular or done != UPDATED or not math.isinf(gate):
            continue
        if not has_settled(before, state) or not (state[4] > 0.0 or k >= MIN_BLOCK_GAIN):
            continue
        respond_to_block(k, ell, over, response)
        x, v = state[0], state[1]
        while i + CHUNK <= n:
            x_next, v_next = advance_chunk(z[i : i + CHUNK], k, ell, over, response, x, v, out[i : i + CHUNK], tau)
            if not (math.isfinite(x_next) and math.isfinite(v_next)):
                break
            x, v = x_next, v_next
            i += CHUNK
        state = (x, v, state[2], state[3], state[4])
        chunks_from = i  # after the first sample of the next chunk that is not finite
        while chunks_from < min(i + CHUNK, n) and math.isfinite(z[chunks_from]):
            chunks_from += 1
        chunks_from += 1
    return -1


@compiled(inner=True, inline="always")
def has_settled(before: State, after: State) -> bool:
    """True where no variance changed by more than rounding."""
    return (
        abs(after[2] - before[2]) <= SETTLED_WITHIN * after[2]
        and abs(after[3] - before[3]) <= SETTLED_WITHIN * abs(after[3])
        and abs(after[4] - before[4]) <= SETTLED_WITHIN * after[4]
    )


@compiled(inner=True)
def respond_to_block(k: float, ell: float, over: Transition, response: Array) -> None:
    """How a block of the settled filter depends on the state before it: row j is sample j of BLOCK.

    Columns: the weights of x and v before the block in x_j, those in v_j, and the weight of z_j in the last v.
    """
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


@compiled(fastmath={"contract", "reassoc", "nsz"})
def advance_chunk(
    z: Array,
    k: float,
    ell: float,
    over: Transition,
    response: Array,
    x: float,
    v: float,
    out: Array,
    tau: float | None,
) -> tuple[float, float]:
    """Constant gains over one chunk, eight samples at once; returns the last x and v.

    Within a block c is x from the state 0, c_j = t c_(j-1) - d c_(j-2) + k z_j + b z_(j-1), the state equations
    with v eliminated (without momentum c_j = t c_(j-1) + k z_j): it does not wait for the block before. Then the
    faded state before the block is added. The fast-math flags let the compiler use its vector unit; the caller,
    compiled without them, looks for missing samples.
    """
    e, f = over[0], over[1]
    t, d, b = 1.0 - k, (1.0 - k) * e, ell * f - k * e
    if tau is not None:
        t = 1.0 - k + (e - ell * f)
    px, pv, last, h = response[:, 0], response[:, 1], response[BLOCK - 1], response[:, 4]
    for i in range(0, CHUNK, BLOCK):
        z0, z1, z2, z3 = z[i], z[i + 1], z[i + 2], z[i + 3]
        z4, z5, z6, z7 = z[i + 4], z[i + 5], z[i + 6], z[i + 7]
        c0 = k * z0
        if tau is not None:
            c1 = t * c0 + (k * z1 + b * z0)
            c2 = t * c1 + ((k * z2 + b * z1) - d * c0)
            c3 = t * c2 + ((k * z3 + b * z2) - d * c1)
            c4 = t * c3 + ((k * z4 + b * z3) - d * c2)
            c5 = t * c4 + ((k * z5 + b * z4) - d * c3)
            c6 = t * c5 + ((k * z6 + b * z5) - d * c4)
            c7 = t * c6 + ((k * z7 + b * z6) - d * c5)
            end = c7 + (px[7] * x + pv[7] * v)
            out[i], out[i + 1] = c0 + (px[0] * x + pv[0] * v), c1 + (px[1] * x + pv[1] * v)
            out[i + 2], out[i + 3] = c2 + (px[2] * x + pv[2] * v), c3 + (px[3] * x + pv[3] * v)
            out[i + 4], out[i + 5] = c4 + (px[4] * x + pv[4] * v), c5 + (px[5] * x + pv[5] * v)
            out[i + 6] = c6 + (px[6] * x + pv[6] * v)
            new = ((h[0] * z0 + h[1] * z1) + (h[2] * z2 + h[3] * z3)) + (
                (h[4] * z4 + h[5] * z5) + (h[6] * z6 + h[7] * z7)
            )
            v = new + (last[2] * x + last[3] * v)
            x = end
        else:
            c1 = t * c0 + k * z1
            c2 = t * c1 + k * z2
            c3 = t * c2 + k * z3
            c4 = t * c3 + k * z4
            c5 = t * c4 + k * z5
            c6 = t * c5 + k * z6
            c7 = t * c6 + k * z7
            out[i], out[i + 1] = c0 + px[0] * x, c1 + px[1] * x
            out[i + 2], out[i + 3] = c2 + px[2] * x, c3 + px[3] * x
            out[i + 4], out[i + 5] = c4 + px[4] * x, c5 + px[5] * x
            out[i + 6] = c6 + px[6] * x
            x = c7 + px[7] * x
        out[i + 7] = x
    return x, v


@compiled()
def smooth_states(dt: Array, q: float, tau: float | None, start: float, states: States) -> None:
    """The pass backwards over filtered `states` = (x, v, p, g, w), which it replaces; `start` is x where unknown.

    Rauch, Tung & Striebel (1965); with momentum in the form (I - C F) P (I - C F)' + C Q C' + C P' C', which is
    never negative. Before a diffuse start only what comes later is known: the model is run back in time.
    """
    out_x, out_v, out_p, out_g, out_w = states
    end, regular = out_x.shape[0] - 1, dt.shape[0] == 0
    x, p = float(out_x[end]), float(out_p[end])
    if tau is None:
        for i in range(end - 1, -1, -1):
            grown = q if regular else q * dt[i + 1]
            before = out_p[i]
            if math.isinf(before):
                p = p + grown
            else:
                ahead = before + grown
                j = before / ahead if ahead > 0.0 else 1.0
                here = start if math.isnan(out_x[i]) else out_x[i]
                x = here + j * (x - here)
                p = j * grown + j * j * p  # = before + j² (p - ahead), without the cancellation
            out_x[i], out_p[i] = x, p
        return
    last, over = 1.0, transition(1.0, q, tau)
    after = x, float(out_v[end]), p, float(out_g[end]), float(out_w[end])
    for i in range(end - 1, -1, -1):
        if not regular and dt[i + 1] != last:
            last = dt[i + 1]
            over = transition(last, q, tau)
        e, f, a, b, c = over
        here = start if math.isnan(out_x[i]) else out_x[i]
        if math.isinf(out_p[i]):
            after = predict((e, -f, a, -b, c), after)
        else:
            after = smoothed(over, (here, out_v[i], out_p[i], out_g[i], out_w[i]), after)
        out_x[i], out_v[i], out_p[i], out_g[i], out_w[i] = after


@compiled(inner=True, inline="always")
def smoothed(over: Transition, state: State, after: State) -> State:
    """The filtered `state`, given the smoothed state `after` it."""
    e, f, a, b, c = over
    x, v, p, g, w = state
    x_next, v_next, p_next, g_next, w_next = predict(over, state)
    # C = P F' / (F P F' + Q), multiplied out: what cancels in the products of large variances is left out
    to_x, to_v, det_p = p + f * g, g + f * w, p * w - g * g  # covariances with x of the next sample; det P
    det = (p_next - a) * c + (w_next - c) * a - 2.0 * (g_next - b) * b + (a * c - b * b) + e * e * det_p
    if det > 1e-14 * p_next * w_next:
        c11, c12 = (e * e * det_p + to_x * c - e * g * b) / det, (e * (g * a - f * det_p) - to_x * b) / det
        c21, c22 = (to_v * c - e * w * b) / det, (e * (det_p + w * a) - to_v * b) / det
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


@compiled(inner=True, inline="always")
def quadratic(a1: float, a2: float, b1: float, b2: float, p: float, g: float, w: float) -> float:
    """(a1, a2) [[p, g], [g, w]] (b1, b2)'."""
    return a1 * (p * b1 + g * b2) + a2 * (g * b1 + w * b2)


@compiled()
def filter_settled(
    z: Array, k: float, x: float, at: NDArray[np.intp], first: int, out: tuple[Array, Array]
) -> tuple[int, float, float]:
    """The settled random walk over the chunks of z, up to one with a sample that is missing or infinite.

    `at` are the samples kept, ascending, counted from `first` for z[0]: their x and innovation go into `out`. Each
    chunk is filtered relative to the x before it, which keeps the rounding small at any gain and level.

    Returns how many samples were filtered, the last x, and the sum of the squared innovations.
    """
    n, i, j, total = z.shape[0], 0, 0, 0.0
    response, rows, apart = np.empty((BLOCK, 5)), np.empty(CHUNK + 1), np.empty(CHUNK)
    respond_to_block(k, 0.0, (1.0, 0.0, 0.0, 0.0, 0.0), response)
    rows[0] = 0.0
    while i + CHUNK <= n:
        for m in range(CHUNK):
            apart[m] = z[i + m] - x
        moved, _ = advance_chunk(apart, k, 0.0, (1.0, 0.0, 0.0, 0.0, 0.0), response, 0.0, 0.0, rows[1:], None)
        if not math.isfinite(moved):
            break
        total += squared_distance(apart, rows)
        while j < at.shape[0] and at[j] < first + i + CHUNK:
            m = at[j] - first - i
            out[0][j], out[1][j] = x + rows[m + 1], apart[m] - rows[m]
            j += 1
        x += moved
        i += CHUNK
    return i, x, total


@compiled(fastmath={"contract", "reassoc", "nsz"})
def squared_distance(z: Array, x: Array) -> float:
    """Σ (z − x)² of one chunk, added in any order."""
    total = 0.0
    for j in range(CHUNK):
        total += (z[j] - x[j]) * (z[j] - x[j])
    return total
