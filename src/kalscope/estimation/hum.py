"""A narrow line in the spectrum of a record, such as mains hum or a rotor, and the notch that takes it out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from kalscope.common.numbers import Array
from kalscope.common.text import frequency, percent
from kalscope.errors import BadSetting
from kalscope.filtering.classic import MAX_NOTCH, MIN_NOTCH, Notch, RunningStage

SEGMENT = 2048
"""Samples of a spectrum; those of a longer record are averaged."""
MAX_SEGMENTS = 256
"""Most of them: the last."""
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
LOWEST_HUM = 5.0
"""Lowest frequency of what may be a rotor or a fan rather than a movement, Hz."""
MIN_RATE = 10.0
"""Lowest rate at which a line may be an alias of the mains, Hz: slower sensors average over its periods."""
MAINS = tuple(base * n for base in (50.0, 60.0) for n in (1, 2, 3))
"""Frequencies of mains hum, Hz."""


@dataclass(frozen=True)
class Line:
    """A narrow line in the spectrum."""

    frequency: float
    """Cycles per sample."""
    of_record: float
    """Its variance as a share of that of the record."""
    of_noise: float
    """Its variance as a share of its sum with that of white noise of the level beside the line."""

    def mains(self, sample_period: float | None) -> float | None:
        """The mains frequency that appears here, Hz; None where none does, or slow samples may meet any of them."""
        rate = 0.0 if sample_period is None else 1.0 / sample_period
        apart = (abs(abs(f - rate * round(f / rate)) - self.frequency * rate) for f in MAINS if rate > MIN_RATE)
        return next((f for f, one in zip(MAINS, apart, strict=False) if one < 2.0 * rate / SEGMENT), None)

    def words(self, sample_period: float | None) -> str:
        """Where it is, such as "12.5 Hz, as 50 Hz appears at 62.5 samples a second"."""
        text, mains = cycles_text(self.frequency, sample_period), self.mains(sample_period)
        if sample_period is None or mains is None or mains < 0.5 / sample_period:
            return text
        return f"{text}, as {mains:g} Hz appears at {1.0 / sample_period:.4g} samples a second"

    def advice(self, sample_period: float | None) -> str:
        """What a notch would do, a clause; "" where it would remove little, or what may be the movement."""
        hum = self.mains(sample_period) is not None and self.of_record <= MOVEMENT
        if self.of_noise < WORTH or not (hum or (sample_period and self.frequency > LOWEST_HUM * sample_period)):
            return ""
        text = f"{self.words(sample_period)} is {percent(self.of_noise)} of the fast noise: a notch takes it out"
        return f"hum at {text}" if hum else f"the narrow line at {text}, unless it is what you measure"


def cycles_text(cycles: float, sample_period: float | None) -> str:
    """A frequency in cycles per sample, in Hz where the sample period is known."""
    return f"{cycles:.3g} cycles a sample" if sample_period is None else frequency(cycles / sample_period)


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
    from scipy.special import gammainccinv, gammaincinv

    z = z[-MAX_SEGMENTS * SEGMENT :]
    z = z[np.argmax(np.isfinite(z)) :]
    z = z[np.maximum.accumulate(np.where(np.isfinite(z), np.arange(len(z)), 0))]
    z = z / max(np.abs(z).max(), np.finfo(float).tiny)  # no unit, so no square leaves the range of a float
    changes = np.diff(z)
    changes = np.clip(changes, *_bounds(changes))
    size = min(SEGMENT, len(changes))
    parts = np.stack(np.split(changes[: len(changes) // size * size], len(changes) // size))
    window = np.hanning(size)
    power = np.mean(np.abs(np.fft.rfft(parts * window)) ** 2, axis=0)[1:-1] / (window @ window)
    at = np.arange(1, len(power) + 1) / size
    count = float(len(parts))
    around = np.lib.stride_tricks.sliding_window_view(np.pad(power, AROUND, mode="reflect"), 2 * AROUND + 1)
    level = np.median(around, axis=1) / (gammaincinv(count, 0.5) / count)
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
    return Line(center, variance / max(float(np.var(z)), variance), variance / (variance + white))


def _bounds(changes: Array) -> tuple[float, float]:
    """Where changes are cut, so that steps and spikes leave no ripples: 6 σ by the quartiles."""
    low, middle, high = np.quantile(changes, [0.25, 0.5, 0.75])
    reach = 4.5 * max(high - middle, middle - low)
    return (middle - reach, middle + reach) if reach > 0.0 else (changes.min(), changes.max())


def behind_notch(z: Array, notch: Notch) -> Array:
    """What a notch passes of samples z, shape (n,); NaN where they are missing."""
    return np.where(np.isnan(z), z, RunningStage(notch).take(z, np.empty(0)))


def notch_for(
    z: Array, dt: Array | None, hertz: float | Literal["auto"], sample_period: float | None
) -> tuple[Notch | None, str]:
    """The notch at a frequency in Hz, or its alias; or at the strongest line of z; and a sentence about it.

    Raises:
        BadSetting: the sample period is not known, or the alias is too close to 0 or to half of the sample rate.
    """
    if hertz == "auto":
        line = find_line(z, dt)
        if line is None:
            return None, "No narrow line stands out of the spectrum, so there is no notch."
        share = f", {percent(line.of_noise)} of the fast noise"
        return _notch(line.frequency), f"A notch takes out {line.words(sample_period)}{share}."
    if sample_period is None:
        must = f"a notch at {hertz:g} Hz needs the time between two samples"
        raise BadSetting(f"{must}: give --sample-period (got none)")
    cycles = abs(hertz * sample_period - round(hertz * sample_period))
    if not MIN_NOTCH <= cycles <= MAX_NOTCH:
        low, high = (edge / sample_period for edge in (MIN_NOTCH, MAX_NOTCH))
        got = f"{hertz:g} Hz, which appears at {cycles / sample_period:.3g} Hz"
        raise BadSetting(f"a notch must be between {low:.3g} and {high:.4g} Hz (got {got})")
    return _notch(cycles), f"A notch takes out {hertz:g} Hz."


def _notch(cycles: float) -> Notch:
    return Notch(cycles, min(RELATIVE_WIDTH * cycles, 0.5 - cycles))
