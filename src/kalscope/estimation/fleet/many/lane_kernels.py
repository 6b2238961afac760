"""The compiled log-likelihood of one series at many λ, nothing else: the lanes sorted, scanned, and read.

The same sums as `Differences.sums`, lane for lane; see `likelihood.kernels` for how a lane works.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.estimation.likelihood.kernels import LANES, scan_ratios

Array = NDArray[np.float64]

LOG_2_PI = math.log(2.0 * math.pi)


@compiled()
def sums_at(d: Array, gap: Array, log_ratios: Array, chi2: Array, logdet: Array) -> None:
    """Σv²/f (in scale²) and Σln f for each ln λ, in any order; −inf is λ = 0."""
    count = log_ratios.shape[0]
    order = falling(log_ratios)
    lanes = count + -count % LANES
    ratio, squares, logs = np.empty(lanes), np.empty(lanes), np.empty(lanes)
    for j in range(lanes):
        ratio[j] = math.exp(log_ratios[order[min(j, count - 1)]])
    scan_ratios(d, gap, ratio, squares, logs)
    for j in range(count):
        chi2[order[j]], logdet[order[j]] = squares[j], logs[j]


@compiled()
def falling(values: Array) -> NDArray[np.intp]:
    """The indices of some dozens of values in descending order; of equal ones the first comes first."""
    order = np.empty(values.shape[0], np.intp)
    for i in range(values.shape[0]):
        j = i
        while j > 0 and values[order[j - 1]] < values[i]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = i
    return order


@compiled(error_model="numpy")
def loglik_of(chi2: float, logdet: float, m: int, scale: float, noise: float) -> float:
    """Log-likelihood of the sums in the unit of the data: with `noise` as r in scale², or 0 for the best r."""
    if noise > 0.0:
        return -0.5 * (m * (LOG_2_PI + math.log(noise) + 2.0 * math.log(scale)) + logdet + chi2 / noise)
    log_r = (np.log(chi2 / m)) + 2.0 * math.log(scale)
    return -0.5 * (m * (LOG_2_PI + 1.0 + log_r) + logdet)


@compiled()
def logliks_at(d: Array, gap: Array, log_ratios: Array, scale: float, noise: float, values: Array) -> None:
    """`loglik_of` each ln λ into `values`."""
    logdet = np.empty_like(values)
    sums_at(d, gap, log_ratios, values, logdet)
    for j in range(log_ratios.shape[0]):
        values[j] = loglik_of(values[j], logdet[j], d.shape[0], scale, noise)


@compiled(error_model="numpy")
def walk_sums(d: Array, gap: Array) -> tuple[float, float, int]:
    """λ = ∞: Σd²/g in scale², Σln g, and the steps that count; inf where two samples of one instant differ."""
    chi2 = logdet = 0.0
    moved = 0
    if gap.shape[0] == 0:
        for value in d:
            chi2 += value * value
        return chi2, 0.0, d.shape[0]
    for i in range(d.shape[0]):
        if gap[i] > 0.0:
            chi2 += d[i] * d[i] / gap[i]
            logdet += math.log(gap[i])
            moved += 1
        elif d[i] != 0.0:
            return math.inf, 0.0, 0
    return chi2, logdet, moved
