"""Where the noise sits: by frequency (spectral densities, Welch 1967) and by averaging time (Allan deviation).

The Allan deviation is the overlapping one of IEEE Std 1139; Riley (2008), NIST SP 1065.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kalscope.common.numbers import Array
from kalscope.common.text import lag_in_full
from kalscope.filtering.filter import denoise
from kalscope.filtering.params import FilterParams, one_channel, scalar
from kalscope.filtering.steady import settled_transfer, steady_state

MIN_SAMPLES = 32
"""Samples in a row that a density needs."""

MAX_SEGMENT = 16_384
"""Samples of the longest Welch segment."""


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
    """The same of what the filter removes, raw − filtered."""
    response: Array
    """|H| of the settled filter there, 0 … 1; with momentum somewhat above 1 where it overshoots."""
    cutoff: float
    """−3 dB frequency of the settled filter, in the unit of `frequency`; NaN where there is none."""
    in_hertz: bool
    """Whether frequencies are in Hz."""
    samples: int
    """Samples used; 0 where there are too few for a density."""
    segments: int
    """Number of half-overlapping segments averaged: the relative error is about 1/√segments."""
    note: str
    """How it was computed, and how missing samples were treated."""


def magnitude_response(params: FilterParams, frequency: ArrayLike) -> Array:
    """|H| of the settled filter at frequencies in cycles a sample.

    The squares of numerator and denominator of H (see `settled_transfer`) are written in u = 4 sin² πf, which loses
    no digits at low frequencies.

    Args:
        params: the filter, scalars.
        frequency: cycles a sample, any shape.
    """
    gain, product, both = settled_transfer(params)
    u = 4.0 * np.sin(np.pi * np.asarray(frequency, dtype=np.float64)) ** 2
    if gain <= 0.0:
        return np.zeros_like(u)
    middle = (1.0 - both) ** 2 - product * (1.0 + both)
    through = product * product + gain * (gain - product) * u
    return np.sqrt(through / (product * product + middle * u + both * u * u))


def spectrum(
    z: ArrayLike, params: FilterParams, dt: ArrayLike | None = None, sample_period: float | None = None
) -> Spectrum:
    """Power densities of raw, filtered and residual, with the filter's response.

    Missing samples: the longest stretch without one is used if it holds half of the samples; otherwise each gap
    is interpolated linearly, which adds low frequencies that were not measured. The note says which.

    Args:
        z: measurements of one channel, shape (n,); NaN is a missing sample.
        params: the current filter, scalars.
        dt: nominal sample periods before each sample, shape (n,), for the filter only.
        sample_period: nominal sample period in s, > 0; None = per cycle/sample.

    Raises:
        BadSetting: z is not one channel, or z, dt, params or the period do not fit.

    Source: Welch (1967), IEEE Trans. AU-15, 70; Hann windows, half overlap, the mean of each segment removed.
    """
    from scipy.signal import welch

    samples = one_channel(z, params)
    period = 1.0 if sample_period is None else float(sample_period)
    curve = denoise(samples, params, dt)
    part, note = whole_stretch(samples)
    length = part.stop - part.start
    if length < MIN_SAMPLES:
        none, needed = np.empty(0), f"A spectrum needs {MIN_SAMPLES} samples (got {length})."
        return Spectrum(none, none, none, none, none, math.nan, sample_period is not None, 0, 0, needed)
    piece = min(max(2 ** int(math.log2(length / 4)), MIN_SAMPLES), MAX_SEGMENT, length)
    raw, filtered = _bridged(samples[part]), _bridged(curve[part])
    spectra = [
        cast("tuple[Array, Array]", welch(y - y.mean(), fs=1.0 / period, nperseg=piece))
        for y in (raw, filtered, raw - filtered)
    ]
    frequency = spectra[0][0][1:]
    segments = (length - piece) // (piece // 2) + 1
    return Spectrum(
        frequency,
        *(density[1:] for _, density in spectra),
        response=magnitude_response(params, frequency * period),
        cutoff=scalar(steady_state(params, period).cutoff_hz),
        in_hertz=sample_period is not None,
        samples=length,
        segments=segments,
        note=f"{note} Average of {segments} segments of {piece} samples.",
    )


def whole_stretch(z: Array) -> tuple[slice, str]:
    """The samples to take a density of, and a sentence on it."""
    seen = np.flatnonzero(np.isfinite(z))
    if len(seen) == len(z):
        return slice(0, len(z)), "No sample is missing."
    if not len(seen):
        return slice(0, 0), ""
    longest = max(np.split(seen, np.flatnonzero(np.diff(seen) > 1) + 1), key=len)
    first, last = int(longest[0]), int(longest[-1])
    if 2 * len(longest) >= len(seen):
        return slice(first, last + 1), f"Samples {first} to {last}, the longest stretch without a missing one."
    return (
        slice(int(seen[0]), int(seen[-1]) + 1),
        f"{len(z) - len(seen)} missing samples are interpolated linearly, which adds power at low frequencies.",
    )


def _bridged(part: Array) -> Array:
    seen = np.flatnonzero(np.isfinite(part))
    return part if len(seen) == len(part) else np.interp(np.arange(len(part)), seen, part[seen])


SIZES_PER_OCTAVE = 3
"""Averaging lengths in each doubling."""


MAX_AVERAGED = 2_000_000
"""Samples used, the first ones of the record."""


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
    """Of white noise r and a random walk q with the filter's momentum, unit."""
    best_size: float
    """Averaging length of the model's minimum, samples; inf for q = 0, 1 where averaging never helps."""
    in_seconds: bool
    """Whether `tau` is in s."""
    message: str
    """What the minimum means, in plain sentences."""


