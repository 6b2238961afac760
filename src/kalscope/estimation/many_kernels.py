"""The compiled fit of many series, nothing else: the search of each, its spikes, sums and prediction errors."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.estimation.kernels import LANES, scan_ratios

# The compiled loops that take one series apart, nothing else: `likelihood.profile.differences`, compiled.


Array = NDArray[np.float64]

GOOD, INFINITE, BAD_TIMES = 0, 1, 2
"""What `take_apart` finds: differences; an infinite sample; a step that is negative or not finite."""

_MAX_GAP = 1e150
"""Periods; a longer gap changes nothing, and its product with λ must fit a double."""


@compiled(error_model="numpy")
def take_apart(z: Array, steps: Array, d: Array, gap: Array) -> tuple[int, int, int, int, float]:
    """The differences of neighbouring finite samples into `d`, the periods between them into `gap`.

    `z` is one series, NaN where missing, `steps` empty for regular sampling. Repeated lines of the same time and
    value are left out. Returns what was found, m, the number of gaps (0 = 1 each), the finite samples, and the
    scale that `d` was divided by, a power of two.
    """
    m, finite, waited = 0, 0, 0.0
    last, largest, even = 0.0, 0.0, True
    has_steps = steps.shape[0] > 0
    for i in range(z.shape[0]):
        step = steps[i] if has_steps else 1.0
        if not 0.0 <= step < math.inf:
            return BAD_TIMES, 0, 0, 0, 1.0
        waited += step
        if math.isnan(z[i]):
            continue
        if math.isinf(z[i]):
            return INFINITE, 0, 0, 0, 1.0
        finite += 1
        if finite > 1:
            half = 0.5 * z[i] - 0.5 * last  # halved: they may lie two of the largest doubles apart
            even = even and waited == 1.0
            if waited > 0.0 or half != 0.0:
                d[m], gap[m] = half, min(waited, _MAX_GAP)
                m += 1
            largest = max(largest, abs(half))
        last, waited = z[i], 0.0
    if largest == 0.0:
        return GOOD, m, 0 if even else m, min(m + 1, finite), 1.0
    exponent = min(math.frexp(largest)[1], 1022)
    for i in range(m):
        d[i] = math.ldexp(d[i], -exponent)
    return GOOD, m, 0 if even else m, min(m + 1, finite), math.ldexp(1.0, exponent + 1)


@compiled()
def shows_steps(d: Array, least: int, most: float) -> bool:
    """Whether many readings repeat, and enough do not."""
    changes = 0
    for value in d:
        changes += value != 0.0
    return least <= changes <= most * d.shape[0]


# The compiled log-likelihood of one series at many λ, nothing else: the lanes sorted, scanned, and read.
#
# The same sums as `Differences.sums`, lane for lane; see `likelihood.kernels` for how a lane works.


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


# The compiled loops of polynomials through the likelihood, nothing else: Chebyshev series on −1 … 1.
#
# A series of POINTS coefficients approximates the likelihood over a short stretch of ln λ, as in
# `likelihood.search`. Its roots are found by their change of sign on a fine grid, and then to the last digit.


POINTS = 17
"""Points of one polynomial."""

NODES: Array = np.asarray(np.polynomial.chebyshev.chebpts1(POINTS), dtype=np.float64)
"""Where it is taken, −1 … 1."""

_FINE = 64
"""Pieces in which a change of sign is looked for."""

_weights = np.full(POINTS, 2.0 / POINTS)
_weights[0] /= 2.0
_TO_SERIES: Array = np.array(
    _weights[:, None] * np.polynomial.chebyshev.chebvander(NODES, POINTS - 1).T, dtype=np.float64
)


@compiled()
def fit_series(values: Array, series: Array) -> None:
    """The series through the values at NODES, all shape (POINTS,); the first value is added last, without loss."""
    for k in range(POINTS):
        total = 0.0
        for j in range(POINTS):
            total += _TO_SERIES[k, j] * (values[j] - values[0])
        series[k] = total
    series[0] += values[0]


@compiled()
def differentiate(series: Array, slope: Array) -> None:
    """The series of the derivative, by x in −1 … 1; the same shape, its last coefficient 0."""
    n = series.shape[0]
    slope[n - 1] = 0.0
    slope[n - 2] = 2.0 * (n - 1) * series[n - 1]
    for k in range(n - 3, -1, -1):
        slope[k] = slope[k + 2] + 2.0 * (k + 1) * series[k + 1]
    slope[0] *= 0.5


@compiled()
def value_of(series: Array, x: float) -> float:
    """The series at x, by Clenshaw's rule."""
    one = two = 0.0
    for k in range(series.shape[0] - 1, 0, -1):
        one, two = series[k] + 2.0 * x * one - two, one
    return series[0] + x * one - two


