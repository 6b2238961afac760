"""State -> Checks: an idle-time computation, because it takes longer than a frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from kalscope.analysis.diagnostics import Diagnostics, diagnose_held_out, diagnose_run, without_residuals
from kalscope.analysis.findings import request_in, still_met
from kalscope.analysis.judge import Judgement, judge, needs_noise
from kalscope.analysis.residuals import Run
from kalscope.common.array import Array
from kalscope.estimation.estimate import estimate
from kalscope.estimation.finding import METHOD_NAMES
from kalscope.filtering.params import FilterParams
from kalscope_app.session.state import State
from kalscope_app.studies.still_stretch import Stretch


@dataclass(frozen=True)
class Checks:
    """How well the filter on screen describes the channel on screen."""

    state: State
    """The choices that were checked."""
    all_samples: Diagnostics
    """Of the whole recording."""
    held_out: Diagnostics
    """Of its second half."""
    fitted_on_first_half: bool
    """Whether q and r were estimated again on the first half for that, because they come from an estimate."""
    judgement: Judgement
    """Whether it fits, and what to do."""
    search: Judgement | None = None
    """What to do after a search that found no pair and changed nothing; None where the last one found one."""

    @property
    def urgent(self) -> Judgement:
        """What the control panel says: first that of a search that failed."""
        return self.search or self.judgement


def compute_checks(state: State, still: Callable[[State], Stretch] = lambda _state: None) -> Checks | None:
    """Diagnose the channel on screen; None where its filter has no q and r to judge.

    Args:
        state: what is on screen.
        still: finds a still stretch, which is asked for only where it would help.
    """
    if not state.is_standard:
        return None
    z, dt = state.z, state.dt
    whole = diagnose_run(Run.of_samples(z, state.params, dt))
    # q and r that were fitted to the whole recording have seen the second half: estimate again, on the first.
    estimated = state.tuning.how in METHOD_NAMES.values()

    def fit(first: Array, dt: Array | None) -> FilterParams:
        return estimate(first, dt=dt, momentum=state.tuning.momentum).params or state.params

    held_out = diagnose_held_out(z, fit if estimated else state.params, dt)
    judgement, search = _of_filter(state, whole, held_out, still), _of_search(state, still)
    whole, held_out = without_residuals(whole), without_residuals(held_out)
    judgement = replace(judgement, residuals=whole, held_out=held_out)  # without the arrays of all samples
    return Checks(state, whole, held_out, estimated, judgement, search)


def _of_filter(
    state: State, whole: Diagnostics, held_out: Diagnostics, still: Callable[[State], Stretch]
) -> Judgement:
    """The one judgement of the filter on screen, with all that is known about it."""
    answers, tuning = state.answers, state.tuning
    outcome = answers.outcome if answers.outcome and answers.outcome.after is not None else None
    estimate = outcome.estimate if outcome is not None and outcome.after == tuning else None
    asked = request_in(tuning.how, tuning.r) if outcome is None else outcome.request
    return judge(
        whole,
        held_out,
        estimate,
        request=still_met(asked, state.params, state.recording.sample_period),
        still=still(state) if needs_noise(estimate) else None,
        unit=state.recording.units[state.index],
    )


def _of_search(state: State, still: Callable[[State], Stretch]) -> Judgement | None:
    """What the last search says where it found no pair for what is on screen."""
    found = state.answers.outcome
    if found is None or found.after is not None or found.estimate is None:
        return None
    stretch = still(state) if needs_noise(found.estimate) else None
    return judge(None, estimate=found.estimate, still=stretch)
