"""The maximum of the likelihood of several sensors by Newton's steps with exact slopes, and its intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from kalscope.common.numbers import Array, Indices
from kalscope.common.progress import Progress
from kalscope.estimation import kernels
from kalscope.estimation.likelihood import DROP
from kalscope.filtering.kernels import transition
from kalscope.filtering.params import MAX_MOMENTUM

# The exact log-likelihood of several sensors, its derivatives, and the coordinates in which it is searched.
#
# Convention: as `fuse(...).loglik`. All readings but the first, which sets the exact diffuse start, are scored. The
# offsets enter linearly, so each place of the search has its most likely ones, from the normal equations.


MIN_MOMENTUM = 0.1
"""Shortest τ searched, in samples: a velocity that is forgotten faster cannot be distinguished from none."""
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

    def quantity(self, z: Array, data: Readings) -> Array:
        """What each reading of z, shape (n, sensors), makes of the quantity, unit."""
        return (z - data.centre - self.offset * data.scale) / self.c


def place_at(data: Readings, q: float, tau: float, r: Array, c: Array) -> Place:
    """The log-likelihood of these parameters with their best offsets; −inf where readings contradict r = 0."""
    sensors, model = data.sensors, (data.value, data.sensor, data.gap, q, tau, r, c)
    offset, spread = np.zeros(sensors), np.zeros((sensors, sensors))
    if sensors > 1:
        matrix, right = np.zeros((sensors, sensors)), np.zeros(sensors)
        kernels.filter_readings(*model, offset, None, matrix, right)
        inner = matrix[1:, 1:]
        try:
            spread[1:, 1:] = np.linalg.inv(inner)
        except np.linalg.LinAlgError:  # q = 0 or r = 0 to the last digit: no offset is better than another
            spread[1:, 1:] = np.linalg.pinv(np.nan_to_num(inner), hermitian=True)
        offset[1:] = spread[1:, 1:] @ right[1:]
    kept = np.empty((len(data.value), kernels.SEARCH_KEPT))
    chi2, logdet = kernels.filter_readings(*model, offset, kept, None, None)
    loglik = -0.5 * (data.m * (math.log(2.0 * math.pi) + 2.0 * math.log(data.scale)) + logdet + chi2)
    by_r, by_c = np.zeros(sensors), np.zeros(sensors)
    by_q, by_tau = kernels.score_readings(*model, offset, kept, by_r, by_c)
    return Place(
        q, tau, r, c, offset, spread, loglik if math.isfinite(loglik) else -math.inf, by_q, by_tau, by_r, by_c
    )


STEP, MOMENTUM, FIRST_NOISE = 0, 1, 2
"""Places of the parameters in a row: the step variance, τ, then r and then c of each sensor."""


@dataclass(frozen=True)
class Coordinates:
    """The parameters that are searched, as ln(step variance), ln τ, ln r_i and c_i; all others stay.

    The step variance is that of one step of the signal: with momentum, q itself would run away as τ².
    """

    data: Readings
    """The record."""
    base: Place
    """The parameters that stay."""
    free: Indices
    """Those that are searched, ascending."""

    @cached_property
    def _logs(self) -> int:
        """How many of them, the first ones, are logarithms; the others are gains."""
        return int(np.sum(self.free < FIRST_NOISE + self.data.sensors))

    @property
    def gained(self) -> Indices:
        """The sensors whose gain is searched."""
        return self.free[self._logs :] - FIRST_NOISE - self.data.sensors

    @cached_property
    def _row(self) -> Array:
        base = self.base
        return np.concatenate([[base.q * step_variance(base.tau), base.tau], base.r, base.c])

    def index(self, parameter: int) -> int:
        """Which coordinate a parameter is."""
        return int(np.searchsorted(self.free, parameter))

    def start(self) -> Array:
        """The coordinates of `base`."""
        at = self._row[self.free]
        at[: self._logs] = np.log(at[: self._logs])
        return at

    def place(self, at: Array) -> Place:
        """The place of coordinates."""
        row = self._row.copy()
        row[self.free] = np.append(np.exp(at[: self._logs]), at[self._logs :])
        step, tau = row[:FIRST_NOISE].tolist()
        return place_at(self.data, step / step_variance(tau), tau, *row[FIRST_NOISE:].reshape(2, -1))

    def slope(self, at: Place) -> Array:
        """Derivatives of the log-likelihood by the coordinates."""
        by_step = at.q * at.by_q
        by_tau = at.tau * at.by_tau - by_step * log_step_slope(at.tau) if at.tau > 0.0 else 0.0
        return np.concatenate([[by_step, by_tau], at.r * at.by_r, at.by_c])[self.free]


def step_variance(tau: float) -> float:
    """Variance of one step of the signal for q = 1."""
    if tau == 0.0:
        return 1.0
    _, f, a, _, _ = transition(1.0, 1.0, tau)
    return float(a + 0.5 * f * f / tau)


def log_step_slope(tau: float) -> float:
    """Derivative of ln(step variance) by ln τ."""
    return (math.log(step_variance(tau * (1.0 + _SLOPE))) - math.log(step_variance(tau * (1.0 - _SLOPE)))) / (
        2.0 * _SLOPE
    )


# Newton's method to the top of a smooth function of a few coordinates within bounds, from its exact slopes.
#
# The top is as good as the slopes are, about 1e-10; comparing heights alone would stop at 1e-7.


Local = tuple[float, Array, Callable[[], Array]]
"""Height, slope, shape (k,), and what computes the curvature, shape (k, k)."""

Function = Callable[[Array], Local]
"""The function at coordinates of shape (k,)."""

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
_SHORT = 0.1
"""Step of which the rise is known without going there."""
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
    low: Array
    """Lower bounds of the coordinates."""
    high: Array
    """Upper bounds."""

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the coordinates; inf for one at a bound or without curvature."""
        full = np.diag(np.full(len(self.at), math.inf))
        inner = (self.at > self.low) & (self.at < self.high)
        information = -self.curvature[np.ix_(inner, inner)]
        if inner.any() and np.all(np.linalg.eigvalsh(information) > 1e-9):
            full[np.ix_(inner, inner)] = np.linalg.inv(information)
        return full

    def error(self, index: int) -> float:
        """Standard error of one coordinate."""
        return math.sqrt(float(self.covariance[index, index]))


