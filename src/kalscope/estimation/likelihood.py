"""The exact log-likelihood of a pair (q, r), its search along λ = q/r, and the pairs that a record allows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from kalscope.common.numbers import Array, Indices, Mask
from kalscope.common.progress import Progress
from kalscope.estimation import kernels
from kalscope.estimation.result import Estimate, Pair
from kalscope.filtering.filter import kalman_filter
from kalscope.filtering.params import FilterParams

# How well a pair (q, r) explains a record: the exact log-likelihood, and its profile over λ = q/r.
#
# Convention: the sum over the m scored innovations of −½(ln 2π + ln s + v²/s); the first finite sample sets the
# exact diffuse start and is not scored (KFAS and R's arima agree; Stata and statsmodels count it, −½ ln 2π more).
# With r = 1 and q = λ the filter gives Σv²/f and Σln f; r = Σv²/f / m is then the best r of that λ, so that one
# search over ln λ finds both (scale concentrated out: Durbin & Koopman 2012, section 2.10).


DEFAULT_LOG_RATIOS = np.linspace(-24.0, 24.0, 121)
"""ln λ from a lag of 160,000 samples to no filtering at all, in steps in which the likelihood is smooth."""
DEFAULT_LOG_RATIOS.setflags(write=False)

MAX_LOG_RATIO = 300.0
"""Largest |ln λ| of a profile."""


@dataclass(frozen=True)
class Records:
    """Records as input of the likelihood: differences of neighbouring finite samples, one record after another."""

    d: Array
    """Differences of each record divided by its scale, the largest between ½ and 1."""
    gap: Array
    """Nominal sample periods between the two samples, shape of `d`, ≥ 0; empty = 1 each."""
    starts: Indices
    """Where the differences of each record begin, shape (k + 1,); the last is the end of all."""
    scale: Array
    """A power of two each, unit: dividing by it costs no digit, so the answers do not depend on the unit."""

    @property
    def m(self) -> Array:
        """Scored innovations, shape (k,)."""
        return np.diff(self.starts).astype(np.float64)

    def only(self, rows: Indices) -> Records:
        """Some of the records, ascending; the others must have no differences."""
        return Records(self.d, self.gap, np.append(self.starts[rows], self.starts[-1]), self.scale[rows])

    def sums(self, rows: Indices, ratios: Array) -> tuple[Array, Array]:
        """Σv²/f (in scale²) and Σln f for each λ ≥ 0 of some records, shape (rows, ratios), in any order; r = 1."""
        count = ratios.shape[1]
        order = np.argsort(-ratios, axis=1)
        padded = np.concatenate([order, np.repeat(order[:, -1:], -count % kernels.LANES, axis=1)], axis=1)
        computed, out = np.empty((2, *padded.shape)), np.empty((2, *ratios.shape))
        lanes = np.take_along_axis(ratios, padded, 1)
        kernels.scan_ratios(self.d, self.gap, self.starts, rows, lanes, computed[0], computed[1])
        np.put_along_axis(out, order[None], computed[:, :, :count], axis=2)
        return out[0], out[1]

    def logliks(self, rows: Indices, chi2: Array, logdet: Array, noise: Array | None = None) -> Array:
        """`loglik_of` some records, of shape (rows, …); `noise` of shape (rows,)."""
        r = None if noise is None else noise[:, None]
        return loglik_of(self.m[rows, None], self.scale[rows, None], chi2, logdet, r)

    @cached_property
    def random_walk(self) -> tuple[Array, Array, Array]:
        """λ = ∞, no measurement noise: Σd²/g in scale², Σln g, and the steps of more than 0 periods, shape (k,).

        Two samples at one instant that differ rule it out: inf.
        """
        firsts, squares = self.starts[:-1], self.d * self.d
        if not len(self.gap):
            return np.add.reduceat(squares, firsts), np.zeros(len(firsts)), self.m
        moved = self.gap > 0.0
        chi2 = np.divide(squares, self.gap, out=np.where(squares > 0.0, math.inf, 0.0), where=moved)
        logdet = np.log(np.where(moved, self.gap, 1.0))
        counts = np.add.reduceat(moved, firsts, dtype=np.float64)
        return np.add.reduceat(chi2, firsts), np.add.reduceat(logdet, firsts), counts

    def without_noise(self) -> tuple[Array, Array]:
        """The log-likelihood of λ = ∞ with the best q, −inf where ruled out, and that q in scale², shape (k,)."""
        chi2, logdet, counts = self.random_walk
        q = np.where(counts > 0.0, chi2 / np.maximum(counts, 1.0), math.inf)
        loglik = self.logliks(np.arange(len(q)), (q * self.m)[:, None], logdet[:, None])[:, 0]
        return loglik, q


@dataclass(frozen=True)
class Differences:
    """One record as input of the likelihood; see `Records`."""

    d: Array
    """Differences divided by `scale`, shape (m,); m = 0 for fewer than two samples."""
    gap: Array
    """Nominal sample periods between the two samples, shape (m,), ≥ 0; empty = 1 each."""
    scale: float
    """A power of two, unit."""

    @property
    def m(self) -> int:
        """Scored innovations."""
        return len(self.d)

    @property
    def span(self) -> float:
        """Sample periods from the first sample to the last."""
        return float(self.gap.sum()) if len(self.gap) else float(self.m)

    @property
    def records(self) -> Records:
        """The same as records, one of them."""
        return Records(self.d, self.gap, np.array([0, self.m]), np.array([self.scale]))

    def parts(self, stretches: Iterable[tuple[int, int]]) -> Differences:
        """The record with only the samples from each first to before its stop; the others are missing."""
        gap = self.gap if len(self.gap) else np.ones(self.m)
        kept_d, kept_gap, last = list[Array](), list[Array](), -1
        for first, stop in stretches:
            if first < stop:
                if last >= 0:
                    kept_d.append(self.d[last:first].sum(keepdims=True))
                    kept_gap.append(gap[last:first].sum(keepdims=True))
                kept_d.append(self.d[first : stop - 1])
                kept_gap.append(gap[first : stop - 1])
                last = stop - 1
        gap = np.concatenate(kept_gap)
        return Differences(np.concatenate(kept_d), np.empty(0) if np.all(gap == 1.0) else gap, self.scale)

    def sums(self, ratios: Array) -> tuple[Array, Array]:
        """Σv²/f (in scale²) and Σln f for each λ ≥ 0, shape of `ratios`, in any order; r = 1."""
        chi2, logdet = self.records.sums(ONE, ratios[None])
        return chi2[0], logdet[0]

    def from_sums(self, chi2: Array, logdet: Array) -> Array:
        """The log-likelihood with the most likely r, χ²/m, in the unit of the data."""
        return loglik_of(self.m, self.scale, chi2, logdet)

    def concentrated(self, log_ratios: Array) -> Array:
        """Log-likelihood of each ln λ (−inf is λ = 0) with the best r of that λ."""
        return self.from_sums(*self.sums(np.exp(log_ratios)))

    def random_walk(self) -> tuple[float, float]:
        """λ = ∞: see `Records.without_noise`."""
        (loglik,), (q,) = self.records.without_noise()
        return float(loglik), float(q)


def loglik_of(m: Any, scale: Any, chi2: Array, logdet: Array, noise: Any = None) -> Array:
    """−½[m ln 2π + m ln r + χ²/r + Σln f] in the unit of the data; r is `noise`, in scale², or the best, χ²/m."""
    with np.errstate(divide="ignore"):
        log_r = np.log(chi2 / m if noise is None else noise) + 2.0 * np.log(scale)
    return -0.5 * (m * (math.log(2.0 * math.pi) + log_r) + logdet + (m if noise is None else chi2 / noise))


def differences(column: Array, steps: Array) -> Differences:
    """The finite samples of one channel, shape (n,), as differences; `steps` empty means regular sampling."""
    data = take_apart(column, steps, np.array([0]), np.array([len(column)]), whole=True)[0]
    return Differences(data.d, data.gap, float(data.scale[0]))


def take_apart(
    values: Array, steps: Array, firsts: Indices, stops: Indices, whole: bool = False
) -> tuple[Records, Indices, Indices, Indices]:
    """Some stretches of samples as records.

    Args:
        values: samples, shape (n,), NaN where missing.
        steps: nominal sample periods before each; empty = 1 each.
        firsts: where each stretch begins, shape (k,).
        stops: where it ends.
        whole: keep what cannot be fitted, and lines of the same time and value as the one before, which add
            nothing, yet would prove r = 0.

    Returns:
        The records; of each its finite samples, how many differ from the one before, and its defect, as
        `kernels.take_apart` names it. Without `whole` a record with a defect has no differences.
    """
    k, room = len(firsts), int(np.sum(stops - firsts))
    d, gap, scale, starts = np.empty(room), np.empty(room), np.empty(k), np.zeros(k + 1, np.intp)
    counts = np.empty((3, k), np.intp)
    even = kernels.take_apart(values, steps, firsts, stops, whole, d, gap, starts, scale, counts)
    m = int(starts[-1])
    return Records(d[:m], np.empty(0) if even else gap[:m], starts, scale), counts[0], counts[1], counts[2]


ONE = np.zeros(1, np.intp)
"""The row of a record that is alone."""


@dataclass(frozen=True)
class Profile:
    """The likelihood of one channel over λ; one scan of the data, from which every (q, r) can be read."""

    log_ratios: Array
    """ln λ, shape (k,), ascending."""
    loglik: Array
    """Concentrated log-likelihood: each λ with its best r, shape (k,)."""
    r: Array
    """That best r = χ²/m, unit², shape (k,); q = λ r."""
    chi2: Array
    """Σv²/f with r = 1, unit², shape (k,)."""
    logdet: Array
    """Σln f with r = 1, shape (k,)."""
    m: int
    """Scored innovations."""
    step: float = 1.0
    """Variance of one step of the signal for q = 1: 1 without momentum, less with it."""

    def loglik_at(self, q: ArrayLike, r: ArrayLike) -> Array:
        """Log-likelihood at q and r ≥ 0, unit², arrays that broadcast; outside the profile its end is kept.

        Read between the points by a cubic spline of χ²(1 + cλ) and Σln f − m ln(1 + cλ), which are level at
        both ends, c = `step`; with the default 121 points good to about 3e-6 m (a map, not the last digit).
        """
        from scipy.interpolate import CubicSpline

        q, r = np.asarray(q, dtype=np.float64), np.asarray(r, dtype=np.float64)
        log_total = np.logaddexp(0.0, self.log_ratios + math.log(self.step))  # ln(1 + cλ)
        level = np.stack([self.chi2 * np.exp(log_total), self.logdet - self.m * log_total], axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            wanted = np.clip(np.log(q) - np.log(r), self.log_ratios[0], self.log_ratios[-1])
            chi2, logdet = np.moveaxis(CubicSpline(self.log_ratios, level)(wanted), -1, 0)
            total = self.step * q + r
            return -0.5 * (self.m * (math.log(2.0 * math.pi) + np.log(total)) + logdet + chi2 / total)


def loglik_map(profile: Profile, log_q: ArrayLike, log_r: ArrayLike) -> Array:
    """Log-likelihood over a grid of ln q and ln r (unit²), shape (len(log_r), len(log_q)), from one profile."""
    q, r = np.exp(np.asarray(log_q, dtype=np.float64)), np.exp(np.asarray(log_r, dtype=np.float64))
    return profile.loglik_at(q[None, :], r[:, None])


def log_likelihood(z: ArrayLike, params: FilterParams, dt: ArrayLike | None = None) -> float | Array:
    """Log-likelihood of a record under given parameters (p0, x0 and gate included).

    Args:
        z: measurements, shape (n,) or (n, channels: independent filters); NaN is a missing sample.
        params: q, r, p0, x0, gate, scalars or (channels,) arrays.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.

    Returns:
        The sum over the scored innovations, a float, or shape (channels,) for 2-D z.

    Raises:
        BadSetting: as `kalman_filter`.
    """
    return kalman_filter(z, params, dt).loglik


# The one-dimensional search over ψ = ln λ that all likelihood methods share.
#
# The likelihood is analytic in ψ in a strip of half-width π, so that a polynomial through 17 points replaces it,
# to rounding, over a stretch of 1.6. Its derivative finds the maximum to about 1e-14, where comparing values
# alone would stop at √(rounding), 1e-8, and the answer would depend on the unit of the data.


STEP = 0.8
"""Step of the first grid in ln λ."""

DROP = 1.9207294103470617
"""Half the 95 % quantile of χ² with 1 degree of freedom: the drop in log-likelihood to the ends of the interval."""

_POINTS, _FEWER = 17, 12
"""Points of the polynomial over two steps of the grid, and over one: either replaces the likelihood to rounding."""

_MAX_PEAKS = 4
"""Local maxima of the grid to refine: its highest point need not be nearest to the maximum."""

_FINE = np.linspace(-1.0, 1.0, 33)
"""Where a change of sign is looked for."""

LogLiks = Callable[[Indices, Array], Array]
"""The log-likelihood of some records, by their places, at ln λ of shape (rows, points)."""


@dataclass(frozen=True)
class Peak:
    """The maximum of a likelihood over ln λ, and the interval of ln λ around it."""

    log_ratio: float
    """ln λ of the maximum; −inf for λ = 0, inf for λ = ∞."""
    loglik: float
    """Log-likelihood there."""
    curvature: float
    """Second derivative of the log-likelihood by ln λ, < 0; 0 at an edge."""
    interval: tuple[float, float]
    """ln λ between which the log-likelihood is within DROP of the maximum; ends may be ∓inf."""


@dataclass(frozen=True)
class Peaks:
    """`Peak` of each of k records, arrays of shape (k,)."""

    log_ratio: Array
    loglik: Array
    curvature: Array
    low: Array
    high: Array

    def one(self) -> Peak:
        """That of the first record."""
        top, best, curvature, low, high = (
            float(row[0]) for row in (self.log_ratio, self.loglik, self.curvature, self.low, self.high)
        )
        return Peak(top, best, curvature, (low, high))


def grid_for(m: int, highest: float = 24.0) -> Array:
    """First values of ln λ, ascending: from a lag far beyond m samples to `highest`."""
    return _grids(np.array([float(m)]), np.array([highest]))[0][0]


def _grids(m: Array, highest: Array) -> tuple[Array, Indices]:
    """`grid_for` each record, shape (k, longest), and how many values each has."""
    lowest = np.minimum(-24.0, -2.0 * np.log(m) - 6.0)
    counts = np.ceil((highest - lowest) / STEP).astype(np.intp) + 1
    places: Indices = np.arange(int(np.max(counts)))
    return lowest[:, None] + STEP * np.minimum(places, counts[:, None] - 1), counts


def search_records(data: Records, noise: Array | None = None, progress: Progress | None = None) -> Peaks:
    """The peak of each record's likelihood over λ, with r concentrated out, or with r = `noise`, in scale²."""

    def logliks(rows: Indices, log_ratios: Array) -> Array:
        sums = data.sums(rows, np.exp(log_ratios))
        return data.logliks(rows, *sums, None if noise is None else noise[rows])

    highest, at_infinity = np.full(len(data.scale), 24.0), np.full(len(data.scale), -math.inf)
    if noise is None:
        at_infinity = data.without_noise()[0]
    else:  # λ can hardly exceed the largest squared difference (at most 1 in this scale) over r
        highest = np.maximum(highest, 4.0 - np.log(noise))
    return find_peaks(logliks, *_grids(data.m, highest), at_infinity, progress or Progress())


