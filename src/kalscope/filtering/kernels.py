"""The compiled loops of the scalar filter and its smoother: one channel, contiguous float64, no checks.

Every loop releases the GIL (a reader thread must not starve) and is cached on disk. None is parallel.
`step` is the only place where the filter's five lines are written; every driver below calls it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled

Array = NDArray[np.float64]

MISSING, START, REJECTED, UPDATED = 0, 1, 2, 3
"""What `step` did with a sample: predicted only; set the start; rejected it at the gate; updated."""

GATE_LIMIT = 5
"""Samples in a row that the outlier gate may reject; the next one is used, so the filter cannot get stuck."""

CHUNK = 256
"""Samples, a multiple of eight, that the settled filter advances before it looks for a missing one."""

MIN_BLOCK_GAIN = 1e-3
"""Below this gain the settled filter stays sample by sample: rounding grows like 1/gain (limit 1e-12)."""

MAX_DOUBLE = float(np.finfo(np.float64).max)

Step = tuple[float, float, float, float, float, int]


@compiled(plain=True, inline="always")
def step(z: float, dt: float, q: float, r: float, gate: float, x: float, p: float, rejected: int) -> Step:
    """One sample: predict over `dt` periods, then update; `rejected` counts gate rejections in a row.

    Returns x, p, k, v (innovation), s (its variance) and what was done. Interactive matter (2009), C listing;
    Ma'arif et al. (2019), equations (11)-(15), whose last line, p = (1 - k) p, is p = k r here: the same number
    without the cancellation where p is much larger than r.
    """
    p = p + q * dt
    s = p + r
    if math.isnan(z):
        return x, p, 0.0, math.nan, s, MISSING
    if math.isinf(p):  # exact diffuse start: the limit of the lines below for p -> inf
        return z, r, 1.0, math.nan, math.inf, START
    if math.isnan(x):  # p0 is given, x0 is this first sample
        k = p / s if s > 0.0 else 0.0
        return z, k * r, k, math.nan, s, START
    v = z - x
    if s == 0.0:  # estimate and sample both claim to be exact (r = 0 and no time passed): keep the estimate
        return x, p, 0.0, v, s, MISSING
    if v * v > gate * s and rejected < GATE_LIMIT:
        return x, p, 0.0, v, s, REJECTED
    k = p / s
    return x + k * v, k * r, k, v, s, UPDATED


@compiled(plain=True)
def filter_channel(
    z: Array,
    dt: Array,
    q: float,
    r: float,
    gate: float,
    x: float,
    p: float,
    in_a_row: int,
    out: tuple[Array, Array, Array, Array, Array],
) -> tuple[float, int, int, int]:
    """Filter one channel into `out` = (x, p, k, v, s); `dt` empty means regular sampling.

    `in_a_row` counts gate rejections right before the first sample. Returns the log-likelihood over the m scored
    innovations, m, the number of gate rejections, and those right at the end. Where the variance repeats itself to
    the last bit, the gain is kept instead of computed again: the same numbers.
    """
    out_x, out_p, out_k, out_v, out_s = out
    n, regular = z.shape[0], dt.shape[0] == 0
    chi2 = logdet = 0.0
    m = refused = i = 0
    while i < n:
        before = p
        x, p, k, v, s, done = step(z[i], 1.0 if regular else dt[i], q, r, gate, x, p, in_a_row)
        out_x[i], out_p[i], out_k[i], out_v[i], out_s[i] = x, p, k, v, s
        i += 1
        if done == REJECTED:
            refused += 1
            in_a_row += 1
            continue
        if done == MISSING:
            continue
        in_a_row = 0
        if done == START:
            continue
        m += 1
        chi2 += v / s * v
        logdet += math.log(s)
        if regular and p == before:
            first, sum_v2, limit = i, 0.0, gate * s
            while i < n:
                v = z[i] - x
                if not v * v <= limit:  # a missing sample, or one for the gate
                    break
                x = x + k * v
                sum_v2 += v * v
                out_x[i], out_p[i], out_k[i], out_v[i], out_s[i] = x, p, k, v, s
                i += 1
            m += i - first
            chi2 += sum_v2 / s
            logdet += (i - first) * math.log(s)
    return -0.5 * (m * math.log(2.0 * math.pi) + logdet + chi2), m, refused, in_a_row


@compiled()
def denoise_channel(z: Array, dt: Array, q: float, r: float, gate: float, x: float, p: float, out: Array) -> int:
    """Filter one channel into `out` (not z itself), x only: in chunks once the variance has settled.

    Returns -1, or the index of the first infinite sample, where it stops.
    """
    n, regular = z.shape[0], dt.shape[0] == 0
    in_a_row = i = 0
    while i < n:
        if math.isinf(z[i]):
            return i
        before = p
        x, p, k, _, _, done = step(z[i], 1.0 if regular else dt[i], q, r, gate, x, p, in_a_row)
        in_a_row = in_a_row + 1 if done == REJECTED else (in_a_row if done == MISSING else 0)
        out[i] = x
        i += 1
        settled = regular and done == UPDATED and abs(p - before) <= 2e-16 * p
        if settled and k >= MIN_BLOCK_GAIN and math.isinf(gate):
            i, x = advance_settled(z, k, x, i, out)
    return -1


@compiled()
def advance_settled(z: Array, k: float, x: float, i: int, out: Array) -> tuple[int, float]:
    """Constant gain from sample `i` on, chunk by chunk, up to the first sample that is not finite.

    Returns the first index not yet filtered (less than a chunk is left, or a sample is not finite) and x.
    """
    while i + CHUNK <= z.shape[0]:
        end = advance_chunk(z[i : i + CHUNK], k, x, out[i : i + CHUNK])
        if not abs(end) <= MAX_DOUBLE:
            while abs(out[i]) <= MAX_DOUBLE:
                x = out[i]
                i += 1
            return i, x
        x = end
        i += CHUNK
    return i, x


@compiled(fastmath={"contract", "reassoc", "nsz"})
def advance_chunk(z: Array, k: float, x: float, out: Array) -> float:
    """Constant gain over one chunk, eight samples at once; returns the last x.

    Within a block y_j = x + (c_j - g_j x) with c_j = a c_(j-1) + k z_j, a = 1 - k and g_j the same sum for
    z = 1. Only c_8 - g_8 x waits for the block before, so the processor works on several blocks at once.
    The fast-math flags let the compiler use its vector unit; the caller, compiled without them, looks for
    missing samples.
    """
    a = 1.0 - k
    g1 = k
    g2 = a * g1 + k
    g3 = a * g2 + k
    g4 = a * g3 + k
    g5 = a * g4 + k
    g6 = a * g5 + k
    g7 = a * g6 + k
    g8 = a * g7 + k
    for i in range(0, CHUNK, 8):
        c1 = k * z[i]
        c2 = a * c1 + k * z[i + 1]
        c3 = a * c2 + k * z[i + 2]
        c4 = a * c3 + k * z[i + 3]
        c5 = a * c4 + k * z[i + 4]
        c6 = a * c5 + k * z[i + 5]
        c7 = a * c6 + k * z[i + 6]
        c8 = a * c7 + k * z[i + 7]
        out[i] = x + (c1 - g1 * x)
        out[i + 1] = x + (c2 - g2 * x)
        out[i + 2] = x + (c3 - g3 * x)
        out[i + 3] = x + (c4 - g4 * x)
        out[i + 4] = x + (c5 - g5 * x)
        out[i + 5] = x + (c6 - g6 * x)
        out[i + 6] = x + (c7 - g7 * x)
        x = x + (c8 - g8 * x)
        out[i + 7] = x
    return x


@compiled()
def smooth_channel(
    z: Array, dt: Array, q: float, r: float, gate: float, x: float, p: float, out_x: Array, out_p: Array
) -> None:
    """Smooth one channel into `out_x`, `out_p`, which hold the filtered values in between.

    `dt` empty means regular sampling. No other memory is used: the backward pass replaces each filtered value once
    it has been read.
    """
    n = z.shape[0]
    filter_forward(z, dt, q, r, gate, x, p, out_x, out_p)
    first = 0
    while first < n and math.isnan(out_x[first]):
        first += 1
    if first < n:
        smooth_backwards(dt, q, out_x[first], out_x, out_p)


@compiled()
def smooth_backwards(dt: Array, q: float, start: float, out_x: Array, out_p: Array) -> None:
    """The backward pass over filtered `out_x`, `out_p`; `start` is used for x before it is known."""
    last, regular = out_x.shape[0] - 1, dt.shape[0] == 0
    x, p = float(out_x[last]), float(out_p[last])
    for i in range(last - 1, -1, -1):
        grown = q if regular else q * dt[i + 1]
        p_i = out_p[i]
        if math.isinf(p_i):  # before a diffuse start only what comes later is known
            p = p + grown
        else:
            p_pred = p_i + grown
            j = p_i / p_pred if p_pred > 0.0 else 1.0
            x_i = start if math.isnan(out_x[i]) else out_x[i]
            x = x_i + j * (x - x_i)
            p = j * grown + j * j * p  # = p_i + j² (p − p_pred), without the cancellation
        out_x[i], out_p[i] = x, p


@compiled()
def filter_forward(
    z: Array, dt: Array, q: float, r: float, gate: float, x: float, p: float, out_x: Array, out_p: Array
) -> None:
    """The filter's x and p only; the same numbers as `filter_channel`, bit for bit."""
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
