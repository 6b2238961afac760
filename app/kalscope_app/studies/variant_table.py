"""The table of pinned settings: what each of them does to the channel on screen. An idle-time computation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalscope.analysis.diagnostics import Diagnostics, diagnose_run, without_residuals
from kalscope.analysis.fit.run import Run
from kalscope.filtering.batch import denoise
from kalscope.filtering.params import FilterParams
from kalscope.filtering.pieces.chosen import filter_at
from kalscope.filtering.steady_state import SteadyState, steady_state
from kalscope_app.engine.cache import Cache
from kalscope_app.session.state import State
from kalscope_app.session.variants import Variant


@dataclass(frozen=True)
class Measures:
    """What one setting does to one channel."""

    steady: SteadyState
    """Lag, noise reduction, gain of the settled filter."""
    rmse: float | None
    """Root mean square of filtered − truth, unit; None where the truth is not known."""
    diagnostics: Diagnostics
    """Size and memory of its innovations."""
    loglik: float
    """Log-likelihood."""
    scored: int
    """Samples that it sums over."""


@dataclass(frozen=True)
class VariantRow:
    """One line of the table."""

    variant: Variant | None
    """Which; None = the present setting."""
    params: FilterParams
    """Its parameters."""
    measures: Measures
    """What they do."""


@dataclass(frozen=True)
class VariantComparison:
    """All settings of the channel on screen, the present one first."""

    state: State
    """The choices that it belongs to."""
    rows: tuple[VariantRow, ...]
    """One a setting; empty where the filter has no q and r and nothing is pinned."""

    @property
    def with_momentum(self) -> bool:
        """Whether a setting has momentum."""
        return any(row.params.momentum for row in self.rows)


class VariantTable:
    """Computes tables and keeps what was measured, so that a gesture measures the present setting alone."""

    def __init__(self) -> None:
        self._measures = Cache[Measures]()

    def compute(self, state: State) -> VariantComparison:
        """The table of a state."""
        self._measures.begin(state.recording, state.channel)
        present = [(None, state.params)] if state.is_standard else []
        settings = [*present, *((variant, variant.tuning.params) for variant in state.variants)]
        rows = [
            VariantRow(variant, params, self._measures.get(params, lambda params=params: measure(state, params)))
            for variant, params in settings
        ]
        return VariantComparison(state, tuple(rows))


def measure(state: State, params: FilterParams) -> Measures:
    """What a setting does to the channel on screen, over the whole recording."""
    recording, z = state.recording, state.z
    run = filter_at(z, params, np.empty(0, dtype=np.intp), state.dt)
    rmse = None
    if recording.truth is not None:
        error = denoise(z, params, state.dt)
        error -= recording.truth[:, state.index]
        rmse = float(np.sqrt(np.nanmean(np.square(error, out=error)))) if np.isfinite(error).any() else None
    return Measures(
        steady=steady_state(params, recording.sample_period),
        rmse=rmse,
        diagnostics=without_residuals(diagnose_run(Run.of_samples(z, params, state.dt))),
        loglik=float(run.loglik),
        scored=int(run.m),
    )
