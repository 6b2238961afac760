"""The compiled fit of many series, one after the other, nothing else: from samples to a row of numbers and a code.

It follows `methods.maximum_likelihood`, `known` and `verdict.conclude` step by step; a test compares the two.
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

Q, R, Q_SE, R_SE, LOGLIK, LOW, HIGH, Q_LOW, Q_HIGH, R_LOW, R_HIGH = range(11)
"""The columns of numbers."""

NUMBERS = 11
FREE, KNOWN_R, KNOWN_RATIO = range(3)
"""What is known: nothing, r, or λ."""

MIN_SAMPLES, MIN_VARIANCE, MAX_VARIANCE, MAX_FACTOR = 8, 1e-300, 1e300, 1e100
MIN_CHANGES, MAX_CHANGING = 3, 0.8
DERIVATIVE_STEP = 1e-3
NORMAL = 1.9599639845400545
"""As in the modules that are followed; a test checks that they are equal."""


@compiled()
def fit_each(
    values: Array,
    steps: Array,
    starts: NDArray[np.int64],
    ends: NDArray[np.int64],
    kind: int,
    known: Array,
    numbers: Array,
    codes: NDArray[np.uint8],
    counts: NDArray[np.int64],
    stepped: NDArray[np.bool_],
) -> None:
    """Fit each series: `numbers` (k, NUMBERS), `codes`, finite samples and whether readings repeat."""
    longest = 1
    for i in range(codes.shape[0]):
        longest = max(longest, ends[i] - starts[i])
    d, gap = np.empty(longest), np.empty(longest)
    for i in range(codes.shape[0]):
        here = slice(starts[i], ends[i])
        found, m, gaps, n, scale = take_apart(values[here], steps[here] if len(steps) else steps, d, gap)
        for j in range(NUMBERS):
            numbers[i, j] = math.inf if j in (Q_SE, R_SE, HIGH, Q_HIGH, R_HIGH) else 0.0
        counts[i], stepped[i] = n, False
        if found != GOOD:
            codes[i] = HOLDS_INF if found == INFINITE else BAD_STEPS
        elif n < MIN_SAMPLES:
            codes[i] = TOO_FEW
        elif not d[:m].any():
            codes[i] = CONSTANT
        else:
            codes[i] = fit_one(d[:m], gap[:gaps], scale, kind, known[i], numbers[i])
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
    squares, logs = around(d, gap, place, low, high)
    errors = standard_errors(kind, place, bend, squares, d.shape[0])
    if place == math.inf:
        q, r, loglik = q_walk, 0.0, at_infinity
    else:
        r = noise if kind == KNOWN_R else squares[0] / d.shape[0]
        q, loglik = math.exp(place) * r, loglik_of(squares[0], logs[0], d.shape[0], scale, noise)
    unit = scale * scale
    for size in (q, r):
        if size > 0.0 and not MIN_VARIANCE < size * unit <= MAX_VARIANCE:
            return BAD_UNIT
    out[Q], out[R], out[LOGLIK] = q * unit, r * unit, loglik
    out[Q_SE] = q * errors[0] * unit if q > 0.0 else math.inf
    out[R_SE] = r * errors[1] * unit if r > 0.0 else math.inf
    out[LOW], out[HIGH] = math.exp(low), math.exp(high) if high < 700.0 else math.inf
    set_intervals(out, kind, squares, d.shape[0], q_walk * unit, noise * unit, unit)
    if r == 0.0:
        return NO_NOISE
    if q == 0.0:
        return NO_MOVEMENT
    return FLAT if low == -math.inf and high == math.inf else OK


@compiled()
def around(d: Array, gap: Array, place: float, low: float, high: float) -> tuple[Array, Array]:
    """Σv²/f in scale² and Σln f at ln λ, a small step before and after it, and at both ends of its interval."""
    places = np.array([place, place - DERIVATIVE_STEP, place + DERIVATIVE_STEP, low, high])
    for j in range(5):
        places[j] = min(places[j], 300.0)  # ∞ has sums of its own
    chi2, logdet = np.empty(5), np.empty(5)
    sums_at(d, gap, places, chi2, logdet)
    return chi2, logdet


@compiled(error_model="numpy")
def standard_errors(kind: int, place: float, bend: float, chi2: Array, m: int) -> tuple[float, float]:
    """Standard errors of ln q and ln r; see `maximum_likelihood.fit`."""
    alone = math.sqrt(2.0 / m)
    if kind == KNOWN_R:
        return (1.0 / math.sqrt(-bend) if bend < 0.0 else math.inf), 0.0
    if kind == KNOWN_RATIO or math.isinf(place):
        return alone, alone
    variance = -1.0 / bend if bend < 0.0 else math.inf
    slope = math.log(chi2[2] / chi2[1]) / (2.0 * DERIVATIVE_STEP)
    return math.sqrt(2.0 / m + (1.0 + slope) ** 2 * variance), math.sqrt(2.0 / m + slope**2 * variance)


@compiled(error_model="numpy")
def set_intervals(out: Array, kind: int, chi2: Array, m: int, q_walk: float, noise: float, unit: float) -> None:
    """The 95 % intervals of q and r: what they are at the ends of that of λ, and how well their size is known.

    The two combine on the scale of the logarithm (Zou & Donner 2008, Statistics in Medicine 27, 1693-1702).
    """
    q, r, wide = out[Q], out[R], NORMAL * math.sqrt(2.0 / m)
    if kind == KNOWN_R:
        out[Q_LOW], out[Q_HIGH], out[R_LOW], out[R_HIGH] = out[LOW] * noise, out[HIGH] * noise, noise, noise
        return
    if kind == KNOWN_RATIO:
        less, more = math.exp(-wide), math.exp(wide)
        out[Q_LOW], out[Q_HIGH], out[R_LOW], out[R_HIGH] = q * less, q * more, r * less, r * more
        return
    r_most, r_least = chi2[3] / m * unit, chi2[4] / m * unit if out[HIGH] < math.inf else 0.0
    q_least, q_most = out[LOW] * r_most, out[HIGH] * r_least if out[HIGH] < math.inf else q_walk
    out[Q_LOW], out[Q_HIGH] = apart(q, q_least, -wide), apart(q, q_most, wide)
    out[R_LOW], out[R_HIGH] = apart(r, r_least, -wide), apart(r, r_most, wide)


@compiled(error_model="numpy")
def apart(value: float, end: float, wide: float) -> float:
    """One end of an interval: of the shape it is `end`, of the size it lies `wide` (in ln, signed) from `value`."""
    if end <= 0.0:
        return 0.0
    if value <= 0.0:
        return end * math.exp(wide)
    both = math.hypot(math.log(end / value), wide)
    return value * math.exp(both if wide > 0.0 else -both)