def climb(
    function: Function, start: Array, low: Array, high: Array, least: float = LEAST, steps: int = MAX_STEPS
) -> Top:
    """The top that steps uphill from `start` come to, within `low` and `high`, shape (k,) each.

    A step that rises by less than `least` is the last one, and so is the one after `steps` of them.
    """
    at = np.clip(start, low, high)
    height, slope, bend = function(at)
    curvature = np.zeros((len(at), len(at)))
    for _ in range(steps if len(at) else 0):
        curvature = bend()
        step = _step(at, slope, curvature, low, high)
        there = np.clip(at + step, low, high)
        length, rise = float(np.abs(there - at).max()), 0.5 * float(slope @ (there - at))
        if rise < least and length < _SHORT:
            at, height = there, height + rise
            break
        moved = _search(function, at, height, step, low, high)
        if moved is None:
            break
        risen = moved[1][0] - height
        at, (height, slope, bend) = moved
        if length < _ENOUGH or risen < least:
            break
    return Top(at, height, curvature, low, high)


def _step(at: Array, slope: Array, curvature: Array, low: Array, high: Array) -> Array:
    """Newton's step, with every curvature taken as that of a hilltop; what it takes to a bound stays there."""
    free, step = ~((at <= low) & (slope < 0.0) | (at >= high) & (slope > 0.0)), np.zeros(len(at))
    beyond = free
    while beyond.any():
        bent, ways = np.linalg.eigh(curvature[np.ix_(free, free)])
        steep = np.maximum(np.abs(bent), max(_STEEP * float(np.abs(bent).max(initial=0.0)), 1e-12))
        rest = (slope + curvature[:, ~free] @ step[~free])[free]
        step[free] = ways @ ((ways.T @ rest) / steep)
        step[free] *= min(1.0, MAX_STEP / max(float(np.abs(step[free]).max(initial=0.0)), 1e-300))
        beyond = free & ((at + step < low) | (at + step > high))
        step, free = np.clip(at + step, low, high) - at, free & ~beyond
    return step


