"""Which frequencies the signal, the filter's output and what it takes away are made of; and the Allan deviation.

The density is Welch's (1967); the Allan deviation is the overlapping one (IEEE Std 1139; Riley 2008, NIST SP 1065).
Both stand beside what the model says at the present q and r.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.arrays import one_channel
from kalscope.estimation.allan import allan_variances
from kalscope.filtering import kalman_filter
from kalscope.model import FilterParams
from kalscope.steady_state import steady_state
from kalscope.tune_report import duration

Array = NDArray[np.float64]

LEAST = 32
"""Samples in a row below which there is no density to speak of."""

LONGEST_PIECE = 16_384
"""Samples of a Welch segment at most."""

SIZES_PER_OCTAVE = 3
"""Averaging lengths in each doubling."""

LONGEST_ALLAN = 2_000_000
"""Samples whose Allan deviation is taken at most; the first ones."""


@dataclass(frozen=True)
class Spectrum:
    """Densities of one channel, arrays of shape (f,); per cycle/sample where there is no sample period."""

    frequency: Array
    """Frequencies above 0, Hz (cycles a sample without a sample period)."""
    raw: Array
    """One-sided density of the measurements, unit²/Hz; its integral is their variance."""
    filtered: Array
    """The same of the filtered signal."""
    residual: Array
    """The same of what the filter takes away, raw − filtered."""
    response: Array
    """|H| of the settled filter there, 0 … 1."""
    cutoff: float
    """−3 dB frequency of the settled filter, in the unit of `frequency`; NaN where there is none."""
    in_hertz: bool
    """Whether frequencies are in Hz."""
    samples: int
    """Samples that were used; 0 where there are too few for a density."""
    segments: int
    """Half-overlapping segments that were averaged: a density is good to about 1/√segments."""
    note: str
    """How it was made, and how missing samples were dealt with."""


@dataclass(frozen=True)
class AllanDeviation:
    """Overlapping Allan deviation of one channel; arrays have shape (k,)."""

    size: Array
    """Averaging lengths, samples, log-spaced."""
    tau: Array
    """The same in s; in samples without a sample period."""
    deviation: Array
    """Of the recording, unit."""
    spread: Array
    """One standard error of it, unit, from the number of independent averages."""
    model: Array
    """What white noise r and a random walk q would show, unit."""
    best_size: float
    """Averaging length of the model's minimum, samples; inf for q = 0, 1 where averaging never helps."""
    in_seconds: bool
    """Whether `tau` is in s."""
    message: str
    """What the minimum means, in plain sentences."""


def magnitude_response(gain: float, frequency: ArrayLike) -> Array:
    """|H| of the settled filter x += K (z − x) at frequencies in cycles a sample.

    |H|² = K² / (1 − 2(1 − K) cos 2πf + (1 − K)²), from H = K / (1 − (1 − K) e^(−2πif)); the denominator is
    computed as K² + 4(1 − K) sin² πf, which loses no digits at low frequencies.
    """
    wave = np.sin(np.pi * np.asarray(frequency, dtype=np.float64))
    if gain <= 0.0:
        return np.zeros_like(wave)
    return gain / np.sqrt(gain * gain + 4.0 * (1.0 - gain) * wave * wave)


