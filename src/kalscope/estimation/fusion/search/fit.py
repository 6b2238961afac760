"""The maximum of the likelihood: several starts, Newton's steps, and the edges where a variance is 0."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array, Indices
from kalscope.common.progress import Progress
from kalscope.estimation.fusion.search.climb import LEAST, Top, climb
from kalscope.estimation.fusion.search.likelihood import Coordinates, Place, Readings, place_at
from kalscope.estimation.momentum.search import MIN_MOMENTUM
from kalscope.filtering.params import MAX_MOMENTUM

LOWEST, HIGHEST = 40.0, 12.0
"""How far ln of a variance may go below and above that of the differences of the readings."""
_MAX_GAIN = 100.0
"""Factor from its start within which a gain is searched."""
_MAX_TRIED = 6
"""Starts that are climbed from on the middle of the record."""
_MAX_FINAL = 2
"""Tops of those that are climbed from on the whole record."""
_SAME = 0.5
"""Distance of ln r up to which two tops count as one."""
_FAR = 40.0
"""An edge whose log-likelihood is lower by this, before the other parameters follow, is not examined."""


@dataclass(frozen=True)
class Asked:
    """What a fit searches."""

    known: Array
    """r of the sensors whose noise is known, in scale², NaN for all others, shape (sensors,)."""
    floor: Array
    """Least r of each sensor, in scale², shape (sensors,): that of rounding, or 0."""
    keeps: bool
    """Whether τ is searched."""
    gained: Indices
    """The sensors whose gain is searched."""

    def free_noise(self) -> Indices:
        """The sensors whose r is searched."""
        return np.flatnonzero(np.isnan(self.known))


@dataclass(frozen=True)
class Found:
    """The best place, and the shape of the likelihood around it."""

    coordinates: Coordinates
    """What was searched; a variance at an edge is not among it."""
    top: Top
    """The top in these coordinates."""
    place: Place
    """The parameters there."""
    low: Array
    """Lower bounds of the coordinates."""
    high: Array
    """Upper bounds."""


def best_fit(data: Readings, asked: Asked, starts: Sequence[Place], progress: Progress) -> Found:
    """The highest place near one of the starts, which are on `data.middle()`, or at an edge."""
    part = data.middle()
    starts = sorted(starts, key=lambda one: -one.loglik)[:_MAX_TRIED]
    tops: list[Found] = []
    for i, start in enumerate(starts):
        progress(0.5 * i / len(starts), "likelihood of all sensors together")
        tops.append(climbed(part, asked, start))
    if part is not data:
        tops = [climbed(data, asked, start) for start in _apart([one.place for one in tops])]
    best = max(tops, key=lambda one: one.place.loglik)
    progress(0.7, "likelihood at the edges")
    for edge in _edges(data, asked, best.place):
        there = climbed(data, asked, edge)
        if there.place.loglik >= best.place.loglik - 1e-9 - 1e-12 * abs(best.place.loglik):
            best = there
    return best


def _apart(places: Sequence[Place]) -> list[Place]:
    """The best places that differ from each other."""
    chosen: list[Place] = []
    for place in sorted(places, key=lambda one: -one.loglik):
        if all(np.abs(np.log(place.r / one.r)).max() > _SAME for one in chosen):
            chosen.append(place)
    return chosen[:_MAX_FINAL]


def climbed(data: Readings, asked: Asked, start: Place, least: float = LEAST) -> Found:
    """The top above one start, up to a step that rises by less than `least`; a variance that is 0 there stays."""
    coordinates = coordinates_of(data, asked, start)
    return top_of(coordinates, coordinates.start(), *bounds(coordinates, asked.floor), least)


def coordinates_of(data: Readings, asked: Asked, place: Place) -> Coordinates:
    """The coordinates around a place: what is asked for, but no variance that is 0 there."""
    free = asked.free_noise()
    moves = place.q > 0.0
    return Coordinates(data, place, moves, asked.keeps and moves, free[place.r[free] > 0.0], asked.gained)


def top_of(coordinates: Coordinates, start: Array, low: Array, high: Array, least: float = LEAST) -> Found:
    """The top of the likelihood in these coordinates."""

    def function(at: Array) -> tuple[float, Array]:
        place = coordinates.place(at)
        return place.loglik, coordinates.slope(place)

    top = climb(function, start, low, high, least)
    return Found(coordinates, top, coordinates.place(top.at), low, high)


def bounds(coordinates: Coordinates, floor: Array) -> tuple[Array, Array]:
    """Lower and upper bounds of the coordinates."""
    size = math.log(max(step_sizes(coordinates.data).max(), 1e-300))
    low = [size - LOWEST] if coordinates.moves else []
    high = [size + HIGHEST] if coordinates.moves else []
    if coordinates.keeps:
        low.append(math.log(MIN_MOMENTUM))
        high.append(math.log(MAX_MOMENTUM))
    for i in coordinates.noisy.tolist():
        low.append(max(size - LOWEST, math.log(float(floor[i])) if floor[i] > 0.0 else -math.inf))
        high.append(size + HIGHEST)
    for i in coordinates.gained.tolist():
        ends = float(coordinates.base.c[i]) / _MAX_GAIN, float(coordinates.base.c[i]) * _MAX_GAIN
        low.append(min(ends))
        high.append(max(ends))
    return np.array(low), np.array(high)


def step_sizes(data: Readings) -> Array:
    """Mean square of the differences of neighbouring readings of each sensor, shape (sensors,)."""
    values = (data.value[data.sensor == i] for i in range(data.sensors))
    return np.array([float(np.mean(np.diff(one) ** 2)) if len(one) > 1 else 0.0 for one in values])


def _edges(data: Readings, asked: Asked, best: Place) -> list[Place]:
    """The edges that may be higher: no movement, or no noise in one sensor."""
    edges: list[Place] = []
    if best.q > 0.0 and best.r.min() > 0.0:
        edges.append(place_at(data, 0.0, best.tau, best.r, best.c))
    if best.q > 0.0 and not np.any(asked.known == 0.0):
        for i in asked.free_noise():
            if asked.floor[i] == 0.0:
                r = best.r.copy()
                r[i] = 0.0
                edges.append(place_at(data, best.q, best.tau, r, best.c))
    return [edge for edge in edges if edge.loglik > best.loglik - _FAR]
