"""Distances in standard errors from values with intervals, whose sides may differ and be infinite."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.errors import BadSetting

NORMAL = 1.959963984540054
"""Standard errors from an estimate to the end of its 95 % interval."""

EDGE = 1.5
"""Least standard deviation, in ln, beyond the end of an interval whose estimate is 0: short recordings without any
movement are more frequent than a likelihood that is quadratic in the logarithm predicts."""

Interval = tuple[ArrayLike, ArrayLike]


def checked(values: ArrayLike, interval: Interval | None) -> tuple[Array, Array, Array]:
    """Values, shape (k,), and their standard errors downwards and upwards; 0 without an interval.

    Raises:
        BadSetting: the shapes differ, or a value lies outside its interval.
    """
    values = np.asarray(values, dtype=np.float64)
    if values.ndim != 1:
        raise BadSetting(f"values must be one array, shape (k,) (got {values.shape})")
    if interval is None:
        return values, np.zeros(len(values)), np.zeros(len(values))
    low, high = (np.asarray(end, dtype=np.float64) for end in interval)
    if low.shape != values.shape or high.shape != values.shape:
        raise BadSetting(f"interval must have two arrays of shape {values.shape} (got {low.shape}, {high.shape})")
    if np.any((low > values) | (high < values)):
        raise BadSetting("interval must hold its value (got values outside)")
    with np.errstate(invalid="ignore"):
        down, up = (values - low) / NORMAL, (high - values) / NORMAL
    return values, np.where(np.isnan(down), np.inf, down), np.where(np.isnan(up), np.inf, up)


def usual_error(down: Array, up: Array) -> float:
    """Median of the finite standard errors, 0 without any."""
    both = np.where(np.isinf(down), up, np.where(np.isinf(up), down, 0.5 * (down + up)))
    known = both[np.isfinite(both)]
    return float(np.median(known)) if len(known) else 0.0


def distances(
    values: Array, interval: Interval | None, down: Array, up: Array, middle: Array, spread: float
) -> Array:
    """Each value's distance from `middle` in its own standard deviations, with `spread` added; NaN stays.

    The side of the interval that faces the middle counts. A value at ∓inf (ln of 0) is 1.96 away where its interval
    holds the middle, and farther by how far the interval ends before it.
    """
    sizes = np.hypot(spread, np.where(values < middle, up, down))
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(values == middle, 0.0, (values - middle) / sizes)
    if interval is not None:
        size = max(float(np.hypot(spread, usual_error(down, up))), EDGE)
        low, high = (np.asarray(end, dtype=np.float64) for end in interval)
        with np.errstate(divide="ignore", invalid="ignore"):
            below = -NORMAL - np.maximum(middle - high, 0.0) / size
            above = NORMAL + np.maximum(low - middle, 0.0) / size
        z = np.where(np.isneginf(values), below, np.where(np.isposinf(values), above, z))
    return np.where(np.isnan(values), np.nan, z)
