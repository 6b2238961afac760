"""Changes of the parameters of the channel on screen, and of its filter.

A browser may send anything, so a change clamps its values or raises BadSetting; it never trusts a widget's limits.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from kalscope.common.text import typed_gate, typed_number
from kalscope.estimation.result import Estimate
from kalscope.papers.generalized.filter import GeneralizedParams
from kalscope.recording import Recording
from kalscope.tuning.paper_tuning import with_kalman_filter, with_paper_filter
from kalscope_app.session.changes.variants import PARAMETERS
from kalscope_app.session.opening import with_sample_period
from kalscope_app.session.state import Change, Outcome, State

if TYPE_CHECKING:
    from kalscope.estimation.finding import Found

DECADES = {"q": (-8, 3), "r": (-5, 4), "p0": (-6, 6)}
"""Range of each slider, in decades around the starting r of the channel."""


def slider_limits(state: State, name: str) -> tuple[int, int]:
    """Lowest and highest exponent of a slider: around the signal's own noise, wider if the value is outside."""
    centre = round(math.log10(state.start.r))
    low, high = (centre + end for end in DECADES[name])
    value = getattr(state.tuning, name)
    if value:
        low, high = min(low, math.floor(math.log10(value))), max(high, math.ceil(math.log10(value)))
    return max(low, -300), min(high, 300)


def set_exponent(name: str, exponent: float) -> Change:
    """A slider was moved: q, r or p0 becomes 10^exponent; moving p0 means a start by value."""

    def change(state: State) -> State:
        if not math.isfinite(exponent):
            return state
        low, high = slider_limits(state, name)
        value = 10.0 ** min(max(exponent, low), high)
        return _by_hand(state, name, float(f"{value:.2e}"))  # three digits suit a slider

    return change


def set_point(q_exponent: float, r_exponent: float) -> Change:
    """A point of the tuning map was chosen: q and r become 10^exponent, to three digits."""

    def change(state: State) -> State:
        if not state.is_standard or not (math.isfinite(q_exponent) and math.isfinite(r_exponent)):
            return state
        q, r = (float(f"{10.0 ** min(max(e, -300.0), 299.9):.2e}") for e in (q_exponent, r_exponent))
        return state if (q, r) == (state.tuning.q, state.tuning.r) else state.with_tuning(q=q, r=r, how="by hand")

    return change


def set_text(name: str, text: str) -> Change:
    """An exact value was typed: q, r, p0 (or "", "diffuse": automatic), x0 (or "": the first sample), gate in σ."""

    def change(state: State) -> State:
        if name == "x0" and text.strip().lower() in ("", "first"):
            return state.with_tuning(x0=None)
        if name == "p0" and text.strip().lower() in ("", "automatic", "diffuse"):
            return set_automatic_start(True)(state)
        if name == "gate":
            return state.with_tuning(gate=typed_gate(text))
        value = typed_number(name, text)
        if getattr(state.tuning, name) == value:
            return state
        if name == "x0" and state.tuning.p0 is None:
            return state.with_tuning(x0=value, p0=state.tuning.r)
        return _by_hand(state, name, value)

    return change


def _by_hand(state: State, name: str, value: float) -> State:
    """One parameter set by hand; only q, r and the momentum have a history that this ends."""
    how = "by hand" if name in ("q", "r") else state.tuning.how
    return state.with_tuning(**{name: value}, how=how)


def set_automatic_start(automatic: bool) -> Change:
    """Automatic (diffuse) start at the first sample, or p0 and x0 by value, beginning with p0 = r."""

    def change(state: State) -> State:
        if automatic == (state.tuning.p0 is None):
            return state
        return state.with_tuning(p0=None if automatic else max(state.tuning.r, 1e-300), x0=None)

    return change


def reset_parameters(state: State) -> State:
    """Back to the starting values of the channel, or to those of the fused sensors."""
    if state.fusion is not None:
        return state.with_fusion(state.fusion.reset)
    start = state.start
    values = {name: getattr(start, name) for name in (*PARAMETERS, "how")}
    return state.with_tuning(**values)


def apply_found(recording: Recording, channel: str, found: Found) -> Change:
    """A search has ended: its q, r, momentum and gate become the channel's, if the channel is still there."""

    def change(state: State) -> State:
        if not state.continues(recording):
            note = "The search ended after another recording was opened; nothing was changed."
            return state.with_answers(note=note)
        at = recording.index(channel)
        before = state.settings.tunings[at]
        if found.params is None:
            return state.with_answers(
                outcome=Outcome(found.how, found.message, before, None, found.estimate, found.request)
            )
        q, r, momentum = (float(value) for value in (found.params.q, found.params.r, found.params.momentum))
        gate = before.gate if found.params.gate is None else found.params.gate
        after = replace(with_kalman_filter(before), q=q, r=r, momentum=momentum, gate=gate, how=found.how)
        answer = Outcome(found.how, found.message, before, after, found.estimate, found.request)
        outcome = answer if channel == state.channel else None
        return state.with_tuning_of(at, after).with_answers(outcome=outcome)

    return change


def set_method_comparison(recording: Recording, channel: str, estimates: tuple[Estimate, ...]) -> Change:
    """The five methods have given their estimates."""

    def change(state: State) -> State:
        same = state.continues(recording) and state.channel == channel
        return state.with_answers(method_comparison=estimates) if same else state

    return change


def paper_filter(state: State) -> GeneralizedParams | None:
    """The Khan et al. filter, where the channel on screen runs it."""
    return state.filter if isinstance(state.filter, GeneralizedParams) else None


def set_variant_of_eq3(variant: str | None) -> Change:
    """Filter with the equations of Khan et al., "printed" or "without_slip", or with the standard filter (None)."""

    def change(state: State) -> State:
        paper = paper_filter(state)
        if variant is None:
            return state.with_standard_filter()
        if paper is None:
            return use_paper_filter(state, GeneralizedParams(max(state.tuning.r, 1e-290), None, None, variant))
        return state if paper.reading == variant else use_paper_filter(state, replace(paper, reading=variant))

    return change


def use_paper_filter(state: State, paper: GeneralizedParams) -> State:
    """The state with the filter of Khan et al. for the channel on screen."""
    tunings, at = state.settings.tunings, state.index  # linked channels follow q and r, not the filter
    tunings = (*tunings[:at], with_paper_filter(tunings[at], paper), *tunings[at + 1 :])
    return state.with_settings(tunings=tunings).with_answers(outcome=None, note="")


def set_paper_text(name: str, text: str) -> Change:
    """A value of the Khan et al. filter was typed: sigma_m, sigma_e0 or e0; empty is automatic."""

    def change(state: State) -> State:
        paper = paper_filter(state)
        if paper is None:
            return state
        empty = name != "sigma_m" and text.strip().lower() in ("", "automatic")
        value = None if empty else typed_number(name, text)
        return use_paper_filter(state, replace(paper, **{name: value}))

    return change


def set_sample_period(text: str) -> Change:
    """The time between two samples was typed, s; an empty box is what the recording says."""

    def change(state: State) -> State:
        period = typed_number("sample period", text) if text.strip() else None
        return state if period == state.open.typed_period else with_sample_period(state, period)

    return change
