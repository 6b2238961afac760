"""State -> Checks: what is computed once a gesture has come to rest, because it takes longer than a frame. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from kalscope.analysis.diagnostics import Diagnostics, diagnose, diagnose_held_out
from kalscope.estimation.estimate import estimate
from kalscope.estimation.finding import METHOD_WORDS
from kalscope.filtering.batch import kalman_filter

if TYPE_CHECKING:
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
    """Whether q and r were estimated anew on the first half for that, because they come from an estimate."""


def compute_checks(state: State) -> Checks | None:
    """Diagnose the channel on screen; None where its filter has no q and r to judge."""
    if state.paper_filter is not None:
        return None
    z, dt = state.recording.channel(state.channel), state.dt
    whole = diagnose(kalman_filter(z, state.params, dt))
    if isinstance(whole, tuple):
        whole = whole[0]
    # q and r that were fitted to the whole recording have seen the second half: ask again, of the first.
    estimated = state.tuning.how in METHOD_WORDS.values()
    fit = (lambda first, dt: estimate(first, dt=dt).params or state.params) if estimated else state.params
    return Checks(state, whole, diagnose_held_out(z, fit, dt), estimated)
