"""The frame of a state, as the engine makes it."""

from __future__ import annotations

from kalscope_app.engine.filter_runs import FilterRuns, choose_samples
from kalscope_app.engine.frame import Frame, compute_frame
from kalscope_app.session.changes import live_window
from kalscope_app.session.state import State


def frame_of(state: State, runs: FilterRuns | None = None) -> Frame:
    """What is on screen of a state; `runs` are those of earlier frames."""
    channel, *others = state.measured
    drawn = choose_samples(state.recording, channel, live_window(state), others=tuple(others))
    return compute_frame(state, 0, drawn, runs)
