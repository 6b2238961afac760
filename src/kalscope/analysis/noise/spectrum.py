"""Spectral densities of the signal, of the filter's output and of what it removes.

The density is Welch's (1967).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array
from kalscope.filtering.arrays import one_channel, scalar
from kalscope.filtering.filter import denoise
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import settled_transfer, steady_state

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
    samples = one_channel(z, params)
    period = 1.0 if sample_period is None else float(sample_period)
    curve = denoise(samples, params, dt)
    part, note = whole_stretch(samples)
    length = part.stop - part.start
    if length < MIN_SAMPLES:
        none, needed = np.empty(0), f"A spectrum needs {MIN_SAMPLES} samples (got {length})."
        return Spectrum(none, none, none, none, none, math.nan, sample_period is not None, 0, 0, needed)
    raw, filtered = _bridged(samples[part]), _bridged(curve[part])
    piece = min(max(2 ** int(math.log2(length / 4)), MIN_SAMPLES), MAX_SEGMENT, length)
    frequency, raw_density = _welch(raw, piece, period)
    segments = (length - piece) // (piece // 2) + 1
    return Spectrum(
        frequency=frequency,
        raw=raw_density,
        filtered=_welch(filtered, piece, period)[1],
        residual=_welch(raw - filtered, piece, period)[1],
        response=magnitude_response(params, frequency * period),
        cutoff=scalar(steady_state(params, period).cutoff_hz),
        in_hertz=sample_period is not None,
        samples=length,
        segments=segments,
        note=f"{note} Average of {segments} segments of {piece} samples.",
    )


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
        f"{len(z) - finite} missing samples are interpolated linearly, which adds power at low frequencies.",
    )


def _bridged(part: Array) -> Array:
    seen = np.flatnonzero(np.isfinite(part))
    return part if len(seen) == len(part) else np.interp(np.arange(len(part)), seen, part[seen])


def _welch(y: Array, piece: int, period: float) -> tuple[Array, Array]:
    """Frequencies above 0 and the one-sided density there."""
    from scipy.signal import welch

    frequency, density = cast("tuple[Array, Array]", welch(y - y.mean(), fs=1.0 / period, nperseg=piece))
    return frequency[1:], density[1:]
