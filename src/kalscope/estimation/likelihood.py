"""The exact log-likelihood of a pair (q, r), its search along λ = q/r, and the pairs that a record allows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import ArrayLike

from kalscope.common.numbers import Array
from kalscope.common.progress import Progress
from kalscope.errors import BadSetting
from kalscope.estimation import kernels as profile_kernels
from kalscope.estimation.result import Estimate
from kalscope.filtering.filter import kalman_filter
from kalscope.filtering.params import FilterParams, one_record

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

_MAX_GAP = 1e150
"""Periods; a longer gap changes nothing, and its product with λ must fit a double."""


@dataclass(frozen=True)
class Differences:
    """One channel as input of the likelihood: the differences of neighbouring finite samples."""

    d: Array
    """Differences divided by `scale`, shape (m,), largest between ½ and 1; m = 0 for fewer than two samples."""
    gap: Array
    """Nominal sample periods between the two samples, shape (m,), ≥ 0; empty = 1 each."""
    scale: float
    """A power of two, unit: dividing by it costs no digit, so the answers do not depend on the unit."""

    @property
    def m(self) -> int:
        """Scored innovations."""
        return len(self.d)

    @property
    def span(self) -> float:
        """Sample periods from the first sample to the last."""
        return float(self.gap.sum()) if len(self.gap) else float(self.m)

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
        order = np.argsort(-ratios)
        lanes = len(ratios) + -len(ratios) % profile_kernels.LANES
        filled = np.full(lanes, ratios[order[-1]])
        filled[: len(ratios)] = ratios[order]
        chi2, logdet = np.empty(lanes), np.empty(lanes)
        profile_kernels.scan_ratios(self.d, self.gap, filled, chi2, logdet)
        out = np.empty_like(ratios), np.empty_like(ratios)
        out[0][order], out[1][order] = chi2[: len(ratios)], logdet[: len(ratios)]
        return out

    def concentrated(self, log_ratios: Array) -> Array:
        """Log-likelihood of the data for each ln λ (−inf is λ = 0) with the best r of that λ."""
        chi2, logdet = self.sums(np.exp(log_ratios))
        return self.from_sums(chi2, logdet)

    def from_sums(self, chi2: Array, logdet: Array) -> Array:
        """−½[m ln 2π + m + m ln(χ²/m) + Σln f] in the unit of the data."""
        with np.errstate(divide="ignore"):
            log_r = np.log(chi2 / self.m) + 2.0 * math.log(self.scale)
        return -0.5 * (self.m * (math.log(2.0 * math.pi) + 1.0 + log_r) + logdet)

    def random_walk(self) -> tuple[float, float]:
        """λ = ∞, no measurement noise: the concentrated log-likelihood and q in scale².

        Two samples at one instant that differ rule it out: −inf.
        """
        if len(self.gap) == 0:
            q = float(np.mean(self.d * self.d))
            return float(self.from_sums(np.array(q * self.m), np.zeros(()))), q
        gap = self.gap
        moved = gap > 0.0
        if np.any(self.d[~moved] != 0.0) or not moved.any():
            return -math.inf, 0.0
        q = float(np.mean(self.d[moved] ** 2 / gap[moved]))
        loglik = self.from_sums(np.array(q * self.m), np.log(gap[moved]).sum())
        return float(loglik), q


def differences(column: Array, steps: Array) -> Differences:
    """The finite samples of one channel, shape (n,), as differences; `steps` empty means regular sampling."""
    finite = np.isfinite(column)
    if finite.all():
        samples, gap = column, steps[1:]
    else:
        where = np.flatnonzero(finite)
        samples = column[where]
        if len(where) < 2:
            gap = np.empty(0)
        elif len(steps):
            gap = np.add.reduceat(steps[: where[-1] + 1], where[:-1] + 1)
        else:
            gap = np.subtract(where[1:], where[:-1], out=np.empty(len(where) - 1))
        del where
    if len(gap) and np.all(gap == 1.0):
        gap = np.empty(0)
    half = np.diff(0.5 * samples)  # halved: two values near the largest double may lie two of them apart
    largest = max(float(half.max(initial=0.0)), -float(half.min(initial=0.0)))
    if largest == 0.0:
        return Differences(half, np.minimum(gap, _MAX_GAP), 1.0)
    exponent = min(math.frexp(largest)[1], 1022)
    return Differences(
        np.ldexp(half, -exponent, out=half), np.minimum(gap, _MAX_GAP), math.ldexp(1.0, exponent + 1)
    )


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


def walk_profile(z: ArrayLike, log_ratios: ArrayLike | None = None, dt: ArrayLike | None = None) -> Profile:
    """`likelihood_profile` without momentum."""
    data, grid = profile_input(z, log_ratios, dt)
    chi2, logdet = data.sums(np.exp(grid))
    return profile_of(data, grid, chi2, logdet)


def profile_input(
    z: ArrayLike, log_ratios: ArrayLike | None, dt: ArrayLike | None, default: Array = DEFAULT_LOG_RATIOS
) -> tuple[Differences, Array]:
    """The record and the ln λ of a profile, checked as `likelihood_profile` says."""
    samples, steps = one_record(z, dt)
    grid = default if log_ratios is None else np.asarray(log_ratios, dtype=np.float64)
    if grid.ndim != 1 or len(grid) < 2 or not np.all(np.diff(grid) > 0) or not np.abs(grid).max() <= MAX_LOG_RATIO:
        raise BadSetting(f"log_ratios must be two or more ascending numbers within ±300 (got {log_ratios})")
    data = differences(samples, steps)
    if data.m < 1:
        raise BadSetting("z must hold at least two finite samples (got fewer)")
    return data, grid


def profile_of(data: Differences, grid: Array, chi2: Array, logdet: Array, step: float = 1.0) -> Profile:
    """The profile of Σv²/f (in scale²) and Σln f at each ln λ, r = 1."""
    loglik = data.from_sums(chi2, logdet)
    with np.errstate(over="ignore", under="ignore"):
        chi2 = chi2 * data.scale * data.scale
    return Profile(grid, loglik, chi2 / data.m, chi2, logdet, data.m, step)


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


LogLik = Callable[[Array], Array]

STEP = 0.8
"""Step of the first grid in ln λ."""

DROP = 1.9207294103470617
"""Half the 95 % quantile of χ² with 1 degree of freedom: the drop in log-likelihood to the ends of the interval."""

_POINTS = 17
"""Points of the polynomial over one or two steps of the grid."""

_MAX_PEAKS = 4
"""Local maxima of the grid to refine: its highest point need not be nearest to the maximum."""


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


def grid_for(m: int, highest: float = 24.0) -> Array:
    """First values of ln λ, ascending: from a lag far beyond m samples to `highest`."""
    lowest = min(-24.0, -2.0 * math.log(m) - 6.0)
    return lowest + STEP * np.arange(math.ceil((highest - lowest) / STEP) + 1, dtype=np.float64)


def find_peak(loglik: LogLik, grid: Array, at_infinity: float, progress: Progress) -> Peak:
    """Search `loglik` (a function of ln λ, −inf allowed) over the grid, the point λ = 0, and λ = ∞.

    `at_infinity` is the log-likelihood at λ = ∞, −inf where that is not a candidate.
    """
    progress(0.0, "likelihood over all ratios q/r")
    values = loglik(np.append(grid, -math.inf))
    values, at_zero = values[:-1], float(values[-1])
    progress(0.6, "likelihood around the best ratio")
    top, best, curvature = _refine(loglik, grid, values)
    slack = 1e-9 + 1e-12 * abs(best)  # an inner maximum must exceed the rounding of the sums
    if max(at_zero, at_infinity) >= best - slack:
        top = -math.inf if at_zero >= at_infinity else math.inf
        best, curvature = max(best, at_zero, at_infinity), 0.0
    progress(0.8, "interval of the ratio")
    return Peak(top, best, curvature, _interval(loglik, grid, values, (at_zero, at_infinity), top, best - DROP))


def find_top_near(loglik: LogLik, log_ratio: float) -> Peak | None:
    """The maximum within a step of `log_ratio`, without its interval; None where that is no inner maximum."""
    (curve,) = _curves(loglik, [(log_ratio - STEP, log_ratio + STEP)])
    at, best, curvature = _top(curve)
    return Peak(at, best, curvature, (-math.inf, math.inf)) if abs(at - log_ratio) < 0.95 * STEP else None


def _refine(loglik: LogLik, grid: Array, values: Array) -> tuple[float, float, float]:
    """The best inner maximum: ln λ, log-likelihood, curvature."""
    padded = np.concatenate([[-math.inf], values, [-math.inf]])
    is_peak = (values >= padded[:-2]) & (values >= padded[2:])
    tops = np.flatnonzero(is_peak)
    tops = tops[np.argsort(-values[tops], kind="stable")[:_MAX_PEAKS]]
    lows, highs = grid[np.maximum(tops - 1, 0)], grid[np.minimum(tops + 1, len(grid) - 1)]
    stretches = list(zip(lows.tolist(), highs.tolist(), strict=True))
    found = [_top(curve) for curve in _curves(loglik, stretches)]
    return max(found, key=lambda one: one[1])


def _curves(loglik: LogLik, stretches: list[tuple[float, float]]) -> list[Chebyshev]:
    """A polynomial for each stretch of ln λ, all of them from one pass over the data."""
    unit = np.polynomial.chebyshev.chebpts1(_POINTS)
    middles = np.array([0.5 * (a + b) for a, b in stretches])
    halves = np.array([0.5 * (b - a) for a, b in stretches])
    points = middles[:, None] + halves[:, None] * unit
    values = loglik(points.ravel()).reshape(points.shape)
    vander = np.polynomial.chebyshev.chebvander(unit, _POINTS - 1)
    weights = np.full(_POINTS, 2.0 / _POINTS)
    weights[0] /= 2.0
    return [
        Chebyshev(weights * (vander.T @ (row - row[0])) + row[0] * (np.arange(_POINTS) == 0), domain=stretch)
        for row, stretch in zip(values, stretches, strict=True)
    ]


def _top(curve: Chebyshev) -> tuple[float, float, float]:
    low, high = curve.domain
    places = np.append(_roots(curve.deriv()), [low, high])
    heights = curve(places)
    at = float(places[heights.argmax()])
    return at, float(heights.max()), float(curve.deriv(2)(at))


def _roots(curve: Chebyshev) -> Array:
    """Real roots within the domain."""
    if not np.any(curve.coef):
        return np.empty(0)
    bent = curve.trim(1e-16 * np.abs(curve.coef).max())  # a leading coefficient near 0 gives false roots
    roots = np.asarray(bent.roots(), dtype=np.complex128)
    real = roots.real[np.abs(roots.imag) < 1e-6]
    return real[(real >= curve.domain[0]) & (real <= curve.domain[1])]


def _interval(
    loglik: LogLik, grid: Array, values: Array, edges: tuple[float, float], top: float, cut: float
) -> tuple[float, float]:
    """The outermost ln λ whose log-likelihood reaches `cut`."""
    if math.isfinite(top):
        place = int(np.searchsorted(grid, top))
        grid, values = np.insert(grid, place, top), np.insert(values, place, cut + DROP)
    inside = np.flatnonzero(values >= cut)
    if len(inside) == 0:  # the maximum is an edge so sharp that no point of the grid comes near
        return (-math.inf, float(grid[0])) if top < 0 else (float(grid[-1]), math.inf)
    first, last = inside[0], inside[-1]
    crossings: list[tuple[float, float]] = []
    if edges[0] < cut and first > 0:
        crossings.append((float(grid[first - 1]), float(grid[first])))
    has_low = len(crossings) == 1
    if edges[1] < cut and last < len(grid) - 1:
        crossings.append((float(grid[last]), float(grid[last + 1])))
    has_high = len(crossings) > has_low
    places = [_roots(curve - cut) for curve in _curves(loglik, crossings)] if crossings else []
    low = float(min(places[0], default=crossings[0][0])) if has_low else -math.inf
    high = float(max(places[-1], default=crossings[-1][1])) if has_high else math.inf
    return low, high


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
    z: ArrayLike, best: Estimate, dt: ArrayLike | None = None, drop: float = DROP_95, scan: Scan = walk_profile
) -> Contour | None:
    """The line on which twice the log-likelihood is `drop` below its maximum.

    Args:
        z: measurements of one channel, shape (n,), unit; NaN is a missing sample.
        best: what `estimate(z, "ml", dt)` gave.
        dt: nominal sample periods before each sample, shape (n,), ≥ 0; None = 1 each.
        drop: see `DROP_95`, > 0.
        scan: scans the record; another than the default where `best` has momentum.

    Returns:
        The contour; None where the likelihood has no maximum.

    Raises:
        BadSetting: as `likelihood_profile`.

    Source: likelihood-ratio regions, e.g. Pawitan 2001, section 2.6; the concentrated r as in `likelihood`.
    """
    if best.verdict in ("too_few", "constant", "bad_unit", "not_converged") or not math.isfinite(
        float(best.loglik)
    ):
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
