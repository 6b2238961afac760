"""The settled filter on eight stretches of a record at once: compiled loops, nothing else.

One recursion waits 12 processor cycles for each sample; eight independent ones take no longer.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled

Array = NDArray[np.float64]

LANES = 8
"""Stretches that are filtered at once."""

BLOCK = 384
"""Samples that every lane takes before what is drawn of them is picked; a multiple of all periods of the gain."""


@compiled()
def filter_lanes(
    z: Array,
    warm: int,
    k: Array,
    weight: Array,
    x: float,
    at: NDArray[np.intp],
    begin: NDArray[np.intp],
    end: NDArray[np.intp],
    out: tuple[Array, Array],
) -> tuple[int, float, float]:
    """Filter z, of warm + 8 n samples; lane l runs from sample l n to warm + (l + 1) n.

    Lane 0 begins with `x`. Every other one begins with a guess, and what it does with its first `warm` samples is
    done by the lane before too: it counts only if both then hold the same x to the last bit, which decides all that
    follows. `k` and `weight` = 1/s are those of one block. `at` are the samples kept, begin[l] to end[l] those of
    lane l, whose x and innovation go into `out`. warm and n are multiples of BLOCK.

    Returns how many lanes count (the first ones; none where a sample is missing or infinite in lane 0), the last x
    of these, and their Σ v²/s.
    """
    n, out_x, out_v = (z.shape[0] - warm) // LANES, out[0], out[1]
    rows = np.empty((LANES, BLOCK + 1))
    warmed, chi2 = np.empty(LANES), np.zeros(LANES)
    for lane in range(LANES):
        rows[lane, BLOCK] = z[lane * n] if lane else x
    for t in range(0, warm + n, BLOCK):
        if t == warm:
            warmed[:] = rows[:, BLOCK]
        rows[:, 0] = rows[:, BLOCK]
        filter_blocks(z[t:], n, k, rows)
        for lane in range(LANES):
            if lane and t < warm:
                continue
            first, i = lane * n + t, begin[lane]
            chi2[lane] += weighted_squares(z[first : first + BLOCK], rows[lane], weight)
            while i < end[lane] and at[i] < first + BLOCK:
                j = at[i] - first
                out_x[i], out_v[i] = rows[lane, j + 1], z[at[i]] - rows[lane, j]
                i += 1
            begin[lane] = i
    lanes, last, total = 0, x, 0.0
    while lanes < LANES and np.isfinite(rows[lanes, BLOCK]) and (lanes == 0 or last == warmed[lanes]):
        last, total = rows[lanes, BLOCK], total + chi2[lanes]
        lanes += 1
    return lanes, last, total


@compiled()
def filter_blocks(z: Array, n: int, k: Array, rows: Array) -> None:
    """One block in all lanes: rows[l, 0] is the x before, rows[l, 1:] becomes that after each sample of z[l n:]."""
    a, b, c, d, e, f, g, h = rows
    a0, b0, c0, d0, e0, f0, g0, h0 = a[0], b[0], c[0], d[0], e[0], f[0], g[0], h[0]
    for j in range(BLOCK):
        a0 = a0 + k[j] * (z[j] - a0)
        b0 = b0 + k[j] * (z[j + n] - b0)
        c0 = c0 + k[j] * (z[j + 2 * n] - c0)
        d0 = d0 + k[j] * (z[j + 3 * n] - d0)
        e0 = e0 + k[j] * (z[j + 4 * n] - e0)
        f0 = f0 + k[j] * (z[j + 5 * n] - f0)
        g0 = g0 + k[j] * (z[j + 6 * n] - g0)
        h0 = h0 + k[j] * (z[j + 7 * n] - h0)
        a[j + 1], b[j + 1], c[j + 1], d[j + 1] = a0, b0, c0, d0
        e[j + 1], f[j + 1], g[j + 1], h[j + 1] = e0, f0, g0, h0


@compiled(fastmath={"contract", "reassoc", "nsz"})
def weighted_squares(z: Array, x: Array, weight: Array) -> float:
    """Σ weight (z − x)² of one block, added in any order."""
    total = 0.0
    for j in range(BLOCK):
        total += weight[j] * (z[j] - x[j]) * (z[j] - x[j])
    return total