def find_peak(loglik: Callable[[Array], Array], grid: Array, at_infinity: float, progress: Progress) -> Peak:
    """Search `loglik` (a function of ln λ, −inf allowed) over the grid, the point λ = 0, and λ = ∞.

    `at_infinity` is the log-likelihood at λ = ∞, −inf where that is not a candidate.
    """

    def logliks(_: Indices, log_ratios: Array) -> Array:
        return loglik(log_ratios.ravel()).reshape(log_ratios.shape)

    return find_peaks(logliks, grid[None], np.array([len(grid)]), np.array([at_infinity]), progress).one()


def find_peaks(logliks: LogLiks, grid: Array, counts: Indices, at_infinity: Array, progress: Progress) -> Peaks:
    """`find_peak` of k records at once, each over the first `counts` values of its row of the grid."""
    progress(0.0, "likelihood over all ratios q/r")
    k, n = len(grid), int(grid.shape[1])
    values = logliks(np.arange(k), np.column_stack([np.full(k, -math.inf), grid]))
    outside: Mask = np.greater_equal(np.arange(n), counts[:, None])
    at_zero, values = values[:, 0], np.where(outside, -math.inf, values[:, 1:])
    progress(0.6, "likelihood around the best ratio")
    top, best, curvature = _refine(logliks, grid, values)
    edge = np.maximum(at_zero, at_infinity)
    on_edge = edge >= best - 1e-9 - 1e-12 * np.abs(best)  # an inner maximum must exceed the rounding of the sums
    top = np.where(on_edge, np.where(at_zero >= at_infinity, -math.inf, math.inf), top)
    best, curvature = np.where(on_edge, np.maximum(best, edge), best), np.where(on_edge, 0.0, curvature)
    progress(0.8, "interval of the ratio")
    low, high = _interval(logliks, grid, values, counts, (at_zero, at_infinity), top, best - DROP)
    return Peaks(top, best, curvature, low, high)