def _search(
    function: Function, at: Array, height: float, step: Array, low: Array, high: Array
) -> tuple[Array, Local] | None:
    """The first of shorter and shorter steps that does not lead down; None where even the shortest does."""
    slack = 1e-13 * abs(height)
    for halvings in range(24):
        there = np.clip(at + step * 0.5**halvings, low, high)
        values = function(there)
        if math.isfinite(values[0]) and values[0] >= height - slack:
            return there, values
    return None


# The end of a 95 % interval: where the profile of the likelihood over one coordinate falls below the mark.


NORMAL = math.sqrt(2.0 * DROP)
"""Standard errors from the middle to the end of a 95 % interval, 1.96."""
SURE = 0.1
"""Standard error of the logarithm of a variance up to which its likelihood is as good as normal."""
FINE = 1e-4
"""Rise of the likelihood that matters for the end of an interval."""
FINE_STEPS = 10
"""Steps of the other parameters towards their best; they start where they were a little further inside."""
_WIDENING, _MARGIN = 1.7, 0.05
"""Factor between two steps outwards; share of the bracket that a step back leaves on either side at least."""
_STEPS = 12
"""Steps towards the end within its bracket."""


def interval_end(
    top: Top, profile: Callable[[float, Array], tuple[float, Array]], index: int, side: float
) -> tuple[float, Array, bool]:
    """Go outwards until the likelihood has fallen by DROP, then towards that place; √drop is almost straight.

    Args:
        top: the maximum.
        profile: the highest likelihood where this coordinate has a value, and the other coordinates there, searched
            from some near them.
        index: the coordinate.
        side: −1 for the lower end, 1 for the upper.

    Returns:
        The end, the best other coordinates there, and whether the likelihood falls so far within the bounds.
    """
    others = np.arange(len(top.at)) != index
    inside, border = float(top.at[index]), float((top.low if side < 0.0 else top.high)[index])
    rest, last, fallen = top.at[others], inside, 0.0
    follow = -np.linalg.pinv(top.curvature[np.ix_(others, others)]) @ top.curvature[others, index]
    bent = -float(top.curvature[index, index] + top.curvature[index, others] @ follow)
    stride = NORMAL * min(max(bent, 1.0) ** -0.5, 1.0)

    def drop(value: float) -> float:
        nonlocal rest, last
        height, rest = profile(value, rest + (value - last) * follow)
        last = value
        return max(top.height - height, 0.0)

    outside, beyond = inside, 0.0
    while beyond < DROP:
        if side * (outside - border) >= 0.0:
            return border, rest, False
        inside, fallen, stride = outside, beyond, stride * (_WIDENING if outside != inside else 1.0)
        outside = side * min(side * inside + stride, side * border)
        beyond = drop(outside)
    middle, between = outside, beyond
    for _ in range(_STEPS):
        if abs(between - DROP) < 1e-3:
            break
        share = (math.sqrt(DROP) - math.sqrt(fallen)) / (math.sqrt(beyond) - math.sqrt(fallen))
        middle = inside + min(max(share, _MARGIN), 1.0 - _MARGIN) * (outside - inside)
        between = drop(middle)
        if between < DROP:
            inside, fallen = middle, between
        else:
            outside, beyond = middle, between
    return middle, rest, True


# Where the search begins: r of each sensor and q from the variances of differences.


