"""A narrow line in the spectrum of a record, such as mains hum or a rotor, and the notch that takes it out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kalscope.common.numbers import Array
from kalscope.common.text import frequency
from kalscope.errors import BadSetting
from kalscope.filtering.classic import MAX_NOTCH, MAX_WIDTH, MIN_NOTCH, MIN_WIDTH, Notch

SEGMENT = 2048
"""Samples of a spectrum; those of a longer record are averaged."""
MIN_SAMPLES = 256
"""Below this a line is as wide as what is beside it."""
MIN_LINE = 0.02
"""Lowest frequency of a line, cycles per sample: slower waves are movement, and a notch there lags by much."""
AROUND = 32
"""Frequencies on each side of one from which the level beside a line is taken."""
FALSE_LINES = 1e-5
"""Probability that white noise shows a line; other noise has a level that is less even."""
STANDS_OUT = 3.0
"""How many times more than that the line must have: levels are not even, and steps and waves leave ripples."""
RELATIVE_WIDTH = 0.1
"""Width of the notch over its frequency: wider costs steps of the signal, narrower misses hum that drifts."""
MOVEMENT = 0.3
"""Share of the variance of a record above which a line may be the movement itself, such as a pulse or a swing."""
WORTH = 0.1
"""Share of the fast noise below which a notch removes less than it costs."""
MAINS = tuple(base * n for base in (50.0, 60.0) for n in (1, 2, 3))
"""Frequencies of mains hum, Hz."""


@dataclass(frozen=True)
class Line:
    """A narrow line in the spectrum."""

    frequency: float
    """Cycles per sample."""
    variance: float
    """Of the line, unit²."""
    of_record: float
    """The same as a share of the variance of the record."""
    of_noise: float
    """The same as a share of its sum with the variance of white noise of the level beside the line."""

    @property
    def is_noise(self) -> bool:
        """Whether a notch may be offered: it removes much noise, and hardly movement."""
        return self.of_noise > WORTH and self.of_record <= MOVEMENT

    def words(self, sample_period: float | None) -> str:
        """Where it is, such as "12.5 Hz, as 50 Hz appears at 62.5 samples a second"."""
        if sample_period is None:
            return f"{self.frequency:.3g} cycles a sample"
        rate, here = 1.0 / sample_period, self.frequency / sample_period
        near = 2.0 * rate / SEGMENT
        mains = [f for f in MAINS if abs(abs(f - rate * round(f / rate)) - here) < near]
        alias = (
            f", as {mains[0]:g} Hz appears at {rate:.4g} samples a second"
            if mains and mains[0] > 0.5 * rate
            else ""
        )
        return f"{frequency(here)}{alias}"


def find_line(z: Array, dt: Array | None = None) -> Line | None:
    """The strongest narrow line in the spectrum of a record; None where none stands out.

    Welch's spectrum of the changes from sample to sample, whose level is even near a line also where the signal
    drifts, against the median of the frequencies around it.

    Args:
        z: samples, shape (n,); NaN where missing, which is taken to be the sample before.
        dt: nominal sample periods before each sample, shape (n,); None = 1 each. Uneven samples have no line.
    """
    if len(z) < MIN_SAMPLES or np.isfinite(z).mean() < 0.9 or (dt is not None and np.abs(dt - 1.0).mean() > 0.1):
        return None
    from scipy.ndimage import median_filter
    from scipy.special import gammainccinv, gammaincinv

    latest = np.maximum.accumulate(np.where(np.isfinite(z), np.arange(len(z)), 0))
    changes = np.diff(z[latest])
    changes = np.clip(changes, *_bounds(changes))
    size = min(SEGMENT, len(changes))
    parts = np.stack(np.split(changes[: len(changes) // size * size], len(changes) // size))
    window = np.hanning(size)
    power = np.mean(np.abs(np.fft.rfft(parts * window)) ** 2, axis=0)[1:-1] / (window @ window)
    at = np.arange(1, len(power) + 1) / size
    count = float(len(parts))
    level = median_filter(power, 2 * AROUND + 1, mode="mirror") / (gammaincinv(count, 0.5) / count)
    usable = (at > max(MIN_LINE, 8.0 / size)) & (at < MAX_NOTCH)
    excess = np.where(usable & (level > 0.0), power / np.maximum(level, 1e-300), 0.0)
    peak = int(np.argmax(excess))
    if excess[peak] < STANDS_OUT * gammainccinv(count, FALSE_LINES / len(power)) / count:
        return None
    near = slice(max(peak - 3, 0), peak + 4)
    above = np.maximum(power[near] - level[near], 0.0)
    center = float(above @ at[near] / above.sum())
    turned = 2.0 - 2.0 * math.cos(2.0 * math.pi * center)  # what differences make of the power at a frequency
    variance = 2.0 * float(above.sum()) / size / turned
    white = float(np.median(level)) / 2.0
    whole = float(np.var(z[latest]))
    return Line(center, variance, variance / max(whole, variance), variance / (variance + white))


def _bounds(changes: Array) -> tuple[float, float]:
    """Where changes are cut, so that steps and spikes leave no ripples: 6 σ by the quartiles."""
    low, middle, high = np.quantile(changes, [0.25, 0.5, 0.75])
    reach = 4.5 * max(high - middle, middle - low)
    return (middle - reach, middle + reach) if reach > 0.0 else (changes.min(), changes.max())


def notch_at(cycles: float) -> Notch:
    """The notch for a frequency in cycles per sample.

    Raises:
        BadSetting: a notch cannot be there.
    """
    return Notch(cycles, min(max(RELATIVE_WIDTH * cycles, MIN_WIDTH), MAX_WIDTH, 0.9 * (0.5 - cycles) + MIN_WIDTH))


def notch_for(hertz: float, sample_period: float | None) -> Notch:
    """The notch for a frequency in Hz, at its alias where the samples are too slow for it.

    Raises:
        BadSetting: the sample period is not known, or the alias is too close to 0 or to half of the sample rate.
    """
    if sample_period is None:
        raise BadSetting(
            f"a notch at {hertz:g} Hz needs the time between two samples: give --sample-period (got none)"
        )
    cycles = abs(hertz * sample_period - round(hertz * sample_period))
    if not MIN_NOTCH <= cycles <= MAX_NOTCH:
        raise BadSetting(
            f"a notch must be between {MIN_NOTCH / sample_period:.3g} and {MAX_NOTCH / sample_period:.4g} Hz"
            f" (got {hertz:g} Hz, which appears at {cycles / sample_period:.3g} Hz)"
        )
    return notch_at(cycles)
