"""State -> Checks: an idle-time computation, because it takes longer than a frame."""

from __future__ import annotations

from dataclasses import dataclass

from kalscope.analysis.diagnostics import Diagnostics, diagnose, diagnose_held_out
from kalscope.common.array import Array
from kalscope.estimation.estimate import estimate
from kalscope.estimation.finding import METHOD_NAMES
from kalscope.filtering.batch import kalman_filter
from kalscope.filtering.params import FilterParams
from kalscope_app.session.state import State


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


def compute_checks(state: State) -> Checks | None:
    """Diagnose the channel on screen; None where its filter has no q and r to judge."""
    if not state.filter.is_standard:
        return None
    z, dt = state.z, state.dt
    whole = diagnose(kalman_filter(z, state.params, dt))
    if isinstance(whole, tuple):
        whole = whole[0]
    # q and r that were fitted to the whole recording have seen the second half: estimate again, on the first.
    estimated = state.tuning.how in METHOD_NAMES.values()

    def fit(first: Array, dt: Array | None) -> FilterParams:
        return estimate(first, dt=dt, momentum=state.tuning.momentum).params or state.params

    return Checks(state, whole, diagnose_held_out(z, fit if estimated else state.params, dt), estimated)
