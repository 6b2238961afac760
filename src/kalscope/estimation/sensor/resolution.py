"""The resolution of a sensor: the step Δ of its readings, from its converter or from the digits that are printed.

Between neighbouring levels lie one or a few steps, so the most frequent distance between them is Δ. A printed digit
may round the steps once more: 0.06, 0.12, 0.19 and 0.25 are steps of 0.0625.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.array import Array

MIN_STEP = 64.0 * np.finfo(np.float64).eps
"""Two readings closer than this, relative to the largest, differ only by rounding."""
ON_GRID = 0.98
"""Share of the readings that must lie on the steps: a few may come from an average or a stand-in."""
_TOLERANCE = 0.15
"""Distance from a step, in steps, up to which a reading lies on it."""
_MAX_READINGS = 10_000
"""Maximum number of readings examined, evenly chosen."""
_SIMILAR = 1.3
"""Distances within this factor may be one step, rounded to a printed digit."""
_DOUBLINGS = 52
"""From 4 MIN_STEP of the largest level to twice that level takes 46 doublings; the rest is for a moving middle."""


def resolution_of(readings: Array) -> float:
    """The step Δ of the readings, shape (n,), finite, in their unit; 0 where they show none."""
    if not len(readings):
        return 0.0
    exponent = int(np.frexp(np.abs(readings).max())[1])  # a power of two changes no digit, and nothing overflows
    chosen = np.ldexp(readings[:: math.ceil(len(readings) / _MAX_READINGS)], -exponent)
    levels, found = np.unique(chosen, return_counts=True)
    distances = np.diff(levels)
    apart = distances > MIN_STEP * np.abs(levels).max()
    levels, counts, distances = levels[np.append(True, apart)], _joined(found, apart), distances[apart]
    if not len(distances):
        return 0.0
    step = _refined(_usual(distances), levels, counts)
    return math.ldexp(step, exponent) if _share_on_grid(step, levels, counts) >= ON_GRID else 0.0


def _joined(found: NDArray[np.intp], apart: NDArray[np.bool_]) -> Array:
    """Readings at each level, where levels that differ only by rounding are one."""
    return np.add.reduceat(found.astype(np.float64), np.flatnonzero(np.append(True, apart)))


def _usual(distances: Array) -> float:
    """The most frequent distance: the middle of the fullest stretch of distances within a factor."""
    rising = np.sort(distances)
    ends = np.searchsorted(rising, rising * _SIMILAR, side="right")
    first = int(np.argmax(ends - np.arange(len(rising))))
    return float(np.mean(rising[first : ends[first]]))


def _refined(step: float, levels: Array, counts: Array) -> float:
    """The step that fits the levels best: first those near the fullest one, then twice as far, up to all."""
    middle, reach = float(levels[int(np.argmax(counts))]), 4.0 * step
    for _ in range(_DOUBLINGS):
        near = np.abs(levels - middle) <= reach
        away = levels[near] - middle
        places = np.rint(away / step)
        close = np.abs(away - places * step) <= 2.0 * _TOLERANCE * step
        if not close.any():  # no grid: the middle lies between the levels
            break
        places, away = places[close], away[close]
        spread = places - places.mean()
        if spread.any():  # the slope of a straight line through the levels
            step = float(spread @ away) / float(spread @ spread)
        middle += float(np.mean(away - places * step))
        if near.all():
            break
        reach *= 2.0
    return step


def _share_on_grid(step: float, levels: Array, counts: Array) -> float:
    """The share of the readings that lie on multiples of the step, wherever these begin."""
    turns = np.exp(2j * np.pi * ((levels - levels[0]) / step))
    beginning = turns @ counts
    off = np.abs(np.angle(turns * np.conj(beginning))) / (2.0 * np.pi)
    return float(counts[off <= _TOLERANCE].sum() / counts.sum())
