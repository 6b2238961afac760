"""The table of pinned settings: what each of them does to the channel on screen. An idle-time computation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalscope.analysis.diagnostics import Diagnostics, diagnose_run, without_residuals
from kalscope.analysis.residuals import Run
from kalscope.filtering.chosen import filter_at
from kalscope.filtering.steady_state import SteadyState
from kalscope.tuning.paper_tuning import PaperTuning
from kalscope.tuning.tuning import ChannelTuning
from kalscope_app.engine.cache import Cache
from kalscope_app.session.state import State
from kalscope_app.session.variants import Variant


@dataclass(frozen=True)
class Fit:
    """How well the Kalman filter of one setting explains one channel."""

    diagnostics: Diagnostics
    """Size and autocorrelation of its innovations."""
    loglik: float
    """Log-likelihood."""
    scored: int
    """Samples that it sums over."""


@dataclass(frozen=True)
class Measures:
    """What one setting does to one channel."""

    steady: SteadyState
    """Lag, noise reduction, gain of the settled filter."""
    rmse: float | None
    """Root mean square of filtered − truth, unit; None where the truth is not known."""
    fit: Fit | None
    """How well it explains the recording; None for a chain of filters, which is not a model of it."""


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
    def with_momentum(self) -> bool:
        """Whether a setting has momentum."""
        return any(row.tuning.momentum for row in self.rows)

    @property
    def with_chain(self) -> bool:
        """Whether a setting is a chain of filters."""
        return any(row.tuning.chain for row in self.rows)


class VariantTable:
    """Computes tables and keeps what was measured, so that a gesture measures the present setting alone."""

    def __init__(self) -> None:
        self._measures = Cache[Measures]()

    def compute(self, state: State) -> VariantComparison:
        """The table of a state."""
        self._measures.begin(state.recording, state.channel)
        other = state.fusion is not None or isinstance(state.tuning, PaperTuning)
        present = [] if other else [(None, state.tuning)]
        settings = [*present, *((variant, variant.tuning) for variant in state.variants)]
        rows = [
            VariantRow(variant, one, self._measures.get(one.filter, lambda one=one: measure(state, one)))
            for variant, one in settings
        ]
        return VariantComparison(state, tuple(rows))


def measure(state: State, tuning: ChannelTuning) -> Measures:
    """What a setting does to the channel on screen, over the whole recording."""
    recording, z, used = state.recording, state.z, tuning.filter
    run, fit = None, None
    if tuning.chain is None:
        run = filter_at(z, tuning.params, np.empty(0, dtype=np.intp), state.dt)
        diagnostics = without_residuals(diagnose_run(Run.of_samples(z, tuning.params, state.dt)))
        fit = Fit(diagnostics, float(run.loglik), int(run.m))
    rmse = None
    if recording.truth is not None:
        error = used.denoise(z, state.dt)
        error -= recording.truth[:, state.index]
        rmse = float(np.sqrt(np.nanmean(np.square(error, out=error)))) if np.isfinite(error).any() else None
    steady = used.settled(run or used.run(z, state.dt), recording.sample_period)
    return Measures(steady, rmse, fit)