@compiled()
def root_between(series: Array, slope: Array, low: float, high: float) -> float:
    """The root between two places of different sign: Newton's steps, halves where these leave the bracket."""
    rising = value_of(series, high) > 0.0
    x = 0.5 * (low + high)
    for _ in range(80):
        height = value_of(series, x)
        if (height > 0.0) == rising:
            high = x
        else:
            low = x
        steep = value_of(slope, x)
        step = height / steep if steep != 0.0 else math.inf
        after = x - step
        if not low <= after <= high:
            after = 0.5 * (low + high)
        if abs(after - x) <= 1e-16:
            return after
        x = after
    return x


@compiled()
def top_of(series: Array) -> tuple[float, float, float]:
    """The highest place on −1 … 1: x, the height there, and the second derivative by x."""
    slope, bend = np.empty_like(series), np.empty_like(series)
    differentiate(series, slope)
    differentiate(slope, bend)
    at, height = -1.0, value_of(series, -1.0)
    end = value_of(series, 1.0)
    if end > height:
        at, height = 1.0, end
    before = value_of(slope, -1.0)
    for i in range(1, _FINE + 1):
        x = 2.0 * i / _FINE - 1.0
        after = value_of(slope, x)
        if before > 0.0 >= after:
            place = root_between(slope, bend, x - 2.0 / _FINE, x)
            there = value_of(series, place)
            if there > height:
                at, height = place, there
        before = after
    return at, height, value_of(bend, at)


@compiled()
def outermost_crossing(series: Array, level: float, from_left: bool) -> float:
    """The first x from one end of −1 … 1 at which the series reaches the level; that end where it never does."""
    shifted, slope = series.copy(), np.empty_like(series)
    shifted[0] -= level
    differentiate(shifted, slope)
    side = -1.0 if from_left else 1.0
    before = value_of(shifted, side)
    for i in range(1, _FINE + 1):
        x = side * (1.0 - 2.0 * i / _FINE)
        after = value_of(shifted, x)
        if before < 0.0 <= after:
            last = side * (1.0 - 2.0 * (i - 1) / _FINE)
            return root_between(shifted, slope, min(last, x), max(last, x))
        before = after
    return side


# The compiled search of one series over ln λ, nothing else: the steps of `likelihood.search`, one for one.


STEP, DROP, MAX_PEAKS = 0.8, 1.9207294103470617, 4
"""As in `likelihood.search`; a test checks that they are equal."""

Peak = tuple[float, float, float, float, float]
"""ln λ of the maximum, log-likelihood there, its second derivative, and the interval of ln λ."""


@compiled()
def find_peak(d: Array, gap: Array, scale: float, noise: float, highest: float, at_infinity: float) -> Peak:
    """The maximum over ln λ and its interval; `noise` is r in scale² where it is known, 0 where not.

    The likelihood is called here only: each level of functions above it would compile it again.
    """
    lowest = min(-24.0, -2.0 * math.log(d.shape[0]) - 6.0)
    count = math.ceil((highest - lowest) / STEP) + 1
    grid = np.empty(count + 1)
    for i in range(count):
        grid[i] = lowest + STEP * i
    grid[count] = -math.inf
    values = np.empty(count + 1)
    logliks_at(d, gap, grid, scale, noise, values)
    at_zero = values[count]
    grid, values = grid[:count], values[:count]

    stretches = around_tops(grid, values)
    heights = np.empty(POINTS * stretches.shape[0])
    logliks_at(d, gap, nodes_on(stretches), scale, noise, heights)
    top, best, curvature = highest_of(stretches, heights)
    slack = 1e-9 + 1e-12 * abs(best)  # an inner maximum must exceed the rounding of the sums
    if max(at_zero, at_infinity) >= best - slack:
        top = -math.inf if at_zero >= at_infinity else math.inf
        best, curvature = max(best, at_zero, at_infinity), 0.0
    if math.isfinite(top):
        place = 0
        while place < count and grid[place] < top:
            place += 1
        grid, values = inserted(grid, place, top), inserted(values, place, best)

    stretches, has_low, has_high, low, high = around_ends(grid, values, at_zero, at_infinity, top, best - DROP)
    if has_low or has_high:
        heights = np.empty(POINTS * stretches.shape[0])
        logliks_at(d, gap, nodes_on(stretches), scale, noise, heights)
        if has_low:
            low = crossing(stretches, heights, 0, best - DROP, True)
        if has_high:
            high = crossing(stretches, heights, stretches.shape[0] - 1, best - DROP, False)
    return top, best, curvature, low, high