def find_top_near(data: Differences, log_ratio: float) -> Peak | None:
    """The maximum within a step of `log_ratio`, without its interval; None where that is no inner maximum."""
    low, high = np.array([log_ratio - STEP]), np.array([log_ratio + STEP])
    x, height, bend = _tops(_series(data.concentrated(_points(low, high, _POINTS)[0])[None]))
    at = log_ratio + STEP * float(x[0])
    peak = Peak(at, float(height[0]), float(bend[0]) / STEP**2, (-math.inf, math.inf))
    return peak if abs(at - log_ratio) < 0.95 * STEP else None


# The pair at a peak.


_DERIVATIVE_STEP = 1e-3
"""Step in ln λ for the slope of ln r̂(λ), which only feeds standard errors."""


def fit_near(data: Differences, ratio: float, progress: Progress) -> Pair:
    """The pair of a record whose λ is probably near `ratio`: searched there first."""
    peak = find_top_near(data, math.log(ratio)) if 0.0 < ratio < math.inf else None
    return fit_maximum_likelihood(data, peak or search_records(data.records, progress=progress).one())


def fit_maximum_likelihood(data: Differences, peak: Peak) -> Pair:
    """The pair at the peak of the likelihood, and their standard errors."""
    place = np.array([peak.log_ratio])
    chi2, _ = data.records.sums(ONE, ratios_near(place))
    q_error, r_error = (float(one[0]) for one in relative_errors(place, np.array([peak.curvature]), chi2, data.m))
    if peak.log_ratio == math.inf:
        q = data.random_walk()[1]
        return Pair(q, 0.0, q * q_error, math.inf)
    r = float(chi2[0, 0]) / data.m
    q = math.exp(peak.log_ratio) * r
    return Pair(q, r, q * q_error if q else math.inf, r * r_error)


