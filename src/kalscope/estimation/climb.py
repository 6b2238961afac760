"""The maximum of the likelihood of several sensors by Newton's steps with exact slopes, and its intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kalscope.common.numbers import Array, Indices
from kalscope.common.progress import Progress
from kalscope.estimation import kernels
from kalscope.estimation.likelihood import DROP
from kalscope.estimation.momentum import MIN_MOMENTUM, step_variance
from kalscope.filtering.params import MAX_MOMENTUM

# The exact log-likelihood of several sensors, its derivatives, and the coordinates in which it is searched.
#
# Convention: as `fuse(...).loglik`. All readings but the first, which sets the exact diffuse start, are scored. The
# offsets enter linearly, so each place of the search has its most likely ones, from the normal equations.


SEARCHED = 15_000
"""Readings that are enough for a search from several starts; only its end needs all of them."""
_SLOPE = 1e-4
"""Relative step in τ for the derivative of ln(step variance)."""


@dataclass(frozen=True)
class Readings:
    """A record as a list of finite readings, in the order of time and, within a row, of the sensors."""

    value: Array
    """Readings less the centre of their sensor, over `scale`, shape (readings,)."""
    sensor: NDArray[np.int64]
    """Which sensor each comes from, shape (readings,)."""
    gap: Array
    """Nominal sample periods since the reading before, shape (readings,); 0 within a row."""
    centre: Array
    """Median reading of each sensor, unit, shape (sensors,)."""
    scale: float
    """A power of two, unit: dividing by it costs no digit."""

    @property
    def sensors(self) -> int:
        """How many sensors there are."""
        return len(self.centre)

    @property
    def m(self) -> int:
        """Scored readings."""
        return len(self.value) - 1

    @property
    def span(self) -> float:
        """Sample periods from the first reading to the last."""
        return float(self.gap.sum())

    def middle(self) -> Readings:
        """A stretch in the middle that is long enough to search in; the record itself where it is short."""
        first = (len(self.value) - SEARCHED) // 2
        if first <= 0:
            return self
        part = slice(first, first + SEARCHED)
        return replace(self, value=self.value[part], sensor=self.sensor[part], gap=self.gap[part])

    @staticmethod
    def of(z: Array, steps: Array, scale: float | None = None) -> Readings:
        """The finite readings of z, shape (n, sensors), each sensor with one at least; `steps` empty = 1 each."""
        rows, sensor = np.nonzero(np.isfinite(z))
        centre = np.nanmedian(z, axis=0)
        value = z[rows, sensor] - centre[sensor]
        time = np.cumsum(steps) if len(steps) else np.arange(len(z), dtype=np.float64)
        gap = np.diff(time[rows], prepend=time[rows[0]])
        if scale is None:
            size = max(float(np.abs(np.diff(value[sensor == i])).max(initial=0.0)) for i in range(z.shape[1]))
            scale = math.ldexp(1.0, min(math.frexp(size)[1], 1023)) if size > 0.0 else 1.0
        return Readings(value / scale, sensor.astype(np.int64), gap, centre, scale)


@dataclass(frozen=True)
class Place:
    """The parameters of one place of the search, in `scale` of the readings, with its log-likelihood."""

    q: float
    """Variance of the movement a nominal sample period."""
    tau: float
    """Momentum in sample periods; 0 = none."""
    r: Array
    """Variance of the noise of each sensor, shape (sensors,)."""
    c: Array
    """Gain of each sensor, shape (sensors,)."""
    offset: Array
    """Most likely offsets of the centred readings, that of the first sensor 0, shape (sensors,)."""
    spread: Array
    """Their covariance, shape (sensors, sensors)."""
    loglik: float
    """Log-likelihood in the unit of the data."""
    by_q: float
    """Its derivative by q."""
    by_tau: float
    """Its derivative by τ."""
    by_r: Array
    """Its derivatives by r, shape (sensors,)."""
    by_c: Array
    """Its derivatives by c, shape (sensors,)."""


def place_at(data: Readings, q: float, tau: float, r: Array, c: Array) -> Place:
    """The log-likelihood of these parameters with their best offsets; −inf where readings contradict r = 0."""
    sensors, record = data.sensors, (data.value, data.sensor, data.gap)
    offset, spread = np.zeros(sensors), np.zeros((sensors, sensors))
    if sensors > 1:
        matrix, right = np.zeros((sensors, sensors)), np.zeros(sensors)
        kernels.offset_equations(*record, q, tau, r, c, matrix, right)
        try:
            spread[1:, 1:] = np.linalg.inv(matrix[1:, 1:])
        except np.linalg.LinAlgError:  # q = 0 or r = 0 to the last digit: no offset is better than another
            spread[1:, 1:] = np.linalg.pinv(np.nan_to_num(matrix[1:, 1:]), hermitian=True)
        offset[1:] = spread[1:, 1:] @ right[1:]
    kept = np.empty((len(data.value), kernels.SEARCH_KEPT))
    chi2, logdet = kernels.filter_readings(*record, q, tau, r, c, offset, kept)
    loglik = -0.5 * (data.m * (math.log(2.0 * math.pi) + 2.0 * math.log(data.scale)) + logdet + chi2)
    by_r, by_c = np.zeros(sensors), np.zeros(sensors)
    by_q, by_tau = kernels.score_readings(*record, q, tau, r, c, offset, kept, by_r, by_c)
    if not math.isfinite(loglik):
        loglik = -math.inf
    return Place(q, tau, r, c, offset, spread, loglik, by_q, by_tau, by_r, by_c)


@dataclass(frozen=True)
class Coordinates:
    """Which parameters are searched, and how: ln(step variance), ln τ, ln r_i, c_i; all others stay.

    The step variance is that of one step of the signal: with momentum, q itself would run away as τ².
    """

    data: Readings
    """The record."""
    base: Place
    """The parameters that stay."""
    moves: bool
    """Whether q is searched."""
    keeps: bool
    """Whether τ is searched."""
    noisy: NDArray[np.intp]
    """The sensors whose r is searched."""
    gained: NDArray[np.intp]
    """The sensors whose c is searched."""

    @property
    def size(self) -> int:
        """Coordinates."""
        return int(self.moves) + int(self.keeps) + len(self.noisy) + len(self.gained)

    def noise_index(self, sensor: int) -> int:
        """The index of ln r of a sensor among the coordinates."""
        return int(self.moves) + int(self.keeps) + int(np.flatnonzero(self.noisy == sensor)[0])

    def start(self) -> Array:
        """The coordinates of `base`, shape (size,)."""
        head = [math.log(self.base.q * step_of(self.base.tau))] if self.moves else []
        head += [math.log(self.base.tau)] if self.keeps else []
        return np.concatenate([head, np.log(self.base.r[self.noisy]), self.base.c[self.gained]])

    def place(self, at: Array) -> Place:
        """The place of coordinates of shape (size,)."""
        parts = iter(at.tolist())
        log_step = next(parts) if self.moves else None
        tau = math.exp(next(parts)) if self.keeps else self.base.tau
        q = self.base.q * step_of(self.base.tau) if log_step is None else math.exp(log_step)
        r, c = self.base.r.copy(), self.base.c.copy()
        r[self.noisy] = np.exp(np.fromiter(parts, np.float64, len(self.noisy)))
        c[self.gained] = np.fromiter(parts, np.float64, len(self.gained))
        return place_at(self.data, q / step_of(tau), tau, r, c)

    def slope(self, at: Place) -> Array:
        """Derivatives of the log-likelihood by the coordinates, shape (size,)."""
        by_log_q = at.q * at.by_q
        head = [by_log_q] if self.moves else []
        if self.keeps:
            head.append(at.tau * at.by_tau - by_log_q * log_step_slope(at.tau))
        return np.concatenate([head, (at.r * at.by_r)[self.noisy], at.by_c[self.gained]])


def step_of(tau: float) -> float:
    """Variance of one step of the signal for q = 1."""
    return step_variance(tau) if tau > 0.0 else 1.0


def log_step_slope(tau: float) -> float:
    """Derivative of ln(step variance) by ln τ."""
    return (math.log(step_of(tau * (1.0 + _SLOPE))) - math.log(step_of(tau * (1.0 - _SLOPE)))) / (2.0 * _SLOPE)


# Newton's method to the top of a smooth function of a few coordinates within bounds, from its exact slopes.
#
# The curvature is the difference of slopes beside the place. So the top is as good as the slopes are, about 1e-10;
# comparing heights alone would stop at 1e-7.


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


# Where the search begins: r of each sensor and q from the variances of differences.


_LEAST = 0.02
"""Least share of the differences between sensors that is attributed to one of them."""
_MOVES = 1.0, 0.1, 1e-3
"""q of the starts, as shares of the smallest variance of the steps of a sensor."""
_MIN_PAIRS = 8
"""Rows that two sensors must share to be compared."""


def starting_places(data: Readings, z: Array, asked: Asked, gains: Array) -> list[Place]:
    """Starts on the middle of the record; z is the record itself, shape (n, sensors), NaN where missing."""
    least = float((np.maximum(step_sizes(data), 1e-12) / gains**2).min())
    noises = guessed_noises(z, data, asked, gains)
    part = data.middle()
    return [place_at(part, share * least, 0.0, noise, gains) for noise in noises for share in _MOVES]


def guessed_noises(z: Array, data: Readings, asked: Asked, gains: Array) -> list[Array]:
    """Guesses of r of all sensors, in scale², each shape (sensors,); a known r stays."""
    steps = np.maximum(step_sizes(data), 1e-12) / gains**2
    guesses = _noises((z - data.centre) / data.scale / gains, steps)
    return [
        np.where(np.isnan(asked.known), np.maximum(one * gains**2, asked.floor), asked.known) for one in guesses
    ]


def starting_gains(data: Readings, z: Array, gained: Indices, gauge: int) -> Array:
    """A gain of each sensor that is searched, from the sizes of what it shares with sensor `gauge`."""
    gains = np.ones(data.sensors)
    centred = (z - data.centre) / data.scale
    for i in gained.tolist():
        both = np.isfinite(centred[:, i]) & np.isfinite(centred[:, gauge])
        if both.sum() >= _MIN_PAIRS:
            own, other = centred[both, i], centred[both, gauge]
            size = np.sqrt(np.mean(own**2) / max(float(np.mean(other**2)), 1e-300))
            gains[i] = float(np.clip(size, 0.01, 100.0)) * (1.0 if np.mean(own * other) >= 0.0 else -1.0)
    return gains


def _noises(z: Array, steps: Array) -> list[Array]:
    """Guesses of r: half the steps, what differs between sensors split among them, and each one nearly exact."""
    sensors = len(steps)
    pairs: list[Array] = []
    sums: list[float] = []
    for i in range(sensors):
        for j in range(i):
            moves = np.diff(z[:, i] - z[:, j])
            moves = moves[np.isfinite(moves)]
            if len(moves) >= _MIN_PAIRS:
                row = np.zeros(sensors)
                row[[i, j]] = 1.0
                pairs.append(row)
                sums.append(0.5 * float(np.mean(moves**2)))
    guesses = [0.25 * steps]
    if not pairs:
        return guesses
    shared = np.array(sums)
    least = _LEAST * max(float(shared.min()), 1e-12)
    if sensors > 2:
        solved = np.linalg.lstsq(np.array(pairs), shared, rcond=None)[0]
    else:
        solved = shared[0] * steps / steps.sum()
    guesses.append(np.maximum(solved, least))
    for i in range(sensors if sensors < 9 else 0):
        exact = np.maximum(guesses[1], float(shared.mean()))
        exact[i] = least
        guesses.append(exact)
    return guesses


# The maximum of the likelihood: several starts, Newton's steps, and the edges where a variance is 0.


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


# What a record allows: 95 % intervals of the variances, from the curvature or, where that is weak, the profile.


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
