"""The compiled loops over a fleet that shares one λ, nothing else: its sums, and what each device loses."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.estimation.fleet.error_kernels import MAX_FINITE, squares_since
from kalscope.estimation.fleet.many.fit_kernels import MIN_SAMPLES
from kalscope.estimation.fleet.many.lane_kernels import loglik_of, sums_at, walk_sums
from kalscope.estimation.fleet.many.record_kernels import GOOD, take_apart

Array = NDArray[np.float64]

M_LOG_R, LOG_R, CHI2, LOGDET = range(4)
"""The rows of sums at each ln λ: Σ m ln r̂, Σ ln r̂ with the best r̂ = χ²/m of each device, ΣΣv²/f and ΣΣln f."""

SUMS = 4
SMALLEST, LARGEST = 1e-145, 1e145
"""Scales whose squares stay within a double."""

NOISE, LOGLIK, SLOPE, ERROR, OWN_ERROR = range(5)
"""The columns of what a device has under a shared λ."""

SHARED = 5
SLOPE_STEP = 1e-3
"""Step in ln λ for the slope of the log-likelihood."""


@compiled()
def is_fit(d: Array, found: int, n: int, scale: float) -> bool:
    """Whether a series counts in the pool: it can be fitted, and its squares fit a double."""
    return found == GOOD and n >= MIN_SAMPLES and bool(d.any()) and SMALLEST < scale < LARGEST


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

    The columns are the finite `log_ratios`, then λ = 0, then λ = ∞, where q̂ stands in place of r̂.
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


@compiled(error_model="numpy")
def share_each(
    values: Array,
    steps: Array,
    starts: NDArray[np.int64],
    ratio: Array,
    noise: float,
    half_ratio: Array,
    shared: Array,
    counted: NDArray[np.bool_],
) -> None:
    """What each series has under its `ratio`, (k,), and the common `noise`, unit² (0 = none): (k, SHARED).

    `half_ratio` is the λ that fits the first half of each, NaN where nothing does.
    """
    longest = np.max(starts[1:] - starts[:-1])
    d, gap = np.empty(longest), np.empty(longest)
    both, state = np.empty(2), np.empty(8)
    near, chi2, logdet, logliks = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(starts.shape[0] - 1):
        first, middle, stop = starts[i], (starts[i] + starts[i + 1]) // 2, starts[i + 1]
        known = take_apart(values[first:middle], steps[first:middle] if len(steps) else steps, d, gap)[1]
        found, m, gaps, n, scale = take_apart(
            values[first:stop], steps[first:stop] if len(steps) else steps, d, gap
        )
        counted[i] = is_fit(d[:m], found, n, scale)
        for j in range(SHARED):
            shared[i, j] = math.nan
        if not counted[i]:
            continue
        near[:] = math.log(ratio[i])
        near[1] -= SLOPE_STEP
        near[2] += SLOPE_STEP
        sums_at(d[:m], gap[:gaps], near, chi2, logdet)
        for j in range(3):
            logliks[j] = loglik_of(chi2[j], logdet[j], m, scale, noise / scale / scale)
        shared[i, NOISE] = chi2[0] / m * scale * scale
        shared[i, LOGLIK] = logliks[0]
        shared[i, SLOPE] = (logliks[2] - logliks[1]) / (2.0 * SLOPE_STEP)
        if not math.isnan(half_ratio[i]) and known < m:
            both[0], both[1] = ratio[i], min(half_ratio[i], MAX_FINITE)
            squares_since(d[:m], gap[:gaps], both, known, state)
            shared[i, ERROR] = scale * math.sqrt(state[6] / (m - known))
            shared[i, OWN_ERROR] = scale * math.sqrt(state[7] / (m - known))