def logs_near(log_ratios: Array) -> Array:
    """Each ln λ, and a small step before and after it, shape (k, 3), for `relative_errors`."""
    return log_ratios[:, None] + _DERIVATIVE_STEP * np.array([0.0, -1.0, 1.0])


def ratios_near(log_ratios: Array) -> Array:
    """The λ of `logs_near`."""
    return np.exp(np.minimum(logs_near(log_ratios), MAX_LOG_RATIO))


def relative_errors(log_ratios: Array, curvature: Array, chi2: Array, m: Array | int) -> tuple[Array, Array]:
    """Standard errors of ln q and ln r from the observed information in (ln r, ln λ), shape (k,).

    There var(ln λ) = −1/ℓ″, and r given λ has var(ln r) = 2/m (m squared innovations), while the best r moves
    with λ by the slope b: var(ln r) = 2/m + b² var(ln λ), var(ln q) = 2/m + (1 + b)² var(ln λ).

    Args:
        log_ratios: ln λ of each peak.
        curvature: second derivative of its log-likelihood.
        chi2: Σv²/f of `ratios_near`, shape (k, 3).
        m: scored innovations.
    """
    slope = np.log(chi2[:, 2] / chi2[:, 1]) / (2.0 * _DERIVATIVE_STEP)
    variance = np.divide(-1.0, curvature, out=np.full(len(slope), math.inf), where=curvature < 0.0)
    variance[np.isinf(log_ratios)] = 0.0
    return np.sqrt(2.0 / m + (1.0 + slope) ** 2 * variance), np.sqrt(2.0 / m + slope**2 * variance)


