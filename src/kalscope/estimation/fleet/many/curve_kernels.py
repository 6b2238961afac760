"""The compiled loops of polynomials through the likelihood, nothing else: Chebyshev series on −1 … 1.

A series of POINTS coefficients approximates the likelihood over a short stretch of ln λ, as in `likelihood.search`.
Its roots are found by their change of sign on a fine grid, and then to the last digit.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled

Array = NDArray[np.float64]

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
