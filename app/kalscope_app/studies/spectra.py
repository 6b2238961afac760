"""Spectra and Allan deviations of raw and filtered signal, for their charts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalscope.analysis.spectrum import AllanDeviation, Spectrum, allan_deviation, magnitude_response, spectrum
from kalscope.common.array import Array
from kalscope_app.session.state import State

BINS = 240
"""Points that a density or a response is drawn with, at most about."""


MAX_BELOW = 30.0
"""How far below the lowest frequency of the record a cut-off may lie to be drawn, as a ratio."""


@dataclass(frozen=True)
class Spectra:
    """What the spectrum tab draws."""

    state: State
    """The choices it belongs to."""
    found: Spectrum
    """All of it."""
    frequency: Array
    """Frequencies of the density chart, log-spaced, shape (b,)."""
    densities: tuple[Array, Array, Array]
    """Raw, filtered, residual there, averaged over each bin."""
    fine: Array
    """Frequencies of the response chart, with the cut-off among them, shape (f,)."""
    response_db: Array
    """20·log10|H| there, dB."""


def compute_spectra(state: State) -> Spectra | None:
    """Densities and response of the channel on screen; None where its filter has no q and r."""
    if not state.is_standard:
        return None
    period = state.recording.sample_period
    found = spectrum(state.z, state.params, state.dt, period)
    frequency, *densities = log_binned(found.frequency, [found.raw, found.filtered, found.residual], BINS)
    fine = _response_frequencies(found) if found.samples else np.empty(0)
    response = magnitude_response(state.params, fine * (period or 1.0))
    decibel = 20.0 * np.log10(np.maximum(response, 1e-20))
    raw, filtered, residual = densities
    return Spectra(state, found, frequency, (raw, filtered, residual), fine, decibel)


def _response_frequencies(found: Spectrum) -> Array:
    """Those of the record, and from half the cut-off on where that lies a little below them."""
    low, high = float(found.frequency[0]), float(found.frequency[-1])
    if low / MAX_BELOW < found.cutoff < 2.0 * low:
        low = 0.5 * found.cutoff
    fine = np.geomspace(low, high, BINS)
    return np.sort(np.append(fine, found.cutoff)) if low < found.cutoff < high else fine


def log_binned(x: Array, ys: list[Array], bins: int) -> tuple[Array, ...]:
    """Means of x > 0, ascending, and of each y over bins of equal ratio; bins without a point are left out."""
    if len(x) <= bins:
        return (x, *ys)
    edges: Array = np.geomspace(float(x[0]), float(x[-1]) * (1 + 1e-12), bins + 1)
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, bins - 1)
    counts = np.bincount(place, minlength=bins)
    full = counts > 0
    return tuple(np.bincount(place, weights=y, minlength=bins)[full] / counts[full] for y in (x, *ys))


@dataclass(frozen=True)
class Allan:
    """What the Allan chart draws."""

    state: State
    """The choices it belongs to."""
    found: AllanDeviation
    """All of it."""


def compute_allan(state: State) -> Allan | None:
    """Allan deviation of the channel on screen; None where its filter has no q and r."""
    if not state.is_standard:
        return None
    return Allan(state, allan_deviation(state.z, state.params, state.recording.sample_period))