def _refine(logliks: LogLiks, grid: Array, values: Array) -> tuple[Array, Array, Array]:
    """The best inner maximum of each row: ln λ, log-likelihood, curvature."""
    everyone = np.arange(len(grid))
    before, after = (
        np.column_stack(both) for both in ((values[:, :1], values[:, :-1]), (values[:, 1:], values[:, -1:]))
    )
    with np.errstate(invalid="ignore"):
        # Between two points the likelihood exceeds both by an eighth of its second difference, or little more.
        worth = values + (2.0 * values - before - after) >= values.max(axis=1, keepdims=True)
    is_peak = (values >= before) & (values >= after) & worth
    is_peak[everyone, values.argmax(axis=1)] = True
    for row in np.flatnonzero(is_peak.sum(axis=1) > _MAX_PEAKS):
        places = np.flatnonzero(is_peak[row])
        is_peak[row, places[np.argsort(-values[row, places], kind="stable")[_MAX_PEAKS:]]] = False
    rows, place = np.nonzero(is_peak)
    low, high = grid[rows, np.maximum(place - 1, 0)], grid[rows, np.minimum(place + 1, grid.shape[1] - 1)]
    half = 0.5 * (high - low)
    x, height, bend = _tops(_series(logliks(rows, _points(low, high, _POINTS))))
    order = np.lexsort((-height, rows))
    first = order[np.searchsorted(rows, everyone)]
    return (low + half * (x + 1.0))[first], height[first], (bend / half**2)[first]