_LEAST = 0.02
"""Least share of the differences between sensors that is attributed to one of them."""
_MOVES = 1.0, 0.1, 1e-3
"""q of the starts, as shares of the smallest variance of the steps of a sensor."""
_MIN_PAIRS = 8
"""Rows that two sensors must share to be compared."""


def starting_places(data: Readings, z: Array, options: FitOptions, gains: Array) -> list[Place]:
    """Starts on the middle of the record; z is the record itself, shape (n, sensors), NaN where missing."""
    least = float((np.maximum(step_sizes(data), 1e-12) / gains**2).min())
    noises = guessed_noises(z, data, options, gains)
    part = data.middle()
    return [place_at(part, share * least, 0.0, noise, gains) for noise in noises for share in _MOVES]


def guessed_noises(z: Array, data: Readings, options: FitOptions, gains: Array) -> list[Array]:
    """Guesses of r of all sensors, in scale², each shape (sensors,); a known r stays."""
    steps = np.maximum(step_sizes(data), 1e-12) / gains**2
    guesses = _noises((z - data.centre) / data.scale / gains, steps)
    return [
        np.where(np.isnan(options.known), np.maximum(one * gains**2, options.floor), options.known)
        for one in guesses
    ]


def starting_gains(data: Readings, z: Array, gained: Indices, gauge: int) -> Array:
    """A gain of each sensor that is searched, from the sizes of what it shares with sensor `gauge`."""
    gains = np.ones(data.sensors)
    centred = (z - data.centre) / data.scale
    for i in gained.tolist():
        both = np.isfinite(centred[:, i]) & np.isfinite(centred[:, gauge])
        if both.sum() >= _MIN_PAIRS:
            one, other = centred[both, i], centred[both, gauge]
            size = np.sqrt(np.mean(one**2) / max(float(np.mean(other**2)), 1e-300))
            gains[i] = float(np.clip(size, 0.01, 100.0)) * (1.0 if np.mean(one * other) >= 0.0 else -1.0)
    return gains


def _noises(z: Array, steps: Array) -> list[Array]:
    """Guesses of r: half the steps, what differs between sensors split among them, and each one nearly exact."""
    sensors = len(steps)
    pairs, sums = list[Array](), list[float]()
    for i, j in combinations(range(sensors), 2):
        moves = np.diff(z[:, i] - z[:, j])
        moves = moves[np.isfinite(moves)]
        if len(moves) >= _MIN_PAIRS:
            pairs.append(np.isin(np.arange(sensors), (i, j)).astype(np.float64))
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
class FitOptions:
    """What a fit searches."""

    known: Array
    """r of the sensors whose noise is known, in scale², NaN for all others, shape (sensors,)."""
    floor: Array
    """Least r of each sensor, in scale², shape (sensors,): that of rounding, or 0."""
    keeps: bool
    """Whether τ is searched."""
    gained: Indices
    """The sensors whose gain is searched."""

    @staticmethod
    def of_all(sensors: int, keeps: bool) -> FitOptions:
        """All r, none known, and no gain."""
        return FitOptions(np.full(sensors, math.nan), np.zeros(sensors), keeps, np.empty(0, np.intp))


@dataclass(frozen=True)
class SensorFit:
    """The best place, and the shape of the likelihood around it."""

    coordinates: Coordinates
    """What was searched; a variance at an edge is not among it."""
    top: Top
    """The top in these coordinates."""
    place: Place
    """The parameters there."""

    @property
    def keeps(self) -> bool:
        """Whether τ was searched."""
        return MOMENTUM in self.coordinates.free


def best_fit(data: Readings, options: FitOptions, starts: Sequence[Place], progress: Progress) -> SensorFit:
    """The highest place near one of the starts, which are on `data.middle()`, or at an edge."""
    part = data.middle()
    starts = sorted(starts, key=lambda one: -one.loglik)[:_MAX_TRIED]
    tops: list[SensorFit] = []
    for i, start in enumerate(starts):
        progress(0.5 * i / len(starts), "likelihood of all sensors together")
        tops.append(climbed(part, options, start))
    if part is not data:
        tops = [climbed(data, options, start) for start in _apart([one.place for one in tops])]
    best = max(tops, key=lambda one: one.place.loglik)
    progress(0.7, "likelihood at the edges")
    for edge in _edges(data, options, best.place):
        there = climbed(data, options, edge)
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


