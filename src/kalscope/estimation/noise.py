"""What is known of a sensor before any fit: its noise, its resolution, a first guess of q and r."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.numbers import Array, above_zero
from kalscope.common.text import number, plural
from kalscope.errors import BadSetting
from kalscope.filtering.params import MAX_VARIANCE, samples_of

# The noise variance r from what is known of the sensor: a still stretch, or its data sheet.


MIN_STILL_SAMPLES = 8
"""Finite samples of a still stretch."""
SPIKE = 6.0
"""Standard deviations from the line beyond which a sample of a still stretch is a spike."""
_NORMAL = 1.4826
"""Standard deviation of normal noise over its median distance."""


@dataclass(frozen=True)
class StillNoise:
    """The noise of a sensor whose input does not change."""

    r: float
    """Measurement-noise variance, unit²: the variance without the drift, but at least `floor`."""
    variance: float
    """Variance about the straight line through the stretch, unit²."""
    drift: float
    """Slope of that line, unit a sample."""
    quantum: float
    """Resolution Δ of the readings, unit; 0 where none is visible."""
    floor: float
    """Δ²/12, the variance that rounding to steps of Δ adds, unit²."""
    samples: int
    """Finite samples used; spikes are not."""
    message: str
    """What r is based on, for the user."""


def noise_from_still(z_segment: ArrayLike, quantum: float | None = None) -> StillNoise:
    """The noise variance r from a stretch in which the true value did not change.

    Args:
        z_segment: measurements of that stretch, shape (n,), at least 8 of them finite; NaN is a missing sample.
        quantum: resolution Δ of the readings in their unit, ≥ 0; None = the step that the readings show.

    Raises:
        BadSetting: too few finite samples, inf, another shape, a negative quantum, or equal readings without a
            quantum.

    Source: residual variance of a straight line, Σe²/(n − 2); rounding to steps of Δ adds Δ²/12 (Widrow 1956).
    """
    column = samples_of(z_segment)
    if column.ndim != 1 or np.isinf(column).any():
        raise BadSetting(f"the still stretch must be finite samples, shape (n,) (got shape {column.shape})")
    place = np.flatnonzero(np.isfinite(column))
    if len(place) < MIN_STILL_SAMPLES:
        raise BadSetting(f"the still stretch must hold at least {MIN_STILL_SAMPLES} samples (got {len(place)})")
    if quantum is not None and not 0.0 <= quantum < math.inf:
        raise BadSetting(f"quantum must be a finite step, 0 or more (got {quantum})")
    samples = column[place]
    step = resolution_of(samples) if quantum is None else float(quantum)
    drift, residual = _about_line(place, samples)
    distance = np.abs(residual - np.median(residual))  # far by the median distance, which spikes hardly change
    far = distance > SPIKE * max(_NORMAL * float(np.median(distance)), step)
    if far.any():
        place, samples = place[~far], samples[~far]
        drift, residual = _about_line(place, samples)
    variance = float(residual @ residual) / (len(place) - 2)
    floor = step**2 / 12.0
    if max(variance, floor) == 0.0:
        raise BadSetting("the still stretch must show noise, or quantum must be given (got equal readings)")
    if floor > variance:
        message = f"The readings hardly change: r is Δ²/12, the variance of rounding to steps of {number(step, 4)}."
    else:
        message = f"Standard deviation {number(math.sqrt(variance), 4)} over {len(place)} readings, drift removed."
    if far.any():
        message += f" {plural(int(far.sum()), 'spike')} beyond {SPIKE:g} σ left out."
    return StillNoise(max(variance, floor), variance, drift, step, floor, len(place), message)


def _about_line(place: NDArray[np.intp], samples: Array) -> tuple[float, Array]:
    """The slope of the straight line through the samples, and how far each lies from it."""
    middle = place - place.mean()
    level = samples - samples[0]
    drift = float(middle @ level / (middle @ middle))
    return drift, level - level.mean() - drift * middle


def noise_from_datasheet(
    *, sigma: float | None = None, density: float | None = None, bandwidth_hz: float | None = None
) -> float:
    """The noise variance r, unit², from a data sheet.

    Args:
        sigma: RMS noise (one standard deviation), unit, > 0: r = σ².
        density: noise density, unit/√Hz, > 0, with bandwidth_hz: r = density² · bandwidth.
        bandwidth_hz: noise bandwidth at the output, Hz, > 0; for a first-order low-pass π/2 times its −3 dB
            frequency; without any filter half the sample rate.

    Raises:
        BadSetting: neither or both of sigma and density, density without bandwidth, or a value not above 0.
    """
    if (sigma is None) == (density is None):
        raise BadSetting(f"one of sigma and density must be given (got sigma = {sigma}, density = {density})")
    if sigma is not None:
        return above_zero("sigma", sigma, MAX_VARIANCE) ** 2
    if density is None or bandwidth_hz is None:
        raise BadSetting("density needs bandwidth_hz, the bandwidth of the noise in Hz (got None)")
    bandwidth = above_zero("bandwidth_hz", bandwidth_hz, MAX_VARIANCE)
    return above_zero("density", density, MAX_VARIANCE) ** 2 * bandwidth


# The resolution of a sensor: the step Δ of its readings, from its converter or from the digits that are printed.
#
# Between neighbouring levels lie one or a few steps, so the most frequent distance between them is Δ. A printed
# digit may round the steps once more: 0.06, 0.12, 0.19 and 0.25 are steps of 0.0625.


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
    levels, occurrences = np.unique(chosen, return_counts=True)
    distances = np.diff(levels)
    apart = distances > MIN_STEP * np.abs(levels).max()
    firsts = np.append(True, apart)  # levels that differ only by rounding are one
    levels, distances = levels[firsts], distances[apart]
    counts = np.add.reduceat(occurrences.astype(np.float64), np.flatnonzero(firsts))
    if not len(distances):
        return 0.0
    step = _refined(_usual(distances), levels, counts)
    return math.ldexp(step, exponent) if _share_on_grid(step, levels, counts) >= ON_GRID else 0.0


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
        offset = levels[near] - middle
        places = np.rint(offset / step)
        close = np.abs(offset - places * step) <= 2.0 * _TOLERANCE * step
        if not close.any():  # no grid: the middle lies between the levels
            break
        places, offset = places[close], offset[close]
        spread = places - places.mean()
        if spread.any():  # the slope of a straight line through the levels
            step = float(spread @ offset) / float(spread @ spread)
        middle += float(np.mean(offset - places * step))
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


# The size of the noise where no estimate gives it: what a band or a harmless filter needs.


EVEN = 1e-9
"""Steps whose relative difference is smaller are equal."""


ROUNDING = 1e-15
"""Steps, relative to the largest sample, whose difference is smaller differ only by rounding."""


def noise_scale(z: ArrayLike) -> float:
    """A variance in the unit of the samples z, shape (n,), NaN where missing: var(Δz)/2, that of white noise alone.

    An even ramp, such as a counter, shows no noise: it is then (Δz)²/2, because var(Δz) is only rounding. Nor does
    a constant signal: it is then (|z|/1000)², or 1 where z is 0.
    """
    finite = samples_of(z)
    finite = finite[np.isfinite(finite)]
    size, half_variance = float(np.abs(finite).max(initial=0.0)), 0.0
    if len(finite) > 2 and size > 0.0:
        steps = np.diff(finite / size)
        even = is_even_ramp(finite)
        half_variance = 0.5 * (float(np.mean(steps)) ** 2 if even else float(np.var(steps, ddof=1)))
        half_variance = 0.0 if even and half_variance < ROUNDING**2 else half_variance
    scale = size or 1.0
    r = (half_variance or (1e-6 if size > 0.0 else 1.0)) * scale * scale
    return min(max(r, 1e-290), MAX_VARIANCE)


def is_even_ramp(z: Array) -> bool:
    """Whether the finite samples z, shape (n,), n ≥ 2, are constant or rise or fall by equal steps."""
    size = float(np.abs(z).max())
    if size == 0.0:
        return True
    steps = np.diff(z / size)
    return float(np.ptp(steps)) <= EVEN * float(np.abs(steps).max()) + ROUNDING