def spectrum(
    z: ArrayLike, params: FilterParams, dt: ArrayLike | None = None, sample_period: float | None = None
) -> Spectrum:
    """Power densities of raw, filtered and residual, with the filter's response.

    Missing samples: the longest stretch without one is used if it holds half of the samples; otherwise a straight
    line bridges each gap, which adds slow movement that was not measured. The note says which.

    Args:
        z: measurements of one channel, shape (n,); NaN is a missing sample.
        params: the present setting, scalars.
        dt: nominal sample periods before each sample, shape (n,), for the filter only.
        sample_period: nominal sample period in s, > 0; None = per cycle/sample.

    Raises:
        BadSetting: z is not one channel, or z, dt, params or the period do not fit.

    Source: Welch (1967), IEEE Trans. AU-15, 70; Hann windows, half overlap, the mean of each segment taken off.
    """
    samples = one_channel(z, params)
    steady = steady_state(params, sample_period)
    period = 1.0 if sample_period is None else float(sample_period)
    curve = kalman_filter(samples, params, dt).x
    part, note = whole_stretch(samples)
    length = part.stop - part.start
    if length < LEAST:
        return _nothing(sample_period is not None, f"A spectrum needs {LEAST} samples (got {length}).")
    raw, filtered = _bridged(samples[part]), _bridged(curve[part])
    piece = min(max(2 ** int(math.log2(length / 4)), LEAST), LONGEST_PIECE, length)
    frequency, raw_density = _welch(raw, piece, period)
    segments = (length - piece) // (piece // 2) + 1
    return Spectrum(
        frequency=frequency,
        raw=raw_density,
        filtered=_welch(filtered, piece, period)[1],
        residual=_welch(raw - filtered, piece, period)[1],
        response=magnitude_response(float(steady.gain), frequency * period),
        cutoff=_cutoff(params, period),
        in_hertz=sample_period is not None,
        samples=length,
        segments=segments,
        note=f"{note} Average of {segments} segments of {piece} samples.",
    )


def allan_deviation(z: ArrayLike, params: FilterParams, sample_period: float | None = None) -> AllanDeviation:
    """Overlapping Allan deviation at log-spaced averaging lengths, beside that of the model.

    Averages that would hold a missing sample are left out. The model is AVAR(M) = r/M + q(2M² + 1)/(6M), white
    measurement noise and a random walk (Zhang 2008, Metrologia 45, 549); its minimum lies at M² = 3r/q + ½.

    Args:
        z: measurements of one channel, shape (n,); NaN is a missing sample.
        params: the present setting, scalars.
        sample_period: nominal sample period in s, > 0; None = τ in samples.

    Raises:
        BadSetting: z is not one channel, or params hold several.
    """
    samples = one_channel(z, params)[:LONGEST_ALLAN]
    period = 1.0 if sample_period is None else float(sample_period)
    there = np.isfinite(samples)
    level = float(samples[there].mean()) if there.any() else 0.0
    row = np.where(there, samples - level, 0.0)
    size, variance, degrees = allan_variances(row, there, log_sizes(len(row) // 4))
    q, r = float(params.q), float(params.r)
    deviation = np.sqrt(variance)
    spread = deviation / np.sqrt(2.0 * degrees)
    best = best_average(q, r)
    return AllanDeviation(
        size=size,
        tau=size * period,
        deviation=deviation,
        spread=spread,
        model=np.sqrt(allan_model(size, q, r)),
        best_size=best,
        in_seconds=sample_period is not None,
        message=_allan_words(size, deviation, spread, q, r, best, sample_period),
    )


def allan_model(size: ArrayLike, q: float, r: float) -> Array:
    """Allan variance of white noise r and a random walk of q a sample, at averages over `size` samples, unit².

    r/M + q(2M² + 1)/(6M): Zhang (2008), Metrologia 45, 549; the same as `av_wn` and `av_rw` of R's avar.
    """
    m = np.asarray(size, dtype=np.float64)
    return r / m + q * (2.0 * m * m + 1.0) / (6.0 * m)


def best_average(q: float, r: float) -> float:
    """Averaging length in samples where the model's Allan deviation is least, ≥ 1: √(3r/q + ½); inf for q = 0."""
    return math.inf if q == 0.0 else max(1.0, math.sqrt(3.0 * (r / q) + 0.5))


def first_minimum(deviation: Array, spread: Array) -> int:
    """Where the Allan deviation is least before it first rises by more than chance.

    Of a periodic signal averages over whole periods differ least of all, which is no reason to average so long.
    """
    best = 0
    for i in range(1, len(deviation)):
        if deviation[i] < deviation[best]:
            best = i
        elif deviation[i] - deviation[best] > 2.0 * math.hypot(spread[i], spread[best]):
            break
    return best


def log_sizes(longest: int) -> NDArray[np.int64]:
    """Whole averaging lengths from 1 to `longest`, three in each doubling."""
    if longest < 1:
        return np.empty(0, dtype=np.int64)
    steps = np.arange(int(SIZES_PER_OCTAVE * math.log2(longest)) + 1)
    return np.unique(np.rint(2.0 ** (steps / SIZES_PER_OCTAVE)).astype(np.int64))


def whole_stretch(z: Array) -> tuple[slice, str]:
    """The samples to take a density of, and a sentence on it."""
    seen = np.isfinite(z)
    finite = int(seen.sum())
    if finite == len(z):
        return slice(0, len(z)), "No sample is missing."
    if finite == 0:
        return slice(0, 0), ""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], seen.view(np.int8), [0]])))
    starts, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - starts))
    first, last = int(starts[longest]), int(ends[longest])
    if 2 * (last - first) >= finite:
        return slice(first, last), f"Samples {first} to {last - 1}, the longest stretch without a missing one."
    return (
        slice(int(starts[0]), int(ends[-1])),
        f"{len(z) - finite} missing samples lie on straight lines between their neighbours: part of what "
        "is slow is made up.",
    )


