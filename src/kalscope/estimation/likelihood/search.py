"""The one-dimensional search over ψ = ln λ that all likelihood methods share.

The likelihood is analytic in ψ in a strip of half-width π, so that a polynomial through 17 points replaces it,
to rounding, over a stretch of 1.6. Its derivative finds the maximum to about 1e-14, where comparing values
alone would stop at √(rounding), 1e-8, and the answer would depend on the unit of the data.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Chebyshev

from kalscope.common.array import Array
from kalscope.common.progress import Progress

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
