"""State -> simpler filters, spectrum and Allan deviation of the channel on screen: studies. Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalscope.alternatives import Alternative, Comparison, compare_alternatives
from kalscope.alternatives.comparison import stretch_of
from kalscope.recording import Recording
from kalscope.spectrum import AllanDeviation, Spectrum, allan_deviation, magnitude_response, spectrum
from kalscope.steady_state import steady_state
from kalscope_app.charts import Array
from kalscope_app.frame import Shown, choose_shown
from kalscope_app.state import State

BINS = 240
"""Points that a density or a response is drawn with, at most about."""


@dataclass(frozen=True)
class Compared:
    """The present filter beside simpler ones, and which samples of them are drawn."""

    state: State
    """The choices that were compared."""
    found: Comparison
    """All of them, over their stretch."""
    shown: Shown
    """The samples that the signal chart draws; those outside the stretch are left out."""

    @property
    def inside(self) -> np.ndarray:
        """Which of the drawn samples lie in the stretch, bool, shape (m,)."""
        at = self.shown.indices
        return (at >= self.found.first) & (at < self.found.last)

    def curve(self, one: Alternative) -> Array:
        """A curve at the drawn samples inside the stretch."""
        return one.curve[self.shown.indices[self.inside] - self.found.first]

    @property
    def rivals(self) -> tuple[Alternative, ...]:
        """What is drawn beside the present filter: the chosen one, or all."""
        chosen = tuple(one for one in self.found.others if one.name == self.state.rival)
        return chosen or self.found.others


class AlternativesStudy:
    """Compares at rest, and keeps the last comparison while only the view changes."""

    def __init__(self) -> None:
        self._recording: Recording | None = None
        self._key: tuple[object, ...] = ()
        self._found: Comparison | None = None

    def compute(self, state: State) -> Compared | None:
        """Compare; None where the filter on screen has no q and r."""
        if state.rule is not None:
            return None
        recording = state.recording
        shown = choose_shown(recording, state.channel, state.window)
        window = (shown.first, shown.last)
        key = (state.channel, state.params, state.match, *stretch_of(len(recording), window))
        if self._found is None or self._recording is not recording or self._key != key:
            column = recording.index(state.channel)
            self._found = compare_alternatives(
                recording.values[:, column],
                state.params,
                match=state.match,
                dt=state.dt,
                sample_period=recording.sample_period,
                truth=None if recording.truth is None else recording.truth[:, column],
                window=window,
            )
            self._recording, self._key = recording, key
        return Compared(state, self._found, shown)


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
    if state.rule is not None:
        return None
    period = state.recording.sample_period
    found = spectrum(state.recording.channel(state.channel), state.params, state.dt, period)
    frequency, *densities = log_binned(found.frequency, [found.raw, found.filtered, found.residual], BINS)
    fine = (
        np.geomspace(float(found.frequency[0]), float(found.frequency[-1]), BINS) if found.samples else np.empty(0)
    )
    if found.samples and fine[0] < found.cutoff < fine[-1]:
        fine = np.sort(np.append(fine, found.cutoff))
    response = magnitude_response(float(steady_state(state.params).gain), fine * (period or 1.0))
    decibel = 20.0 * np.log10(np.maximum(response, 1e-20))
    raw, filtered, residual = densities
    return Spectra(state, found, frequency, (raw, filtered, residual), fine, decibel)


def log_binned(x: Array, ys: list[Array], bins: int) -> tuple[Array, ...]:
    """Means of x > 0, ascending, and of each y over bins of equal ratio; bins without a point are left out."""
    if len(x) <= bins:
        return (x, *ys)
    edges = np.geomspace(x[0], x[-1] * (1 + 1e-12), bins + 1)
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, bins - 1)
    counts = np.bincount(place, minlength=bins)
    full = counts > 0
    return tuple(np.bincount(place, weights=y, minlength=bins)[full] / counts[full] for y in (x, *ys))


@dataclass(frozen=True)
class Allan:
    """What the Allan tab draws."""

    state: State
    """The choices it belongs to."""
    found: AllanDeviation
    """All of it."""


def compute_allan(state: State) -> Allan | None:
    """Allan deviation of the channel on screen; None where its filter has no q and r."""
    if state.rule is not None:
        return None
    z = state.recording.channel(state.channel)
    return Allan(state, allan_deviation(z, state.params, state.recording.sample_period))