def _bridged(part: Array) -> Array:
    seen = np.flatnonzero(np.isfinite(part))
    return part if len(seen) == len(part) else np.interp(np.arange(len(part)), seen, part[seen])


def _welch(y: Array, piece: int, period: float) -> tuple[Array, Array]:
    """Frequencies above 0 and the one-sided density there."""
    from scipy.signal import welch

    frequency, density = welch(y - y.mean(), fs=1.0 / period, nperseg=piece)
    return frequency[1:], density[1:]


def _cutoff(params: FilterParams, period: float) -> float:
    hertz = steady_state(params, period).cutoff_hz
    return math.nan if hertz is None else float(hertz)


def _nothing(in_hertz: bool, note: str) -> Spectrum:
    none = np.empty(0)
    return Spectrum(none, none, none, none, none, math.nan, in_hertz, 0, 0, note)


def _allan_words(
    size: Array, deviation: Array, spread: Array, q: float, r: float, best: float, period: float | None
) -> str:
    """Where averaging stops helping: by the model, and in the recording."""

    def length(samples: float) -> str:
        there = f"{samples:.3g} sample{'' if samples == 1.0 else 's'}"
        return there if period is None else f"{duration(samples * period)} ({there})"

    if len(size) < 2:
        return "The recording is too short for an Allan deviation."
    if math.isinf(best):
        model = "With q = 0 the model never drifts, so averaging longer would always help."
    elif best <= 1.5:
        model = "By the model averaging does not help at all: the signal moves more between samples than its noise."
    else:
        least = math.sqrt(float(allan_model(best, q, r)))
        model = (
            f"By the model averaging longer than {length(best)} does not help: {least:.3g} is the least it reaches."
        )
    at = first_minimum(deviation, spread)
    if not deviation.any():
        seen = "This recording stands still: there is nothing that averaging could take off."
    elif at == len(size) - 1:
        seen = f"In this recording it still helps at {length(float(size[-1]))}, the longest that it can tell."
    elif at == 0 and float(deviation.min()) < float(deviation[0]):
        helps = length(float(size[int(np.argmax(deviation < deviation[0]))]))
        seen = f"In this recording averaging over less than {helps} does not help: the signal swings."
    elif at == 0:
        seen = "In this recording averaging never helps: its movement outweighs its noise from the first sample on."
    else:
        seen = f"In this recording it stops helping at {length(float(size[at]))}: {float(deviation[at]):.3g}."
    return f"{model} {seen}"
