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
"""As in `likelihood.search`; a test holds them equal."""

Peak = tuple[float, float, float, float, float]
"""ln λ of the maximum, log-likelihood there, its second derivative, and the interval of ln λ."""


@compiled()
def find_peak(d: Array, gap: Array, scale: float, noise: float, highest: float, at_infinity: float) -> Peak:
    """The maximum over ln λ and its interval; `noise` is r in scale² where it is known, 0 where not."""
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
    top, best, curvature = refine(d, gap, scale, noise, grid, values)
    slack = 1e-9 + 1e-12 * abs(best)  # an inner maximum must stand above the rounding of the sums
    if max(at_zero, at_infinity) >= best - slack:
        top = -math.inf if at_zero >= at_infinity else math.inf
        best, curvature = max(best, at_zero, at_infinity), 0.0
    if math.isfinite(top):
        place = 0
        while place < count and grid[place] < top:
            place += 1
        grid, values = inserted(grid, place, top), inserted(values, place, best)
    low, high = interval(d, gap, scale, noise, grid, values, (at_zero, at_infinity), top, best - DROP)
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
def refine(
    d: Array, gap: Array, scale: float, noise: float, grid: Array, values: Array
) -> tuple[float, float, float]:
    """The best inner maximum: ln λ, log-likelihood, curvature."""
    tops = highest_tops(values)
    points = np.empty(POINTS * tops.shape[0])
    for i in range(tops.shape[0]):
        low, high = float(grid[max(tops[i] - 1, 0)]), float(grid[min(tops[i] + 1, grid.shape[0] - 1)])
        place_nodes((low, high), points[POINTS * i : POINTS * (i + 1)])
    heights = np.empty_like(points)
    logliks_at(d, gap, points, scale, noise, heights)
    series = np.empty(POINTS)
    top, best, curvature = 0.0, -math.inf, 0.0
    for i in range(tops.shape[0]):
        low, high = float(grid[max(tops[i] - 1, 0)]), float(grid[min(tops[i] + 1, grid.shape[0] - 1)])
        half = 0.5 * (high - low)
        fit_series(heights[POINTS * i : POINTS * (i + 1)], series)
        x, height, bend = top_of(series)
        if height > best:
            top, best, curvature = 0.5 * (low + high) + half * x, height, bend / (half * half)
    return top, best, curvature


@compiled()
def interval(
    d: Array,
    gap: Array,
    scale: float,
    noise: float,
    grid: Array,
    values: Array,
    edges: tuple[float, float],
    top: float,
    cut: float,
) -> tuple[float, float]:
    """The outermost ln λ whose log-likelihood reaches `cut`."""
    n = grid.shape[0]
    first, last = 0, n - 1
    while first < n and not values[first] >= cut:
        first += 1
    while last >= 0 and not values[last] >= cut:
        last -= 1
    if last < first:  # the maximum is an edge so sharp that no point of the grid comes near
        return (-math.inf, float(grid[0])) if top < 0.0 else (float(grid[n - 1]), math.inf)
    has_low = edges[0] < cut and first > 0
    has_high = edges[1] < cut and last < n - 1
    lows = float(grid[max(first - 1, 0)]), float(grid[first])
    highs = float(grid[last]), float(grid[min(last + 1, n - 1)])
    points = np.empty(POINTS * (has_low + has_high))
    if has_low:
        place_nodes(lows, points[:POINTS])
    if has_high:
        place_nodes(highs, points[POINTS * has_low :])
    heights = np.empty_like(points)
    if points.shape[0]:
        logliks_at(d, gap, points, scale, noise, heights)
    series = np.empty(POINTS)
    low, high = -math.inf, math.inf
    if has_low:
        fit_series(heights[:POINTS], series)
        low = 0.5 * (lows[0] + lows[1]) + 0.5 * (lows[1] - lows[0]) * outermost_crossing(series, cut, True)
    if has_high:
        fit_series(heights[POINTS * has_low :], series)
        high = 0.5 * (highs[0] + highs[1]) + 0.5 * (highs[1] - highs[0]) * outermost_crossing(series, cut, False)
    return low, high


@compiled()
def place_nodes(stretch: tuple[float, float], points: Array) -> None:
    """The points of a polynomial on a stretch."""
    for j in range(POINTS):
        points[j] = 0.5 * (stretch[0] + stretch[1]) + 0.5 * (stretch[1] - stretch[0]) * NODES[j]
