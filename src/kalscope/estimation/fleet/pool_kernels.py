"""The compiled loops over a fleet that shares one λ, nothing else: its sums, and what each device loses."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.estimation.fleet.many.fit_kernels import FREE, LOGLIK, MIN_SAMPLES, ROWS, Q, R, fit_one
from kalscope.estimation.fleet.many.lane_kernels import loglik_of, sums_at, walk_sums
from kalscope.estimation.fleet.many.record_kernels import GOOD, take_apart

Array = NDArray[np.float64]

M_LOG_R, LOG_R, CHI2, LOGDET = range(4)
"""The rows of sums at each ln λ: Σ m ln r̂, Σ ln r̂ with the best r̂ = χ²/m of each device, ΣΣv²/f and ΣΣln f."""

SUMS = 4
SMALLEST, LARGEST = 1e-145, 1e145
"""Scales whose squares stay within a double."""

OWN_RATIO, OWN_LOGLIK, NOISE, SHARED_LOGLIK, GIVEN_LOGLIK, SLOPE, HELD_OUT, HELD_OUT_OWN = range(8)
"""The rows of what a device loses."""

LOSSES = 8
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
def lose_each(
    values: Array,
    steps: Array,
    starts: NDArray[np.int64],
    ratio: Array,
    noise: float,
    losses: Array,
    counted: NDArray[np.bool_],
) -> None:
    """What each series loses by its `ratio`, (k,), and the common `noise`, unit² (0 = none): (LOSSES, k)."""
    longest = np.max(starts[1:] - starts[:-1])
    d, gap, out = np.empty(longest), np.empty(longest), np.empty(ROWS)
    for i in range(starts.shape[0] - 1):
        here = slice(starts[i], starts[i + 1])
        found, m, gaps, n, scale = take_apart(values[here], steps[here] if len(steps) else steps, d, gap)
        counted[i] = is_fit(d[:m], found, n, scale)
        for row in range(LOSSES):
            losses[row, i] = math.nan
        if counted[i]:
            lose_one(d[:m], gap[:gaps], scale, ratio[i], noise, out, losses[:, i])


@compiled(error_model="numpy")
def lose_one(d: Array, gap: Array, scale: float, ratio: float, noise: float, out: Array, loss: Array) -> None:
    """`lose_each` of one series."""
    m, half = d.shape[0], d.shape[0] // 2
    log_ratio = math.log(ratio)
    near = np.array([log_ratio, log_ratio - SLOPE_STEP, log_ratio + SLOPE_STEP])
    chi2, logdet = np.empty(3), np.empty(3)
    sums_at(d, gap, near, chi2, logdet)
    loss[NOISE] = chi2[0] / m * scale * scale
    loss[SHARED_LOGLIK] = loglik_of(chi2[0], logdet[0], m, scale, 0.0)
    loss[GIVEN_LOGLIK] = loss[SHARED_LOGLIK]
    around = [loss[SHARED_LOGLIK], 0.0, 0.0]
    for j in range(3):
        around[j] = loglik_of(chi2[j], logdet[j], m, scale, noise / scale / scale)
    if noise > 0.0:
        loss[GIVEN_LOGLIK] = around[0]
    loss[SLOPE] = (around[2] - around[1]) / (2.0 * SLOPE_STEP)
    if fit_one(d, gap, scale, FREE, 0.0, out) < MIN_SAMPLES and out[Q] + out[R] > 0.0:
        loss[OWN_RATIO], loss[OWN_LOGLIK] = out[Q] / out[R], out[LOGLIK]
    first = gap[:half] if gap.shape[0] else gap
    if half < MIN_SAMPLES or not d[:half].any():
        return
    fit_one(d[:half], first, scale, FREE, 0.0, out)
    if out[Q] + out[R] > 0.0:
        loss[HELD_OUT] = scale * unseen_error(d, gap, ratio, half)
        loss[HELD_OUT_OWN] = scale * unseen_error(d, gap, out[Q] / out[R], half)


@compiled(error_model="numpy")
def unseen_error(d: Array, gap: Array, ratio: float, since: int) -> float:
    """Root mean square of the innovations from `since` on of the filter of one λ, 0 … ∞."""
    v, p, kept, squares = 0.0, 1.0, 0.0, 0.0
    walk = math.isinf(ratio)
    for i in range(d.shape[0]):
        v = d[i] + kept * v
        if not walk:
            predicted = p + ratio * (gap[i] if gap.shape[0] else 1.0)
            kept = 1.0 / (predicted + 1.0)
            p = predicted * kept
        if i >= since:
            squares += v * v
    return math.sqrt(squares / (d.shape[0] - since))
