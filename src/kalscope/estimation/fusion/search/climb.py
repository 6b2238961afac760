"""Newton's method to the top of a smooth function of a few coordinates within bounds, from its exact slopes.

The curvature is the difference of slopes beside the place. So the top is as good as the slopes are, about 1e-10;
comparing heights alone would stop at 1e-7.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array

Function = Callable[[Array], tuple[float, Array]]
"""Height and slope at coordinates of shape (k,)."""

BESIDE = 1e-4
"""Step for the curvature; all coordinates are logarithms or gains near 1."""
MAX_STEP = 2.0
"""Longest step of one coordinate."""
MAX_STEPS = 60
"""Steps of one climb."""
LEAST = 1e-9
"""Rise of a step after which the next one would only follow rounding: errors fall with their square."""
_ENOUGH = 1e-9
"""Step at whose length the top is reached."""
_STEEP = 1e-10
"""Share of the highest curvature below which a direction counts as level."""


@dataclass(frozen=True)
class Top:
    """The highest place of a climb."""

    at: Array
    """Coordinates, shape (k,)."""
    height: float
    """Height there."""
    curvature: Array
    """Second derivatives there, shape (k, k), symmetric."""


def climb(
    function: Function, start: Array, low: Array, high: Array, least: float = LEAST, steps: int = MAX_STEPS
) -> Top:
    """The top that steps uphill from `start` come to, within `low` and `high`, shape (k,) each.

    A step that rises by less than `least` is the last one, and so is the one after `steps` of them.
    """
    at = np.clip(start, low, high)
    height, slope = function(at)
    curvature = np.zeros((len(at), len(at)))
    for _ in range(steps if len(at) else 0):
        curvature = _curvature(function, at, slope, high)
        free = ~((at <= low) & (slope < 0.0) | (at >= high) & (slope > 0.0))
        step = np.zeros(len(at))
        step[free] = _uphill(curvature[np.ix_(free, free)], slope[free])
        step *= min(1.0, MAX_STEP / max(float(np.abs(step).max()), 1e-300))
        length = float(np.abs(np.clip(at + step, low, high) - at).max())
        moved = _search(function, at, height, step, low, high)
        if moved is None:
            break
        risen = moved[0] - height
        height, at, slope = moved
        if length < _ENOUGH or risen < least:
            break
    return Top(at, height, curvature)


def _curvature(function: Function, at: Array, slope: Array, high: Array) -> Array:
    rows = np.empty((len(at), len(at)))
    for i in range(len(at)):
        side = BESIDE if at[i] + BESIDE <= high[i] else -BESIDE
        beside = at.copy()
        beside[i] += side
        rows[i] = (function(beside)[1] - slope) / side
    return np.nan_to_num(0.5 * (rows + rows.T))


def _uphill(curvature: Array, slope: Array) -> Array:
    """Newton's step, with every curvature taken as that of a hilltop."""
    bent, ways = np.linalg.eigh(curvature)
    steep = np.maximum(np.abs(bent), max(_STEEP * float(np.abs(bent).max(initial=0.0)), 1e-12))
    return np.asarray(ways @ ((ways.T @ slope) / steep))


def _search(
    function: Function, at: Array, height: float, step: Array, low: Array, high: Array
) -> tuple[float, Array, Array] | None:
    """The first of shorter and shorter steps that does not lead down; None where even the shortest does."""
    slack = 1e-13 * abs(height)
    for halvings in range(24):
        there = np.clip(at + step * 0.5**halvings, low, high)
        found, slope = function(there)
        if math.isfinite(found) and found >= height - slack:
            return found, there, slope
    return None
