"""What the last search gave, in a sentence below Apply: what the filter costs, and what has changed."""

from __future__ import annotations

from kalscope.common.text import decibels, gate_text, lag_text, number, percent
from kalscope.filtering.steady_state import SteadyState, steady_state
from kalscope.tuning.tuning import ChannelTuning
from kalscope_app.session.changes.momentum import momentum_words
from kalscope_app.session.state import Outcome, State

NBSP = "\u00a0"
"""Keeps a number and its unit on one line."""


def answer_text(state: State) -> str:
    """The last answer as markdown, "" for none; fixed words and numbers, with nothing to escape."""
    outcome = state.answers.outcome
    if outcome is None:
        return ""
    if outcome.after is None:
        return f"**Nothing was changed.** {outcome.message}"
    period = state.recording.sample_period
    before, after = steady_state(outcome.before.params), steady_state(outcome.after.params)
    said = [
        f"{_lead(outcome)} **{_lag(after, period)}** leaves **{_noise_left(after)} of the noise** "
        f"({decibels(-float(after.noise_reduction_db)).replace(' ', NBSP)}).",
        f"Before: {_lag(before, period)}, {_noise_left(before)}.",
    ]
    if after.overshoot:
        said.append(f"A step overshoots by {percent(float(after.overshoot))}.")
    if changes := changed(outcome.before, outcome.after, period):
        said.append(f"Changed: {changes}.")
    if outcome.estimate is not None:
        said.append("More in “Resulting filter”.")
    return " ".join(said)


def account_text(state: State) -> str:
    """What an estimate found out about the recording, "" for none: too long for the space above the sliders."""
    outcome = state.answers.outcome
    return "" if outcome is None or outcome.after is None or outcome.estimate is None else outcome.message


def _lead(outcome: Outcome) -> str:
    """What was asked for, unless it is the lag that follows."""
    goal = "" if outcome.request is None else outcome.request.goal
    if goal.startswith("a lag of"):
        return "Lag"
    asked = goal or outcome.how
    return f"{asked[:1].upper()}{asked[1:]}: lag"


def _lag(steady: SteadyState, period: float | None) -> str:
    return lag_text(steady.lag_samples, period).replace(" ", NBSP)


def _noise_left(steady: SteadyState) -> str:
    """The size of the noise that is left, as a share of its standard deviation."""
    return percent(10.0 ** (-steady.noise_reduction_db / 20.0)).replace(" ", NBSP)


def changed(before: ChannelTuning, after: ChannelTuning, period: float | None) -> str:
    """The parameters that differ, with both values: "q 0.61 → 6.97"."""
    rows = (
        ("q", number(before.q), number(after.q)),
        ("r", number(before.r), number(after.r)),
        ("momentum", momentum_words(before.momentum, period), momentum_words(after.momentum, period)),
        ("gate", gate_text(before.gate), gate_text(after.gate)),
    )
    return ", ".join(f"{name}{NBSP}{old}{NBSP}→{NBSP}{new}" for name, old, new in rows if old != new)
