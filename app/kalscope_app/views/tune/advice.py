"""Advice as buttons: the label of each, and the one undoable step that it takes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from kalscope.analysis import actions
from kalscope.analysis.findings import times
from kalscope.common.text import trimmed
from kalscope.estimation.finding import Noise, Request
from kalscope_app.session.changes.advice import FOR_LAG, change_for, is_same_signal
from kalscope_app.session.session import Session
from kalscope_app.session.state import State
from kalscope_app.views.scales import range_text, time_scale_for

if TYPE_CHECKING:
    from kalscope_app.views.tune.goal.goal import GoalView


def label_of(action: actions.Action | None, state: State) -> str:
    """The label of the button; "" where there is none, as for a new recording or a goal that is chosen already."""
    match action:
        case actions.AllowMomentum():
            words = "Allow momentum and fit again"
        case actions.EstimateAgain():
            words = "Fit again"
        case actions.SetSpikesAside():
            words = "Set the spikes aside and fit again"
        case actions.SetGate(sigma):
            words = "Switch the gate off" if sigma is None else f"Switch the gate on ({trimmed(sigma)} σ)"
        case actions.UseStillStretch(first, last):
            words = f"Use the still stretch {stretch_text(state, first, last)}"
        case actions.Scale(q, r):
            words = _scale_words(q, r)
        case actions.SetRatio(ratio):
            words = f"Set q/r to {trimmed(ratio, 2)}"
        case actions.GiveNoise():
            words = "Give the noise of the sensor"
        case actions.ChooseFilter():
            words = "Choose a lag" if state.view.search_method != FOR_LAG else ""
        case actions.UnsetStart():
            words = "Start from the first sample"
        case actions.RecordLonger() | None:
            words = ""
    return words


def take(action: actions.Action, state: State, session: Session, goal: GoalView) -> None:
    """Do what a piece of advice about `state` says, as one step that Undo takes back.

    Args:
        action: what to do.
        state: the state that was judged; nothing is done once another recording or channel is on screen.
        session: where the change is filed.
        goal: runs a search where one is needed.
    """
    request = request_of(action, state)
    if request is None:
        session.request(change_for(action, state))
    else:
        goal.search(lambda present: request if is_same_signal(present, state) else None)


def request_of(action: actions.Action, state: State) -> Request | None:
    """The search that an action asks for about `state`; None where it asks for none."""
    match action:
        case actions.UseStillStretch(first, last):
            return Request(noise=Noise(still=(first, last)))
        case actions.SetSpikesAside():
            outcome = state.answers.outcome
            before = Request() if outcome is None or outcome.request is None else outcome.request
            return replace(before, robust=True)  # what was known about the noise still is
        case actions.AllowMomentum() | actions.EstimateAgain():
            return Request()
        case _:
            return None


def stretch_text(state: State, first: int, last: int) -> str:
    """A stretch of samples by its times: 12 to 19 s."""
    time = state.recording.time
    clock = time_scale_for(float(time.max() - time.min()), state.recording.sample_period)
    ends = (float(time[at]) * clock.factor for at in (first, last - 1))
    return f"{range_text(*ends)} {clock.unit}"


def _scale_words(q: float, r: float) -> str:
    """The change of q and r in words: "Raise q 10 × and lower r 2 ×"."""
    parts: list[str] = []
    for name, factor in (("q", q), ("r", r)):
        size = max(factor, 1.0 / factor)
        if size > 1.0:
            verb = "raise" if factor > 1.0 else "lower"
            parts.append(f"{verb} {name} {times(size)}")
    words = " and ".join(parts)
    return f"{words[:1].upper()}{words[1:]}"