def climbed(data: Readings, options: FitOptions, start: Place, least: float = LEAST) -> SensorFit:
    """The top above one start, up to a step that rises by less than `least`; a variance that is 0 there stays."""
    coordinates = coordinates_of(data, options, start)
    return top_of(coordinates, coordinates.start(), *bounds(coordinates, options.floor), least)


def coordinates_of(data: Readings, options: FitOptions, place: Place) -> Coordinates:
    """The coordinates around a place: all that is to be fitted, but no variance that is 0 there."""
    noisy = np.isnan(options.known) & (place.r > 0.0)
    gained = np.isin(np.arange(data.sensors), options.gained)
    free = np.concatenate([[place.q > 0.0, options.keeps and place.q > 0.0], noisy, gained])
    return Coordinates(data, place, np.flatnonzero(free))


def top_of(coordinates: Coordinates, start: Array, low: Array, high: Array, least: float = LEAST) -> SensorFit:
    """The top of the likelihood in these coordinates."""
    top = climb(_likelihood(coordinates, high), start, low, high, least)
    return SensorFit(coordinates, top, coordinates.place(top.at))


def _likelihood(coordinates: Coordinates, high: Array, held: int | None = None, value: float = 0.0) -> Function:
    """The log-likelihood over the coordinates, or over all but the one that is held at a value."""
    others = np.arange(len(high)) != (-1 if held is None else held)

    def function(at: Array) -> Local:
        place = coordinates.place(at if held is None else np.insert(at, held, value))
        slope = coordinates.slope(place)[others]

        def curvature() -> Array:
            """By slopes beside the place: so the top is as good as the slopes are."""
            rows = np.empty((len(at), len(at)))
            for i in range(len(at)):
                side = BESIDE if at[i] + BESIDE <= high[others][i] else -BESIDE
                beside = at.copy()
                beside[i] += side
                rows[i] = (function(beside)[1] - slope) / side
            return np.nan_to_num(0.5 * (rows + rows.T))

        return place.loglik, slope, curvature

    return function


def bounds(coordinates: Coordinates, floor: Array) -> tuple[Array, Array]:
    """Lower and upper bounds of the coordinates."""
    size, gain = math.log(max(step_sizes(coordinates.data).max(), 1e-300)), coordinates.base.c
    with np.errstate(divide="ignore"):
        least = np.maximum(size - LOWEST, np.log(floor))
    ends = np.sort([gain / _MAX_GAIN, gain * _MAX_GAIN], axis=0)
    low = np.concatenate([[size - LOWEST, math.log(MIN_MOMENTUM)], least, ends[0]])
    high = np.concatenate([[size + HIGHEST, math.log(MAX_MOMENTUM)], np.full(len(gain), size + HIGHEST), ends[1]])
    return low[coordinates.free], high[coordinates.free]


def step_sizes(data: Readings) -> Array:
    """Mean square of the differences of neighbouring readings of each sensor, shape (sensors,)."""
    values = (data.value[data.sensor == i] for i in range(data.sensors))
    return np.array([float(np.mean(np.diff(one) ** 2)) if len(one) > 1 else 0.0 for one in values])


def _edges(data: Readings, options: FitOptions, best: Place) -> list[Place]:
    """The edges that may be higher: no movement, or no noise in one sensor."""
    edges: list[Place] = []
    if best.q > 0.0 and best.r.min() > 0.0:
        edges.append(place_at(data, 0.0, best.tau, best.r, best.c))
    if best.q > 0.0 and not np.any(options.known == 0.0):
        for i in np.flatnonzero(np.isnan(options.known) & (options.floor == 0.0)):
            r = np.where(np.arange(data.sensors) == i, 0.0, best.r)
            edges.append(place_at(data, best.q, best.tau, r, best.c))
    return [edge for edge in edges if edge.loglik > best.loglik - _FAR]