def _interval(
    logliks: LogLiks,
    grid: Array,
    values: Array,
    counts: Indices,
    edges: tuple[Array, Array],
    top: Array,
    cut: Array,
) -> tuple[Array, Array]:
    """The outermost ln λ of each row whose log-likelihood reaches `cut`."""
    everyone, n = np.arange(len(grid)), grid.shape[1]
    inside = values >= cut[:, None]
    place = np.sum(grid < top[:, None], axis=1)  # of the top among the points of the grid
    place = np.minimum(place, counts)
    first = np.where(inside.any(axis=1), inside.argmax(axis=1), counts)
    last = np.where(inside.any(axis=1), n - 1 - inside[:, ::-1].argmax(axis=1), -1)
    inner = np.stack([np.where(place <= first, top, grid[everyone, np.minimum(first, n - 1)]),
                      np.where(place > last, top, grid[everyone, last])])  # fmt: skip
    first, last = np.minimum(first, place), np.maximum(last, place - 1)
    outer = np.stack([grid[everyone, np.maximum(first - 1, 0)], grid[everyone, np.minimum(last + 1, counts - 1)]])
    falls = np.stack([(edges[0] < cut) & (first > 0), (edges[1] < cut) & (last < counts - 1)])
    ends = np.where(falls, outer, np.array([[-math.inf], [math.inf]]))
    falls &= np.isfinite(inner)  # an edge may be so sharp that no point of the grid comes near
    rows = np.flatnonzero(falls.any(axis=0))
    if len(rows):
        # Seen from outside: ln λ falls from the outer to the inner end of an upper stretch.
        both = [np.where(falls[i], i, 1 - i)[rows] for i in (0, 1)]
        outside, near = (np.stack([side[at, rows] for at in both]) for side in (outer, inner))
        points = _points(outside.T.ravel(), near.T.ravel(), _FEWER).reshape(len(rows), -1)
        heights = logliks(rows, points) - cut[rows, None]
        x = _first_root(_series(heights.reshape(-1, _FEWER))).reshape(-1, 2).T
        computed = outside + 0.5 * (near - outside) * (x + 1.0)
        ends[:, rows] = np.where(falls[:, rows], computed, ends[:, rows])
    return ends[0], ends[1]


@cache
def _polynomials(count: int) -> tuple[Array, Array, Array, Array]:
    """Of Chebyshev series: the points, and the matrices that give the series, its slope, its fine heights."""
    points, orders = chebyshev.chebpts1(count), np.arange(count)
    to_series = chebyshev.chebvander(points, count - 1) * np.where(orders, 2.0, 1.0) / count
    slope = np.array([np.pad(chebyshev.chebder(one), (0, 1)) for one in np.eye(count)])
    made: tuple[Any, ...] = points, to_series, slope, chebyshev.chebvander(_FINE, count - 1).T
    return made[0], made[1], made[2], made[3]


