"""State -> Checks: what is computed once a gesture has come to rest, because it takes longer than a frame. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from kalscope.diagnostics import Diagnostics, diagnose, diagnose_held_out
from kalscope.filtering import kalman_filter
from kalscope_app.state import State


@dataclass(frozen=True)
class Checks:
    """How well the filter on screen describes the channel on screen."""

    state: State
    """The choices that were checked."""
    all_samples: Diagnostics
    """Of the whole recording."""
    held_out: Diagnostics
    """Of its second half, which is honest where q and r were fitted to the first."""


def compute_checks(state: State) -> Checks:
    """Diagnose the channel on screen."""
    z = state.recording.channel(state.channel)
    whole = diagnose(kalman_filter(z, state.params))
    if isinstance(whole, tuple):
        whole = whole[0]
    return Checks(state, whole, diagnose_held_out(z, state.params))