# What a record allows: 95 % intervals of the variances, from the curvature or, where that is weak, the profile.


def noise_interval(fit: SensorFit, options: FitOptions, sensor: int) -> tuple[float, float]:
    """The r of one sensor that the record allows, in scale²."""
    known = float(options.known[sensor])
    if not math.isnan(known):
        return known, known
    if fit.place.r[sensor] == 0.0:
        return 0.0, _upper_end(fit, options, FIRST_NOISE + sensor)
    low, high = _interval(fit, FIRST_NOISE + sensor)
    return max(low, float(options.floor[sensor])), high


def movement_interval(fit: SensorFit, options: FitOptions) -> tuple[float, float]:
    """The q that the record allows, in scale²."""
    place = fit.place
    if place.q == 0.0:
        return 0.0, _upper_end(fit, options, STEP)
    if not fit.keeps:
        step = step_variance(place.tau)
        low, high = _interval(fit, STEP)
        return low / step, high / step
    slope = np.array([1.0, -log_step_slope(place.tau)])
    variance = float(slope @ fit.top.covariance[:2, :2] @ slope)
    error = NORMAL * math.sqrt(variance) if math.isfinite(variance) and variance >= 0.0 else math.inf
    return place.q * math.exp(-error), place.q * (math.exp(error) if error < 700.0 else math.inf)


def momentum_interval(fit: SensorFit) -> tuple[float, float]:
    """The τ that the record allows, in sample periods; from 0, or up to inf, as where it was cut to the record."""
    return _interval(fit, MOMENTUM) if fit.keeps else (fit.place.tau, math.inf)


def _interval(fit: SensorFit, parameter: int) -> tuple[float, float]:
    """The ends of a parameter; 0 and inf beyond the bounds of the search."""
    index = fit.coordinates.index(parameter)
    at, error = float(fit.top.at[index]), fit.top.error(index)
    if error <= SURE:
        return math.exp(at - NORMAL * error), math.exp(at + NORMAL * error)
    return _end(fit, index, -1.0), _end(fit, index, 1.0)


def _upper_end(fit: SensorFit, options: FitOptions, parameter: int) -> float:
    """The largest value of a variance that is 0 at the top, from one on whose likelihood is not much lower yet."""
    place, low = fit.place, fit.top.low
    row, slopes = np.append(place.q, place.r), np.append(place.by_q, place.by_r)
    index = max(parameter - FIRST_NOISE + 1, 0)
    guess = math.exp(float(low.min()) + 1.0) if len(low) else 1e-18
    if slopes[index] < 0.0:
        guess = max(0.01 * DROP / max(-float(slopes[index]), 1e-300), guess)
    row[index] = guess
    edge = place_at(fit.coordinates.data, float(row[0]), place.tau, row[1:], place.c)
    coordinates = coordinates_of(fit.coordinates.data, replace(options, keeps=fit.keeps), edge)
    low, high = bounds(coordinates, options.floor)
    at, flat = np.clip(coordinates.start(), low, high), np.zeros((len(low), len(low)))
    top = Top(at, fit.top.height, flat, low, high)
    return _end(SensorFit(coordinates, top, edge), coordinates.index(parameter), 1.0)


def _end(fit: SensorFit, index: int, side: float) -> float:
    """Where the likelihood has fallen to the mark; 0 or inf beyond the bounds."""
    others = np.arange(len(fit.top.at)) != index
    low, high = fit.top.low[others], fit.top.high[others]

    def profile(value: float, rest: Array) -> tuple[float, Array]:
        top = climb(_likelihood(fit.coordinates, fit.top.high, index, value), rest, low, high, FINE, FINE_STEPS)
        return top.height, top.at

    end, _, crossed = interval_end(fit.top, profile, index, side)
    return math.exp(end if crossed else side * math.inf)