@compiled()
def inserted(values: Array, place: int, value: float) -> Array:
    """The values with one more before `place`."""
    longer = np.empty(values.shape[0] + 1)
    for i in range(longer.shape[0]):
        longer[i] = values[i] if i < place else (value if i == place else values[i - 1])
    return longer


@compiled()
def highest_tops(values: Array) -> NDArray[np.intp]:
    """The places of the highest local maxima of the grid, at most MAX_PEAKS."""
    tops = np.empty(MAX_PEAKS + 1, np.intp)
    found, n = 0, values.shape[0]
    for i in range(n):
        if (i > 0 and values[i] < values[i - 1]) or (i < n - 1 and values[i] < values[i + 1]):
            continue
        j = found
        while j > 0 and values[tops[j - 1]] < values[i]:
            tops[j] = tops[j - 1]
            j -= 1
        tops[j] = i
        found = min(found + 1, MAX_PEAKS)
    return tops[:found]


@compiled()
def around_tops(grid: Array, values: Array) -> Array:
    """The stretches of one step on either side of the highest local maxima of the grid, shape (tops, 2)."""
    tops, n = highest_tops(values), grid.shape[0]
    stretches = np.empty((tops.shape[0], 2))
    for i in range(tops.shape[0]):
        stretches[i, 0], stretches[i, 1] = grid[max(tops[i] - 1, 0)], grid[min(tops[i] + 1, n - 1)]
    return stretches


@compiled()
def nodes_on(stretches: Array) -> Array:
    """The points of a polynomial on each stretch, one after the other."""
    points = np.empty(POINTS * stretches.shape[0])
    for i in range(stretches.shape[0]):
        low, high = stretches[i, 0], stretches[i, 1]
        for j in range(POINTS):
            points[POINTS * i + j] = 0.5 * (low + high) + 0.5 * (high - low) * NODES[j]
    return points


@compiled()
def highest_of(stretches: Array, heights: Array) -> tuple[float, float, float]:
    """The best inner maximum: ln λ, log-likelihood, curvature."""
    series = np.empty(POINTS)
    top, best, curvature = 0.0, -math.inf, 0.0
    for i in range(stretches.shape[0]):
        middle, half = 0.5 * (stretches[i, 0] + stretches[i, 1]), 0.5 * (stretches[i, 1] - stretches[i, 0])
        fit_series(heights[POINTS * i : POINTS * (i + 1)], series)
        x, height, bend = top_of(series)
        if height > best:
            top, best, curvature = float(middle + half * x), height, float(bend / (half * half))
    return top, best, curvature


@compiled()
def around_ends(
    grid: Array, values: Array, at_zero: float, at_infinity: float, top: float, cut: float
) -> tuple[Array, bool, bool, float, float]:
    """The steps of the grid in which the interval ends, whether it does below and above, and its ends where not."""
    n = grid.shape[0]
    first, last = 0, n - 1
    while first < n and not values[first] >= cut:
        first += 1
    while last >= 0 and not values[last] >= cut:
        last -= 1
    if last < first:  # the maximum is an edge so sharp that no point of the grid comes near
        if top < 0.0:
            return np.empty((0, 2)), False, False, -math.inf, float(grid[0])
        return np.empty((0, 2)), False, False, float(grid[n - 1]), math.inf
    has_low = at_zero < cut and first > 0
    has_high = at_infinity < cut and last < n - 1
    stretches = np.empty((int(has_low) + int(has_high), 2))
    if has_low:
        stretches[0, 0], stretches[0, 1] = grid[first - 1], grid[first]
    if has_high:
        stretches[int(has_low), 0], stretches[int(has_low), 1] = grid[last], grid[last + 1]
    return stretches, has_low, has_high, -math.inf, math.inf


@compiled()
def crossing(stretches: Array, heights: Array, index: int, cut: float, from_left: bool) -> float:
    """Where the log-likelihood on one stretch reaches `cut`, seen from outside."""
    series = np.empty(POINTS)
    fit_series(heights[POINTS * index : POINTS * (index + 1)], series)
    middle = 0.5 * (stretches[index, 0] + stretches[index, 1])
    half = 0.5 * (stretches[index, 1] - stretches[index, 0])
    return float(middle + half * outermost_crossing(series, cut, from_left))


# The compiled fit of many series, one after the other, nothing else: from samples to a row of numbers and a code.
#
# It follows `methods.maximum_likelihood`, `known` and `verdict.conclude` step by step; a test compares the two.


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


# The compiled loops over a fleet: sums of its likelihoods, and errors of prediction.