def _points(first: Array, last: Array, count: int) -> Array:
    """The points of a polynomial on each stretch, shape (stretches, count), from −1 at `first` to 1 at `last`."""
    return 0.5 * (first + last)[:, None] + 0.5 * (last - first)[:, None] * _polynomials(count)[0]


def _times(series: Array, which: int) -> Array:
    """Each series turned by one of the matrices of `_polynomials`; BLAS would start threads for it."""
    return np.einsum("ij,jk->ik", series, _polynomials(series.shape[1])[which])


def _series(values: Array) -> Array:
    """The Chebyshev series through the values at `_points`; the first value is added last, without loss."""
    series = _times(values - values[:, :1], 1)
    series[:, 0] += values[:, 0]
    return series


def _at(series: Array, x: Array) -> Array:
    """Each series at its x, −1 … 1."""
    return np.einsum("ik,ik->i", series, _powers(x, series.shape[1]))


def _powers(x: Array, count: int) -> Array:
    """The Chebyshev polynomials at each x, shape (k, count); the way that is quick for a few x is slow for many."""
    return np.asarray(
        chebyshev.chebvander(x, count - 1) if len(x) > 50 else np.cos(np.arccos(x)[:, None] * np.arange(count)),
        dtype=np.float64,
    )


def _root(series: Array, low: Array, high: Array) -> Array:
    """The root of each series between two places of different sign: Newton's steps, halves where these leave."""
    slope = _times(series, 2)
    rising, x = _at(series, high) > 0.0, 0.5 * (low + high)
    for _ in range(60):
        powers = _powers(x, series.shape[1])
        height, steep = np.einsum("ik,ik->i", series, powers), np.einsum("ik,ik->i", slope, powers)
        above = (height > 0.0) == rising
        high, low = np.where(above, x, high), np.where(above, low, x)
        with np.errstate(divide="ignore", invalid="ignore"):
            after = x - height / steep
        after = np.where((after >= low) & (after <= high), after, 0.5 * (low + high))
        if np.abs(after - x).max(initial=0.0) <= 1e-9:  # the next step would change 1e-18
            return after
        x = after
    return x


def _tops(series: Array) -> tuple[Array, Array, Array]:
    """The highest place of each series on −1 … 1: x, the height there, and the second derivative by x."""
    slope = _times(series, 2)
    at = _times(series, 3).argmax(axis=1)
    low, high = _FINE[np.maximum(at - 1, 0)], _FINE[np.minimum(at + 1, len(_FINE) - 1)]
    inner = (_at(slope, low) > 0.0) & (_at(slope, high) < 0.0)
    x = _FINE[at]
    x[inner] = _root(slope[inner], low[inner], high[inner])
    return x, _at(series, x), _at(_times(slope, 2), x)


def _first_root(series: Array) -> Array:
    """The first x from −1 on at which each series reaches 0; −1 where it never does."""
    above = _times(series, 3) >= 0.0
    step, x = above.argmax(axis=1), np.full(len(series), -1.0)
    crosses = step > 0
    x[crosses] = _root(series[crosses], _FINE[step[crosses] - 1], _FINE[step[crosses]])
    return x


# The pairs (q, r) that a record allows together: the contour of its likelihood around the best pair.
#
# A pair lies inside the 95 % region when twice its log-likelihood falls short of the best by less than 5.99, the 95
# % point of χ² with two degrees of freedom. Along one λ the log-likelihood in r is −½ m (ln r + r̂/r) + const, so
# the two r on the contour follow from u − 1 − ln u = c with u = r̂/r, which Lambert's W solves.


DROP_95 = 5.991464547107979
"""Twice the drop in log-likelihood on the 95 % contour: the 95 % point of χ² with two degrees of freedom."""

_NODES = 48
"""λ at which the record is scanned; between them the profile is as smooth as a parabola."""
_OPEN_REACH = 12.0
"""ln λ to search beyond the finite end of a half-open interval."""


@dataclass(frozen=True)
class Contour:
    """A line around the allowed pairs, in natural logarithms."""

    log_q: Array
    """ln q (q in unit²) along the line, shape (k,)."""
    log_r: Array
    """ln r (r in unit²) along the line, shape (k,)."""
    closed: bool
    """Whether the line is closed; it is open where the record allows λ → 0 or λ → ∞."""


