"""Changes that a piece of advice asks for, where no search is needed."""

from __future__ import annotations

from kalscope.analysis import actions
from kalscope.analysis.findings import request_in
from kalscope_app.session.changes.parameters import set_automatic_start
from kalscope_app.session.state import Change, State

FOR_NOISE, FOR_LAG = "data sheet σ, fit q", "maximum lag"
"""The search methods that ask for the noise of the sensor, and for a lag."""


def change_for(action: actions.Action, judged: State) -> Change:
    """What an action does to the filter that was judged; nothing on another recording or channel.

    The values are those of the judged filter, so that two clicks do no more than one.
    """

    def change(state: State) -> State:
        return _applied(action, state, judged) if is_same_signal(state, judged) else state

    return change


def is_same_signal(state: State, judged: State) -> bool:
    """Whether the channel that was judged is still on screen."""
    return state.continues(judged.recording) and state.channel == judged.channel


def _applied(action: actions.Action, state: State, judged: State) -> State:
    q, r = judged.tuning.q, judged.tuning.r
    match action:
        case actions.Scale(q_factor, r_factor):
            chosen = (
                q_factor == r_factor and request_in(judged.tuning.how, r) is not None
            )  # q/r stays, and so does a goal
            how = judged.tuning.how if chosen else "by hand"
            state = state.with_tuning(q=_rounded(q * q_factor), r=_rounded(r * r_factor), how=how)
        case actions.SetRatio(ratio, factor):
            r = r * factor if r > 0.0 else q * factor / ratio
            state = state.with_tuning(q=_rounded(ratio * r), r=_rounded(r), how="by hand")
        case actions.SetGate(sigma):
            state = state.with_tuning(gate=None if sigma is None else sigma * sigma)
        case actions.UnsetStart():
            state = set_automatic_start(True)(state)
        case actions.GiveNoise():
            state = state.with_view(search_method=FOR_NOISE)
        case actions.ChooseFilter():
            state = state.with_view(search_method=FOR_LAG)
        case _:
            pass
    return state


def _rounded(value: float) -> float:
    """To three digits, as a slider sets it."""
    return float(f"{value:.2e}")
