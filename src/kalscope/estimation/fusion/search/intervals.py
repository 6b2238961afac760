"""What a record allows: 95 % intervals of the variances, from the curvature or, where that is weak, the profile."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from kalscope.common.array import Array
from kalscope.estimation.fusion.search.climb import climb
from kalscope.estimation.fusion.search.fit import Asked, Found, bounds, coordinates_of
from kalscope.estimation.fusion.search.likelihood import log_step_slope, place_at
from kalscope.estimation.likelihood.search import DROP

NORMAL = math.sqrt(2.0 * DROP)
"""Standard errors from the middle to the end of a 95 % interval, 1.96."""
SURE = 0.1
"""Standard error of the logarithm of a variance up to which its likelihood is as good as normal."""
_WIDENING = 1.7
"""Factor between two steps outwards, until the end is bracketed."""
_FINE = 1e-4
"""Rise of the likelihood that matters for the end of an interval."""
_CLIMB = 10
"""Steps of the other parameters towards their best; they start where they were a little further inside."""
_STEPS = 12
"""Steps outwards, and then towards the end within its bracket."""


def covariance(found: Found) -> Array:
    """Covariance of the coordinates at the top; a coordinate at a bound or without curvature has variance inf."""
    size = len(found.top.at)
    full = np.full((size, size), 0.0)
    np.fill_diagonal(full, math.inf)
    inner = (found.top.at > found.low) & (found.top.at < found.high)
    information = -found.top.curvature[np.ix_(inner, inner)]
    if inner.any() and np.all(np.linalg.eigvalsh(information) > 1e-9):
        full[np.ix_(inner, inner)] = np.linalg.inv(information)
    return full


def noise_interval(found: Found, asked: Asked, sensor: int) -> tuple[float, float]:
    """The r of one sensor that the record allows, in scale²."""
    place = found.place
    if not math.isnan(asked.known[sensor]):
        return float(asked.known[sensor]), float(asked.known[sensor])
    if place.r[sensor] == 0.0:
        r = place.r.copy()
        r[sensor] = _guess(place.by_r[sensor], found)
        return 0.0, _upper_end(found, asked, place.q, r, sensor)
    index = found.coordinates.noise_index(sensor)
    low, high = _log_interval(found, index)
    return max(math.exp(low), float(asked.floor[sensor])), math.exp(high)


def movement_interval(found: Found, asked: Asked) -> tuple[float, float]:
    """The q that the record allows, in scale²."""
    place = found.place
    if place.q == 0.0:
        return 0.0, _upper_end(found, asked, _guess(place.by_q, found), place.r, None)
    if not found.coordinates.keeps:
        low, high = (math.exp(end) for end in _log_interval(found, 0))
        step = math.exp(found.top.at[0]) / place.q
        return low / step, high / step
    slope = np.array([1.0, -log_step_slope(place.tau)])
    variance = float(slope @ covariance(found)[:2, :2] @ slope)
    error = NORMAL * math.sqrt(variance) if math.isfinite(variance) and variance >= 0.0 else math.inf
    return place.q * math.exp(-error), place.q * (math.exp(error) if error < 700.0 else math.inf)


def momentum_interval(found: Found) -> tuple[float, float]:
    """The τ that the record allows, in sample periods; from 0, or up to inf, as where it was cut to the record."""
    if not found.coordinates.keeps:
        return found.place.tau, math.inf
    low, high = _log_interval(found, 1)
    return math.exp(low), math.exp(high)


def _log_interval(found: Found, index: int) -> tuple[float, float]:
    """The ends of coordinate `index`, a logarithm; ∓inf beyond the bounds of the search."""
    at, variance = float(found.top.at[index]), float(covariance(found)[index, index])
    error = math.sqrt(variance)
    if error <= SURE:
        return at - NORMAL * error, at + NORMAL * error
    return _end(found, index, -1.0, error), _end(found, index, 1.0, error)


def _guess(slope: float, found: Found) -> float:
    """A variance whose likelihood is not yet much lower than at the edge where it is 0."""
    least = math.exp(float(found.low.min()) + 1.0) if len(found.low) else 1e-18
    return max(0.01 * DROP / max(-slope, 1e-300), least) if slope < 0.0 else least


def _upper_end(found: Found, asked: Asked, q: float, r: Array, sensor: int | None) -> float:
    """The largest variance of a sensor, or of the movement, that is 0 at the top; its guess in q or r is > 0."""
    edge = place_at(found.coordinates.data, q, found.place.tau, r, found.place.c)
    coordinates = coordinates_of(found.coordinates.data, replace(asked, keeps=found.coordinates.keeps), edge)
    low, high = bounds(coordinates, asked.floor)
    index = 0 if sensor is None else coordinates.noise_index(sensor)
    top = replace(found.top, at=np.clip(coordinates.start(), low, high))
    return math.exp(_end(Found(coordinates, top, edge, low, high), index, 1.0, 1.0))


def _end(found: Found, index: int, side: float, error: float) -> float:
    """Go outwards until the likelihood has fallen by DROP, then towards that place; √drop is almost straight."""
    border = float(found.low[index] if side < 0.0 else found.high[index])
    inside, fallen, at = float(found.top.at[index]), 0.0, found.top.at
    stride = NORMAL * min(max(error, SURE), 1.0) if math.isfinite(error) else 1.0
    outside, drop = inside, 0.0
    for _ in range(_STEPS + 8):
        if side * (inside - border) >= 0.0:
            return side * math.inf
        outside = border if side * (inside + side * stride - border) >= 0.0 else inside + side * stride
        drop, beside = _drop(found, index, outside, at)
        if drop >= DROP:
            break
        inside, fallen, at = outside, max(drop, 0.0), beside
        stride *= _WIDENING
    else:
        return side * math.inf
    for _ in range(_STEPS):
        share = (math.sqrt(DROP) - math.sqrt(fallen)) / (math.sqrt(drop) - math.sqrt(fallen))
        middle = inside + min(max(share, 0.05), 0.95) * (outside - inside)
        between, beside = _drop(found, index, middle, at)
        if abs(between - DROP) < 1e-3:
            return middle
        if between < DROP:
            inside, fallen, at = middle, max(between, 0.0), beside
        else:
            outside, drop = middle, between
    return inside


def _drop(found: Found, index: int, value: float, start: Array) -> tuple[float, Array]:
    """How far the likelihood falls where one coordinate has this value and the others follow, and their place."""
    others = np.arange(len(start)) != index
    at = start.copy()
    at[index] = value

    def function(rest: Array) -> tuple[float, Array]:
        at[others] = rest
        place = found.coordinates.place(at)
        return place.loglik, found.coordinates.slope(place)[others]

    top = climb(function, start[others], found.low[others], found.high[others], _FINE, _CLIMB)
    at[others] = top.at
    return found.top.height - top.height, at.copy()
