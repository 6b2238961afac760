"""What the Kalman filter of this model adds to fixed gains, such as exponential smoothing, with numbers."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kalscope.common.array import Array
from kalscope.common.text import number, plural
from kalscope.filtering.filter import FilterResult
from kalscope.filtering.params import FilterParams
from kalscope.filtering.steady_state import SteadyState, steady_state


def identity_words(z: Array, result: FilterResult, params: FilterParams, smoothed: Array) -> str:
    """Sentences on the current filter and the same with the gains it settles to.

    Args:
        z: measurements, shape (n,), NaN where missing.
        result: the output of the current filter.
        params: its parameters.
        smoothed: fixed gains started at the first sample, shape (n,); without momentum exponential smoothing.
    """
    steady, noise = steady_state(params), math.sqrt(float(params.r))
    gain = steady.gain
    parts = [f"{_settled(steady, params.momentum)} The Kalman filter differs at the start and at gaps."]
    apart = np.abs(result.x - smoothed)
    seen = np.flatnonzero(np.isfinite(z))
    gaps = np.flatnonzero(np.diff(seen) > 1) if len(seen) else seen
    until = int(seen[gaps[0]]) + 1 if len(gaps) else len(z)
    parts.append(_start(apart[:until], result.k[:until], gain, noise))
    parts.append(_gaps(apart, result.k, seen, gaps, gain, noise))
    if params.gate is not None and int(result.rejected):
        parts.append(
            f"Your outlier gate rejected {plural(int(result.rejected), 'sample')}, which no other filter here does."
        )
    return " ".join(part for part in parts if part)


def _settled(steady: SteadyState, tau: float) -> str:
    """The settled filter as a formula."""
    gain = number(steady.gain, 4)
    if not tau:
        return f"Once settled your filter is exponential smoothing with α = K = {gain}: x += {gain}·(z − x)."
    kept, ahead = math.exp(-1.0 / tau), -tau * math.expm1(-1.0 / tau)
    return (
        f"Once settled your filter has fixed gains: x += {number(ahead, 4)}·v and v *= {number(kept, 4)} predict,"
        f" then e = z − x corrects, x += {gain}·e and v += {number(steady.velocity_gain, 4)}·e."
    )


def _start(apart: Array, k: Array, gain: float, noise: float) -> str:
    """How far the two differ at the start, and for how long."""
    good = np.isfinite(apart)
    largest = float(apart[good].max(initial=0.0))
    if largest <= 1e-9 * noise or noise == 0.0:
        return "At the start of this recording the two do not differ."
    far = np.flatnonzero(good & (apart > 0.1 * noise))
    begin = int(np.argmax(good))
    lasting = (
        f" and by more than a tenth of that for the first {int(far[-1]) - begin + 1} samples" if len(far) else ""
    )
    quick = k[np.isfinite(k)]
    second = float(quick[begin + 1]) if len(quick) > begin + 1 else gain
    return (
        f"At the start they differ by up to {number(largest / noise, 2)} standard deviations of the noise"
        f"{lasting}: the Kalman filter averages what it has (second gain {number(second, 2)}), fixed "
        "gains stay biased towards the first sample."
    )


def _gaps(apart: Array, k: Array, seen: NDArray[np.intp], gaps: NDArray[np.intp], gain: float, noise: float) -> str:
    """How many gaps there are, and how the first sample after the longest one is weighted."""
    if len(gaps) == 0:
        return "No samples are missing here, so gaps do not matter."
    after = seen[gaps + 1]
    longest = int(np.argmax(np.diff(seen)[gaps]))
    missing = int(np.diff(seen)[gaps][longest]) - 1
    largest = float(np.nanmax(apart[after])) if np.isfinite(apart[after]).any() else 0.0
    far = (
        f", and the two then differ by up to {number(largest / noise, 2)} standard deviations of the noise"
        if noise
        else ""
    )
    places = "1 gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
    return (
        f"There {'is' if len(gaps) == 1 else 'are'} {places}; after the longest ({missing} samples) the gain is "
        f"{number(float(k[after[longest]]))} instead of {number(gain)}{far}."
    )