FleetArray = NDArray[np.float64]

M_LOG_R, LOG_R, LOGDET, SLOPES = range(4)
"""The rows of sums at each ln λ: Σ m ln r̂, Σ ln r̂ with the best r̂ = χ²/m of each device, ΣΣln f, and the
sum of the squares of each device's slope of the log-likelihood with its best r̂, 0 at the ends."""

SUMS = 4
SMALLEST, LARGEST = 1e-145, 1e145
"""Scales whose squares stay within a double."""


@compiled()
def is_fit(d: FleetArray, found: int, n: int, scale: float) -> bool:
    """Whether a series counts in the pool: it can be fitted, and its squares fit a double."""
    return found == GOOD and n >= MIN_SAMPLES and bool(d.any()) and SMALLEST < scale < LARGEST


@compiled(error_model="numpy")
def add_slopes(log_ratios: FleetArray, chi2: FleetArray, logdet: FleetArray, m: int, squares: FleetArray) -> None:
    """Add the square of one device's slope at each ln λ but the first and the last."""
    for j in range(1, log_ratios.shape[0] - 1):
        change = m * math.log(chi2[j + 1] / chi2[j - 1]) + logdet[j + 1] - logdet[j - 1]
        slope = -0.5 * change / (log_ratios[j + 1] - log_ratios[j - 1])
        squares[j] += slope * slope


@compiled(error_model="numpy")
def add_up(
    values: FleetArray,
    steps: FleetArray,
    starts: NDArray[np.int64],
    log_ratios: FleetArray,
    sums: FleetArray,
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
            sums[LOGDET, j] += logs
        counts[0] += 1
        counts[1] += m


FleetArray = NDArray[np.float64]

MAX_FINITE = 1e18
"""λ beyond which the filter passes its samples unchanged, as far as a double can tell."""


@compiled(error_model="numpy")
def errors_of_each(
    values: FleetArray,
    steps: FleetArray,
    starts: NDArray[np.int64],
    ratio: FleetArray,
    own: FleetArray,
    errors: FleetArray,
    own_error: FleetArray,
) -> None:
    """Root mean square of the innovations on the second half of each series, at each λ and at its own.

    `ratio` are the λ, shape (j,), `errors` (k, j), `own` and `own_error` (k,); NaN where nothing can be said.
    """
    longest = np.max(starts[1:] - starts[:-1])
    d, gap = np.empty(longest), np.empty(longest)
    lanes = ratio.shape[0] + 1
    ratios, state = np.empty(lanes), np.empty(4 * lanes)
    ratios[: lanes - 1] = ratio
    for i in range(starts.shape[0] - 1):
        first, middle, stop = starts[i], (starts[i] + starts[i + 1]) // 2, starts[i + 1]
        errors[i, :] = math.nan
        own_error[i] = math.nan
        if math.isnan(own[i]):
            continue
        known = take_apart(values[first:middle], steps[first:middle] if len(steps) else steps, d, gap)[1]
        found, m, gaps, n, scale = take_apart(
            values[first:stop], steps[first:stop] if len(steps) else steps, d, gap
        )
        if found != GOOD or n < MIN_SAMPLES or known >= m:
            continue
        ratios[lanes - 1] = min(own[i], MAX_FINITE)
        squares_since(d[:m], gap[:gaps], ratios, known, state)
        for j in range(lanes):
            size = scale * math.sqrt(state[3 * lanes + j] / (m - known))
            if j < lanes - 1:
                errors[i, j] = size
            else:
                own_error[i] = size


@compiled(error_model="numpy", fastmath={"contract"})
def squares_since(d: FleetArray, gap: FleetArray, ratio: FleetArray, since: int, state: FleetArray) -> None:
    """Σv² from the difference `since` on of the filters of several λ with r = 1.

    `state` holds v, p, 1 − k and Σv² of all lanes, one array so that the compiler puts several lanes into a vector.
    """
    lanes = ratio.shape[0]
    for j in range(lanes):
        state[j], state[lanes + j], state[2 * lanes + j], state[3 * lanes + j] = 0.0, 1.0, 0.0, 0.0
    for i in range(d.shape[0]):
        g, counted = gap[i] if gap.shape[0] else 1.0, 1.0 if i >= since else 0.0
        for j in range(lanes):
            v = d[i] + state[2 * lanes + j] * state[j]
            predicted = state[lanes + j] + ratio[j] * g
            kept = 1.0 / (predicted + 1.0)
            state[j], state[lanes + j], state[2 * lanes + j] = v, predicted * kept, kept
            state[3 * lanes + j] += counted * v * v
