"""The noise variance r from what is known of the sensor: a still stretch, or its data sheet."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.array import Array
from kalscope.common.checks import above_zero
from kalscope.common.text import number, plural
from kalscope.errors import BadSetting
from kalscope.estimation.sensor.resolution import resolution_of
from kalscope.filtering.arrays import samples_of
from kalscope.filtering.params import MAX_VARIANCE

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
    drift, left = _about_line(place, samples)
    far = _far(left, step)
    if far.any():
        place, samples = place[~far], samples[~far]
        drift, left = _about_line(place, samples)
    variance = float(left @ left) / (len(place) - 2)
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


def _far(left: Array, step: float) -> NDArray[np.bool_]:
    """The samples that are not noise: far out by the median distance, which spikes hardly change."""
    away = np.abs(left - np.median(left))
    return away > SPIKE * max(_NORMAL * float(np.median(away)), step)


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
