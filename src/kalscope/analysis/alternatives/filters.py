"""The filters of the comparison, each over one channel with missing samples: those of a device, and a parabola."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np

from kalscope.common.array import Array
from kalscope.filtering.classic.running import RunningStage
from kalscope.filtering.classic.stages import Stage
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import settled_transfer

MAX_DIRECT = 501
"""Longest window of a parabola that is computed without Fourier transform."""


def classic(z: Array, stage: Stage) -> Array:
    """A classic filter as a device runs it, evenly sampled."""
    return RunningStage(stage).take(z, np.empty(0))


def settled(z: Array, params: FilterParams) -> Array:
    """The Kalman filter with the gains that it settles to, started at the first sample; scalars."""
    from scipy.signal import lfilter

    gain, product, both = settled_transfer(params)
    top, bottom = [gain, product - gain], [1.0, product - both - 1.0, both]
    return _skipping(z, lambda seen: cast("Array", lfilter(top, bottom, seen - seen[0])) + seen[0])


def savitzky_golay(z: Array, window: int) -> Array:
    """Centre of a parabola through `window` samples, odd; missing ones are interpolated linearly.

    NaN before the first sample. The ends come from the parabola through the outermost window.
    """
    from scipy.signal import savgol_filter

    bridged, first = _bridged(z)
    if 3 <= window <= MAX_DIRECT:
        if len(bridged) >= window:
            bridged = np.asarray(savgol_filter(bridged, window, 2))
    elif window > MAX_DIRECT and len(bridged) >= window:
        bridged = _long_parabola(bridged, window)
    return np.concatenate([np.full(first, np.nan), bridged])


def _long_parabola(z: Array, window: int) -> Array:
    """The same by Fourier transform, where scipy's filter would take seconds."""
    from scipy.signal import oaconvolve, savgol_coeffs

    half, level, out = window // 2, float(z.mean()), np.empty(len(z))
    out[half : len(z) - half] = oaconvolve(z - level, np.asarray(savgol_coeffs(window, 2)), "valid") + level
    place = np.linspace(-1.0, 1.0, window)
    out[:half] = np.polynomial.Polynomial.fit(place, z[:window], 2)(place[:half])
    out[len(z) - half :] = np.polynomial.Polynomial.fit(place, z[-window:], 2)(place[half + 1 :])
    return out


def delayed(curve: Array, samples: int) -> Array:
    """The curve `samples` later, as a device outputs it; NaN until then."""
    late = np.full(len(curve), np.nan)
    late[samples:] = curve[: len(curve) - samples]
    return late


def _skipping(z: Array, run: Callable[[Array], Array]) -> Array:
    """`run` on the finite samples; its last value in between, NaN before the first."""
    seen = np.isfinite(z)
    if not seen.any():
        return np.full(len(z), np.nan)
    if seen.all():
        return run(z)
    latest = np.cumsum(seen) - 1
    return np.where(latest >= 0, run(z[seen])[np.maximum(latest, 0)], np.nan)


def _bridged(z: Array) -> tuple[Array, int]:
    """The samples z from the first finite one on, gaps interpolated; and the number of samples before it."""
    seen = np.flatnonzero(np.isfinite(z))
    if len(seen) == 0:
        return np.empty(0), len(z)
    first = int(seen[0])
    return np.interp(np.arange(first, len(z)), seen, z[seen]), first
