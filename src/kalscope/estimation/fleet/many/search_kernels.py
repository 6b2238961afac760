"""The compiled search of one series over ln λ, nothing else: the steps of `likelihood.search`, one for one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled
from kalscope.estimation.fleet.many.curve_kernels import NODES, POINTS, fit_series, outermost_crossing, top_of
from kalscope.estimation.fleet.many.lane_kernels import logliks_at

Array = NDArray[np.float64]

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
