"""The filter on screen beside others: simpler ones, pins, other estimates, other channels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalscope.analysis.alternatives import Alternative, Comparison, compare_alternatives, stretch_of
from kalscope.analysis.diagnostics import Diagnostics, diagnose_run, without_residuals
from kalscope.analysis.residuals import Run
from kalscope.common.numbers import Array
from kalscope.export.settings import settings_of
from kalscope.filtering.classic import Chain
from kalscope.filtering.filter import filter_at
from kalscope.filtering.steady import SteadyState
from kalscope.tuning.tuning import ChannelTuning
from kalscope_app.engine.filter_runs import Cache, DrawnSamples, choose_samples
from kalscope_app.session.state import State, Variant

# The filter on screen beside simpler ones: an idle-time computation.


@dataclass(frozen=True)
class Compared:
    """The present filter beside simpler ones, and which samples of them are drawn."""

    state: State
    """The choices that were compared."""
    found: Comparison
    """All of them, over their stretch."""
    drawn: DrawnSamples
    """The samples that the signal chart draws; those outside the stretch are left out."""

    @property
    def inside(self) -> np.ndarray:
        """Which of the drawn samples lie in the stretch, bool, shape (m,)."""
        at = self.drawn.indices
        return (at >= self.found.first) & (at < self.found.last)

    def curve(self, one: Alternative) -> Array:
        """A curve at the drawn samples inside the stretch."""
        return one.curve[self.drawn.indices[self.inside] - self.found.first]

    @property
    def to_export(self) -> Chain | None:
        """The one chosen filter that a device can run, if one is chosen."""
        return self.alternatives[0].chain if len(self.alternatives) == 1 else None

    @property
    def settings(self) -> dict[str, str]:
        """The texts that set the chosen filter in other programs, by their names."""
        chain = self.to_export
        return {} if chain is None else settings_of(self.state.as_tuning().only(self.state.channel), chain)

    @property
    def alternatives(self) -> tuple[Alternative, ...]:
        """What is drawn beside the present filter: the chosen one, or all."""
        chosen = tuple(one for one in self.found.others if one.name == self.state.view.drawn_alternative)
        return chosen or self.found.others


def compute_alternatives(state: State, kept: Cache[Comparison]) -> Compared | None:
    """Compare the Kalman filter of the q and r on screen; None where there is none of one channel.

    `kept` has the last comparison while only the view changes.
    """
    if state.fusion is not None or state.tuning.paper is not None:
        return None
    drawn = choose_samples(state.recording, state.channel, state.view.window)
    window = (drawn.first, drawn.last)
    kept.begin(state.recording, state.channel, state.view.match_by, stretch_of(len(state.recording), window))
    return Compared(state, kept.get(state.params, lambda: _compare(state, window)), drawn)


def _compare(state: State, window: tuple[int, int]) -> Comparison:
    truth = state.recording.truth
    return compare_alternatives(
        state.recording.values[:, state.index],
        state.params,
        match=state.view.match_by,
        dt=state.dt,
        truth=None if truth is None else truth[:, state.index],
        window=window,
        model=state.first.estimate and state.first.estimate.params,
    )


# State -> Overview: every channel raw and filtered, each on its own lane; an idle-time computation.


MAX_LANES = 16
"""Channels that are drawn, at most: with more, the lanes are too low to read."""


MAX_LANE_POINTS = 3000
"""Points of all lanes together, at most, before what they share is drawn once."""

HALF_LANE = 0.46
"""Half the height of a lane, which is 1: a small gap stays between two."""


@dataclass(frozen=True)
class Lane:
    """One channel."""

    name: str
    """Name of the channel."""
    low: float
    """Its smallest value on screen, unit; NaN where it has none."""
    high: float
    """Its largest, unit."""
    missing: int
    """Missing samples of the whole recording."""
    raw: Array
    """Measurements, −1 … 1 between low and high, shape (m,); NaN where missing."""
    filtered: Array
    """Filtered, on the same scale."""


@dataclass(frozen=True)
class Overview:
    """The channels of a recording side by side."""

    state: State
    """The choices that it belongs to."""
    time: Array
    """Times drawn, s, ascending, shape (m,)."""
    lanes: tuple[Lane, ...]
    """At most 16 of the channels; none where the recording has only one."""


def compute_overview(state: State, kept: Cache[Any]) -> Overview:
    """The overview of a state; `kept` has what the last change did not touch."""
    recording, window = state.recording, state.view.window
    if len(recording.names) < 2:
        return Overview(state, np.empty(0), ())
    names = recording.names[:MAX_LANES]
    kept.begin(recording, window)
    choose = partial(choose_samples, recording, names[0], window, MAX_LANE_POINTS, others=names[1:])
    drawn: DrawnSamples = kept.get(None, choose)
    lanes: list[Lane] = []
    for i, name in enumerate(names):
        z, used = recording.values[:, i], state.tunings[i].filter
        filtered = kept.get((i, used), lambda z=z, used=used: used.denoise(z, state.dt)[drawn.indices])
        lanes.append(_lane(name, z, drawn.indices, filtered))
    return Overview(state, drawn.time, tuple(lanes))


def _lane(name: str, z: Array, at: NDArray[np.intp], filtered: Array) -> Lane:
    raw = z[at]
    seen = raw[np.isfinite(raw)]
    low, high = (float(seen.min()), float(seen.max())) if len(seen) else (float("nan"), float("nan"))
    middle, half = (0.5 * low + 0.5 * high, (0.5 * high - 0.5 * low) or 1.0) if len(seen) else (0.0, 1.0)
    missing = int(np.isnan(z).sum())
    return Lane(name, low, high, missing, (raw - middle) / half, np.clip((filtered - middle) / half, -1.0, 1.0))


# The table of pinned settings: what each of them does to the channel on screen. An idle-time computation.


@dataclass(frozen=True)
class Measures:
    """What one setting does to one channel."""

    steady: SteadyState
    """Lag, noise reduction, gain of the settled filter."""
    rmse: float | None
    """Root mean square of filtered − truth, unit; None where the truth is not known."""
    fit: Diagnostics | None
    """Size and autocorrelation of its innovations; None for a chain of filters, which is no model."""
    loglik: float = np.nan
    """Its log-likelihood."""
    scored: int = 0
    """Samples that this sums over."""


@dataclass(frozen=True)
class VariantRow:
    """One line of the table."""

    variant: Variant | None
    """Which; None = the present setting."""
    tuning: ChannelTuning
    """Its parameters."""
    measures: Measures
    """What they do."""


@dataclass(frozen=True)
class VariantComparison:
    """All settings of the channel on screen, the present one first."""

    state: State
    """The choices that it belongs to."""
    rows: tuple[VariantRow, ...]
    """One per setting; empty where the Khan et al. filter runs and nothing is pinned."""

    @property
    def with_chain(self) -> bool:
        """Whether a setting is a chain of filters."""
        return any(row.tuning.chain for row in self.rows)


def compute_variants(state: State, kept: Cache[Measures]) -> VariantComparison:
    """The table of a state; `kept` has what was measured, so that a gesture measures the present setting alone."""
    kept.begin(state.recording, state.channel)
    other = state.fusion is not None or state.tuning.paper is not None
    present = [] if other else [(None, state.tuning)]
    settings = [*present, *((variant, variant.tuning) for variant in state.variants)]
    rows = [
        VariantRow(variant, one, kept.get(one.filter, lambda one=one: measure(state, one)))
        for variant, one in settings
    ]
    return VariantComparison(state, tuple(rows))


def measure(state: State, tuning: ChannelTuning) -> Measures:
    """What a setting does to the channel on screen, over the whole recording."""
    recording, z, used = state.recording, state.z, tuning.filter
    rmse = None
    if recording.truth is not None:
        error = used.denoise(z, state.dt)
        error -= recording.truth[:, state.index]
        rmse = float(np.sqrt(np.nanmean(np.square(error, out=error)))) if np.isfinite(error).any() else None
    if tuning.chain is not None:
        return Measures(used.settled(used.run(z, state.dt), recording.sample_period), rmse, None)
    run = filter_at(z, tuning.params, np.empty(0, dtype=np.intp), state.dt)
    fit = without_residuals(diagnose_run(Run.of_samples(z, tuning.params, state.dt)))
    return Measures(used.settled(run, recording.sample_period), rmse, fit, float(run.loglik), int(run.m))
