"""The compiled loops over a fleet that shares one λ, nothing else: its sums."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.estimation.fleet.many.fit_kernels import MIN_SAMPLES
from kalscope.estimation.fleet.many.lane_kernels import sums_at, walk_sums
from kalscope.estimation.fleet.many.record_kernels import GOOD, take_apart

Array = NDArray[np.float64]

M_LOG_R, LOG_R, CHI2, LOGDET, SLOPES = range(5)
"""The rows of sums at each ln λ: Σ m ln r̂, Σ ln r̂ with the best r̂ = χ²/m of each device, ΣΣv²/f, ΣΣln f, and the
sum of the squares of each device's slope of the log-likelihood with its best r̂, 0 at the ends."""

SUMS = 5
SMALLEST, LARGEST = 1e-145, 1e145
"""Scales whose squares stay within a double."""


@compiled()
def is_fit(d: Array, found: int, n: int, scale: float) -> bool:
    """Whether a series counts in the pool: it can be fitted, and its squares fit a double."""
    return found == GOOD and n >= MIN_SAMPLES and bool(d.any()) and SMALLEST < scale < LARGEST


@compiled(error_model="numpy")
def add_slopes(log_ratios: Array, chi2: Array, logdet: Array, m: int, squares: Array) -> None:
    """Add the square of one device's slope at each ln λ but the first and the last."""
    for j in range(1, log_ratios.shape[0] - 1):
        change = m * math.log(chi2[j + 1] / chi2[j - 1]) + logdet[j + 1] - logdet[j - 1]
        slope = -0.5 * change / (log_ratios[j + 1] - log_ratios[j - 1])
        squares[j] += slope * slope


@compiled(error_model="numpy")
def add_up(
    values: Array,
    steps: Array,
    starts: NDArray[np.int64],
    log_ratios: Array,
    sums: Array,
    counts: NDArray[np.int64],
) -> None:
    """Add every series to `sums` (SUMS, lanes) and to `counts` (devices, innovations).

    The columns are the finite `log_ratios`, then λ = 0, then λ = ∞, where q̂ replaces r̂.
    """
    lanes = log_ratios.shape[0] + 1
    places = np.append(log_ratios, -math.inf)
    chi2, logdet = np.empty(lanes), np.empty(lanes)
    longest = np.max(starts[1:] - starts[:-1])
    d, gap = np.empty(longest), np.empty(longest)
    for i in range(starts.shape[0] - 1):
        here = slice(starts[i], starts[i + 1])
        found, m, gaps, n, scale = take_apart(values[here], steps[here] if len(steps) else steps, d, gap)
        if not is_fit(d[:m], found, n, scale):
            continue
        sums_at(d[:m], gap[:gaps], places, chi2, logdet)
        add_slopes(log_ratios, chi2, logdet, m, sums[SLOPES])
        for j in range(lanes + 1):
            if j < lanes:
                squares, logs = chi2[j], logdet[j]
            else:
                squares, logs, _ = walk_sums(d[:m], gap[:gaps])
            log_r = math.log(squares / m) + 2.0 * math.log(scale)
            sums[M_LOG_R, j] += m * log_r
            sums[LOG_R, j] += log_r
            sums[CHI2, j] += squares * scale * scale
            sums[LOGDET, j] += logs
        counts[0] += 1
        counts[1] += m