Scan = Callable[[ArrayLike, ArrayLike | None, ArrayLike | None], Profile]
"""`likelihood_profile` of a model: z, ln λ, dt -> Profile."""


def likelihood_contour(
    z: ArrayLike, best: Estimate, scan: Scan, dt: ArrayLike | None = None, drop: float = DROP_95
) -> Contour | None:
    """The line on which twice the log-likelihood is `drop` below its maximum.

    Args:
        z: measurements of one channel, shape (n,), unit; NaN is a missing sample.
        best: what `estimate(z, dt)` gave.
        scan: scans the record with the momentum of `best`.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        drop: see `DROP_95`, > 0.

    Returns:
        The contour; None where the likelihood has no maximum.

    Raises:
        BadSetting: as `likelihood_profile`.

    Source: likelihood-ratio regions, e.g. Pawitan 2001, section 2.6; the concentrated r as in `likelihood`.
    """
    if best.verdict in ("too_few", "constant", "bad_unit") or not math.isfinite(float(best.loglik)):
        return None
    low, high = _first_reach(best)
    for _ in range(6):
        profile = scan(z, np.linspace(low, high, _NODES), dt)
        short = 2.0 * (float(best.loglik) - profile.loglik)
        wider = (
            low - (high - low) if short[0] < drop and low > -_edge(best) else low,
            high + (high - low) if short[-1] < drop and high < _edge(best) else high,
        )
        if wider == (low, high):
            break
        low, high = max(wider[0], -_edge(best)), min(wider[1], _edge(best))
    else:
        return None
    return _around(profile, short, drop)


def _edge(best: Estimate) -> float:
    """The largest |ln λ| to search."""
    finite = [abs(math.log(ratio)) for ratio in (*best.ratio_interval, best.ratio) if 0.0 < ratio < math.inf]
    return min(MAX_LOG_RATIO, max(24.0, max(finite, default=0.0) + 2.0 * _OPEN_REACH))


def _first_reach(best: Estimate) -> tuple[float, float]:
    """First range of ln λ: the interval of λ alone, 1.5 times as wide, because q and r vary together."""
    low, high = (math.log(end) if 0.0 < end < math.inf else math.nan for end in best.ratio_interval)
    if math.isnan(low) and math.isnan(high):
        return -_OPEN_REACH, _OPEN_REACH
    if math.isnan(low):
        return high - _OPEN_REACH, high + 1.0
    if math.isnan(high):
        return low - 1.0, low + _OPEN_REACH
    half = max(0.75 * (high - low), 1e-6)
    middle = 0.5 * (low + high)
    return max(middle - half, -MAX_LOG_RATIO), min(middle + half, MAX_LOG_RATIO)


def _around(profile: Profile, short: Array, drop: float) -> Contour | None:
    """Up along the smaller r of each λ and back along the larger."""
    from scipy.interpolate import CubicSpline
    from scipy.special import lambertw

    nodes = profile.log_ratios
    inside = np.flatnonzero(short < drop)
    if len(inside) == 0:
        return None
    excess = CubicSpline(nodes, short - drop)
    ends = excess.roots(extrapolate=False)
    before, after = ends[ends <= nodes[inside[0]]], ends[ends >= nodes[inside[-1]]]
    first = float(before[-1]) if len(before) else float(nodes[0])
    last = float(after[0]) if len(after) else float(nodes[-1])
    # Close together at both ends, where the line turns.
    log_ratio = 0.5 * (first + last) - 0.5 * (last - first) * np.cos(np.linspace(0.0, np.pi, 61))
    room = np.maximum(-excess(log_ratio), 0.0) / profile.m
    log_r = CubicSpline(nodes, np.log(profile.r))(log_ratio)
    # At both ends u = 1, where rounding may push the argument past the branch point −1/e.
    less, more = (np.nan_to_num(-np.real(lambertw(-np.exp(-1.0 - room), b)), nan=1.0) for b in (0, -1))
    r = np.concatenate([log_r - np.log(more), (log_r - np.log(less))[::-1]])
    ratio = np.concatenate([log_ratio, log_ratio[::-1]])
    return Contour(ratio + r, r, closed=bool(len(before) and len(after)))
