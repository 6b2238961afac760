"""The compiled fit of many series, one after the other, nothing else: from samples to a row of numbers and a code.

It follows `methods.maximum_likelihood`, `known` and `verdict.conclude` step by step; a test holds it to `estimate`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.estimation.fleet.many.lane_kernels import loglik_of, sums_at, walk_sums
from kalscope.estimation.fleet.many.record_kernels import GOOD, INFINITE, shows_steps, take_apart
from kalscope.estimation.fleet.many.search_kernels import find_peak

Array = NDArray[np.float64]

OK, FLAT, NO_NOISE, NO_MOVEMENT, TOO_FEW, CONSTANT, BAD_UNIT, HOLDS_INF, BAD_STEPS = range(9)
"""Verdicts by their numbers, the first of `table.VERDICTS`."""

Q, R, Q_SE, R_SE, LOGLIK, LOW, HIGH = range(7)
"""The rows of numbers."""

ROWS = 7
FREE, KNOWN_R, KNOWN_RATIO = range(3)
"""What is known: nothing, r, or λ."""

MIN_SAMPLES, MIN_VARIANCE, MAX_VARIANCE, MAX_FACTOR = 8, 1e-300, 1e300, 1e100
MIN_CHANGES, MAX_CHANGING = 3, 0.8
DERIVATIVE_STEP = 1e-3
"""As in the modules that are followed; a test holds them equal."""


@compiled()
def fit_each(
    values: Array,
    steps: Array,
    starts: NDArray[np.int64],
    kind: int,
    known: Array,
    numbers: Array,
    codes: NDArray[np.uint8],
    counts: NDArray[np.int64],
    stepped: NDArray[np.bool_],
) -> None:
    """Fit each series: `numbers` (ROWS, k), `codes`, finite samples and whether readings repeat as if rounded."""
    longest = 1
    for i in range(codes.shape[0]):
        longest = max(longest, starts[i + 1] - starts[i])
    d, gap = np.empty(longest), np.empty(longest)
    for i in range(codes.shape[0]):
        here = slice(starts[i], starts[i + 1])
        found, m, gaps, n, scale = take_apart(values[here], steps[here] if len(steps) else steps, d, gap)
        for row in range(ROWS):
            numbers[row, i] = math.inf if row in (Q_SE, R_SE, HIGH) else 0.0
        counts[i], stepped[i] = n, False
        if found != GOOD:
            codes[i] = HOLDS_INF if found == INFINITE else BAD_STEPS
        elif n < MIN_SAMPLES:
            codes[i] = TOO_FEW
        elif not d[:m].any():
            codes[i] = CONSTANT
        else:
            codes[i] = fit_one(d[:m], gap[:gaps], scale, kind, known[i], numbers[:, i])
            stepped[i] = codes[i] <= NO_NOISE and shows_steps(d[:m], MIN_CHANGES, MAX_CHANGING)


@compiled(error_model="numpy")
def fit_one(d: Array, gap: Array, scale: float, kind: int, known: float, out: Array) -> int:
    """Fit the differences of one series into `out`; its code."""
    noise, highest = 0.0, 24.0
    if kind == KNOWN_R:
        noise = known / scale / scale
        if not 1.0 / MAX_FACTOR < noise < MAX_FACTOR:
            return BAD_UNIT
        highest = max(24.0, 4.0 - math.log(noise))
    chi2, logdet, moved = walk_sums(d, gap)
    q_walk = chi2 / moved if moved else 0.0
    at_infinity = -math.inf
    if moved and kind != KNOWN_R:
        at_infinity = loglik_of(q_walk * d.shape[0], logdet, d.shape[0], scale, 0.0)
    top, _, bend, low, high = find_peak(d, gap, scale, noise, highest, at_infinity)
    place = math.log(known) if kind == KNOWN_RATIO else top
    if place == math.inf:
        pair = q_walk, 0.0, q_walk * math.sqrt(2.0 / d.shape[0]), math.inf
        loglik = at_infinity if moved == d.shape[0] else -math.inf
    else:
        pair, loglik = pair_at(d, gap, scale, kind, place, bend, noise)
    q, r, unit = pair[0] * scale * scale, pair[1] * scale * scale, scale * scale
    if (pair[0] > 0.0 and not MIN_VARIANCE < q <= MAX_VARIANCE) or (
        pair[1] > 0.0 and not MIN_VARIANCE < r <= MAX_VARIANCE
    ):
        return BAD_UNIT
    out[Q], out[R], out[Q_SE], out[R_SE], out[LOGLIK] = q, r, pair[2] * unit, pair[3] * unit, loglik
    out[LOW], out[HIGH] = math.exp(low), math.exp(high) if high < 700.0 else math.inf
    if pair[1] == 0.0:
        return NO_NOISE
    if pair[0] == 0.0:
        return NO_MOVEMENT
    return FLAT if low == -math.inf and high == math.inf else OK


@compiled(error_model="numpy")
def pair_at(
    d: Array, gap: Array, scale: float, kind: int, place: float, bend: float, noise: float
) -> tuple[tuple[float, float, float, float], float]:
    """q, r and their standard errors in scale² at a finite or lowest ln λ, and the log-likelihood."""
    m = d.shape[0]
    near = np.array([place, place - DERIVATIVE_STEP, place + DERIVATIVE_STEP])
    chi2, logdet = np.empty(3), np.empty(3)
    sums_at(d, gap, near, chi2, logdet)
    loglik = loglik_of(chi2[0], logdet[0], m, scale, noise)
    ratio, spread = math.exp(place), 2.0 / m
    if kind == KNOWN_R:
        q = ratio * noise
        return (q, noise, q / math.sqrt(-bend) if bend < 0.0 else math.inf, 0.0), loglik
    r = chi2[0] / m
    q = ratio * r
    if kind == KNOWN_RATIO:
        return (q, r, q * math.sqrt(spread), r * math.sqrt(spread)), loglik
    if place == -math.inf:
        return (0.0, r, math.inf, r * math.sqrt(spread)), loglik
    variance = -1.0 / bend if bend < 0.0 else math.inf
    slope = math.log(chi2[2] / chi2[1]) / (2.0 * DERIVATIVE_STEP)
    q_se = q * math.sqrt(spread + (1.0 + slope) ** 2 * variance)
    return (q, r, q_se, r * math.sqrt(spread + slope**2 * variance)), loglik