def allan_deviation(z: ArrayLike, params: FilterParams, sample_period: float | None = None) -> AllanDeviation:
    """Overlapping Allan deviation at log-spaced averaging lengths, beside that of the model.

    Averages that would hold a missing sample are left out. The model is AVAR(M) = r/M + q(2M² + 1)/(6M), white
    measurement noise and a random walk (Zhang 2008, Metrologia 45, 549); its minimum lies at M² = 3r/q + ½. With
    momentum see `allan_model`.

    Args:
        z: measurements of one channel, shape (n,); NaN is a missing sample.
        params: the current filter, scalars.
        sample_period: nominal sample period in s, > 0; None = τ in samples.

    Raises:
        BadSetting: z is not one channel, or params hold several.
    """
    samples = one_channel(z, params)[:MAX_AVERAGED]
    period = 1.0 if sample_period is None else float(sample_period)
    there = np.isfinite(samples)
    level = float(samples[there].mean()) if there.any() else 0.0
    row = np.where(there, samples - level, 0.0)
    size, variance, degrees = _allan_variances(row, there, log_sizes(len(row) // 4))
    q, r, momentum = params.q, float(params.r), params.momentum
    deviation = np.sqrt(variance)
    spread = deviation / np.sqrt(2.0 * degrees)
    model = np.sqrt(allan_model(size, q, r, momentum))
    best = best_average(q, r)
    if momentum and q and len(size):  # later than that of the walk alone: the nearest of these lengths
        best = float(size[int(model.argmin())])
    return AllanDeviation(
        size=size,
        tau=size * period,
        deviation=deviation,
        spread=spread,
        model=model,
        best_size=best,
        in_seconds=sample_period is not None,
        message=_message(size, deviation, spread, best, sample_period),
    )


def _allan_variances(row: Array, there: NDArray[np.bool_], sizes: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """M, overlapping Allan variances, and their degrees of freedom; shape (k,) each.

    `row` has one value per sample period, `there` says which exist; windows with a missing sample do not count.
    `sizes` are the M, ascending; those with too few windows are left out.
    """
    sums = np.concatenate([[0.0], np.cumsum(np.where(there, row, 0.0))])
    counts = np.concatenate([[0], np.cumsum(there)])
    points: list[tuple[float, float, float]] = []
    for size in map(int, sizes):
        end = len(sums) - 2 * size
        full = counts[2 * size :] - counts[:end] == 2 * size
        jumps = (sums[2 * size :] - 2.0 * sums[size : size + end] + sums[:end])[full] / size
        if len(jumps) < 2 * size:
            break
        points.append((float(size), 0.5 * float(np.mean(jumps**2)), max(len(jumps) / size, 1.0)))
    columns = np.array(points).reshape(-1, 3).T
    return columns[0], columns[1], columns[2]


def allan_model(size: ArrayLike, q: float, r: float, momentum: float = 0.0) -> Array:
    """Allan variance of white noise r and a random walk of q a sample, at averages over `size` samples, unit².

    r/M + q(2M² + 1)/(6M): Zhang (2008), Metrologia 45, 549; the same as `av_wn` and `av_rw` of R's avar. With
    momentum τ the walk is off by q(k − τ(1 − exp(−k/τ))) after k samples, in the mean square.
    """
    m = np.asarray(size, dtype=np.float64)
    if momentum:
        return r / m + 0.5 * q * np.vectorize(_apart, [np.float64])(m, momentum)
    return r / m + q * (2.0 * m * m + 1.0) / (6.0 * m)


def _apart(m: float, tau: float) -> float:
    """Mean squared difference of two averages over m samples with the momentum τ, for q = 1."""
    k = np.arange(1.0, 2.0 * round(m))
    weight = np.where(k <= m, 3.0 * k - 2.0 * m, 2.0 * m - k) / (m * m)
    return float(weight @ (k + tau * np.expm1(-k / tau)))


def best_average(q: float, r: float) -> float:
    """Averaging length in samples where the model's Allan deviation is least, ≥ 1: √(3r/q + ½); inf for q = 0."""
    return math.inf if q == 0.0 else max(1.0, math.sqrt(3.0 * (r / q) + 0.5))


def first_minimum(deviation: Array, spread: Array) -> int:
    """Where the Allan deviation is lowest before it first rises by more than chance.

    Averages over whole periods of a periodic signal differ least of all, but that is no reason to average so long.
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


def _message(size: Array, deviation: Array, spread: Array, best: float, period: float | None) -> str:
    """Where averaging stops helping: by the model, at `best` samples, and in the recording."""
    if len(size) < 2:
        return "The recording is too short for an Allan deviation."
    if math.isinf(best):
        model = "With q = 0 the model never drifts, so longer averaging always helps."
    elif best <= 1.5:
        model = (
            "By the model, averaging does not help at all: the signal changes more between samples than its noise."
        )
    else:
        model = f"By the model, averaging longer than {lag_in_full(best, period)} does not help."
    at = first_minimum(deviation, spread)
    stop = lag_in_full(float(size[at]), period)
    if not deviation.any():
        seen = "This recording is constant: averaging has nothing to remove."
    elif at == len(size) - 1:
        seen = f"In this recording it still helps at {stop}, the longest averaging time it allows."
    elif at:
        seen = f"In this recording it stops helping at {stop}."
    elif float(deviation.min()) < float(deviation[0]):
        helps = lag_in_full(float(size[int(np.argmax(deviation < deviation[0]))]), period)
        seen = f"In this recording averaging over less than {helps} does not help: signal or noise is correlated."
    else:
        seen = (
            "In this recording averaging never helps: the signal changes more than its noise from sample to sample."
        )
    return f"{model} {seen}"
