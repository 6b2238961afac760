"""The changes that can be asked for: each returns a function State -> State that checks all it was given.

A browser may send anything, so a change clamps its values or raises BadSetting; it never trusts a widget's limits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import replace
from typing import TYPE_CHECKING

from kalscope.common.text import typed_number
from kalscope.errors import BadSetting
from kalscope.papers.generalized_filter import GeneralizedParams
from kalscope_app.session.linked_channels import in_step
from kalscope_app.session.opening import timed
from kalscope_app.session.state import MAP_COLOURS, Outcome, Sent, State, slider_limits

if TYPE_CHECKING:
    from kalscope.estimation.finding import Found
    from kalscope.estimation.result import Estimate
    from kalscope.recording import Recording

Change = Callable[[State], State]


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
        if state.rule is not None or not (math.isfinite(q_exponent) and math.isfinite(r_exponent)):
            return state
        q, r = (float(f"{10.0 ** min(max(e, -300.0), 299.9):.2e}") for e in (q_exponent, r_exponent))
        return state if (q, r) == (state.tuning.q, state.tuning.r) else state.with_tuning(q=q, r=r, how="by hand")

    return change


def set_text(name: str, text: str) -> Change:
    """An exact value was typed for q, r, p0 or x0; an empty x0 is the first sample, an empty gate is off."""

    def change(state: State) -> State:
        if name == "x0" and text.strip().lower() in ("", "first"):
            return state.with_tuning(x0=None)
        if name == "gate" and text.strip().lower() in ("", "off"):
            return state.with_tuning(gate=None)
        value = typed_number(name, text)
        if getattr(state.tuning, name) == value:
            return state
        if name == "x0" and state.tuning.p0 is None:
            return state.with_tuning(x0=value, p0=state.tuning.r)
        return _by_hand(state, name, value)

    return change


def _by_hand(state: State, name: str, value: float) -> State:
    """One parameter set by hand; only q and r have a history that this ends."""
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
    """Back to the starting values of the channel."""
    start = state.starts[state.recording.index(state.channel)]
    return state.with_tuning(q=start.q, r=start.r, p0=start.p0, x0=start.x0, gate=start.gate, how=start.how)


def select_channel(name: str) -> Change:
    """Look at another channel, with its own parameters."""

    def change(state: State) -> State:
        state.recording.index(name)
        if name == state.channel:
            return state
        return replace(state, channel=name, resets=state.resets + 1, outcome=None, opinions=(), note="")

    return change


def set_window(first: float, last: float) -> Change:
    """Show the recording from `first` to `last`, s; at least ten samples; the whole of it is None."""

    def change(state: State) -> State:
        t = state.recording.time
        begin, end = float(t.min()), float(t.max())
        if not (math.isfinite(first) and math.isfinite(last)):
            return state
        low, high = sorted((min(max(first, begin), end), min(max(last, begin), end)))
        least = 10.0 * (state.recording.sample_period or 1.0)
        if high - low < least:
            low, high = max(begin, min(low, end - least)), min(end, max(high, low + least))
        window = None if low <= begin and high >= end else (low, high)
        live = replace(state.live, following=False) if state.live else None  # the person looks back
        same = window == state.window and live == state.live
        return state if same else replace(state, window=window, live=live)

    return change


def reset_view(state: State) -> State:
    """Show the whole recording and forget the zoom."""
    return replace(state, window=None, resets=state.resets + 1)


def follow_end(state: State) -> State:
    """Move the window, at its present length (a tenth of the recording if it shows all), to the end."""
    t = state.recording.time
    begin, end = float(t.min()), float(t.max())
    length = state.window[1] - state.window[0] if state.window else (end - begin) / 10.0
    return replace(set_window(end - length, end)(state), resets=state.resets + 1)


def apply_found(recording: Recording, channel: str, found: Found) -> Change:
    """A search has ended: its pair becomes the channel's q and r, if it has one and the channel is still there."""

    def change(state: State) -> State:
        if not state.continues(recording):
            return replace(state, note="The search ended after another recording was opened; nothing was changed.")
        at = recording.index(channel)
        before = state.tunings[at]
        if found.params is None:
            return replace(state, outcome=Outcome(found.how, found.message, before, None))
        q, r = float(found.params.q), float(found.params.r)
        after = replace(before, q=q, r=r, how=found.how)
        tunings = (*state.tunings[:at], after, *state.tunings[at + 1 :])
        tunings = in_step(tunings, state.starts, at, state.together)
        outcome = Outcome(found.how, found.message, before, after) if channel == state.channel else None
        rules = (*state.rules[:at], None, *state.rules[at + 1 :]) if state.rules else ()
        return replace(state, tunings=tunings, rules=rules, outcome=outcome)

    return change


def set_opinions(recording: Recording, channel: str, opinions: tuple[Estimate, ...]) -> Change:
    """The five methods have answered."""

    def change(state: State) -> State:
        same = state.continues(recording) and state.channel == channel
        return replace(state, opinions=opinions) if same else state

    return change


def set_reading(reading: str | None) -> Change:
    """Filter with the second paper's equations, "printed" or "without_slip", or with the five lines (None)."""

    def change(state: State) -> State:
        rule = state.rule
        if reading is None or (rule is not None and rule.reading == reading):
            return state if (rule is None) == (reading is None) else state.with_rule(None)
        if rule is not None:
            return state.with_rule(GeneralizedParams(rule.sigma_m, rule.sigma_e0, rule.e0, reading))
        return state.with_rule(GeneralizedParams(max(state.tuning.r, 1e-290), None, None, reading))

    return change


def set_rule_text(name: str, text: str) -> Change:
    """A value of the second paper's filter was typed: sigma_m, sigma_e0 or e0; empty is automatic."""

    def change(state: State) -> State:
        if state.rule is None:
            return state
        empty = name != "sigma_m" and text.strip().lower() in ("", "automatic")
        return state.with_rule(replace(state.rule, **{name: None if empty else typed_number(name, text)}))

    return change


def set_way(way: str, ways: Collection[str]) -> Change:
    """Search q and r in another way, one of `ways`."""

    def change(state: State) -> State:
        if way not in ways:
            raise BadSetting(f"the way to find q and r must be one of {', '.join(ways)} (got {str(way)[:40]!r})")
        return replace(state, way=way)

    return change


def set_smoother(shown: bool) -> Change:
    """Draw the best possible offline curve, or not."""
    return lambda state: replace(state, smoother=bool(shown))


def set_match(match: str) -> Change:
    """Compare simpler filters at equal "lag" or equal "noise" reduction."""
    return lambda state: replace(state, match="noise" if match == "noise" else "lag")


def set_rival(name: str) -> Change:
    """Draw one simpler filter beside the present one, by its name; any other word draws all."""
    return lambda state: replace(state, rival=str(name)[:60])


def set_dark(dark: bool) -> Change:
    """Dark or light theme."""
    return lambda state: replace(state, dark=bool(dark))


def set_map_shown(shown: bool) -> Change:
    """Show the tuning map, or give its room to the charts."""
    return lambda state: replace(state, map_shown=bool(shown))


def set_map_colour(colour: str) -> Change:
    """Colour the tuning map by another measure; the error needs a known truth."""

    def change(state: State) -> State:
        if colour not in MAP_COLOURS:
            raise BadSetting(f"the map's colour must be one of {', '.join(MAP_COLOURS)} (got {str(colour)[:40]!r})")
        if colour == "RMSE" and state.recording.truth is None:
            raise BadSetting("the map's colour must be likelihood or lag where the truth is not known (got RMSE)")
        return replace(state, map_colour=colour)

    return change


def set_sample_period(text: str) -> Change:
    """The time between two samples was typed, s, for a recording that does not tell it."""

    def change(state: State) -> State:
        recording = timed(state.recording, typed_number("sample period", text))
        if recording is state.recording:
            return state
        period = recording.sample_period
        return replace(state, recording=recording, typed_period=period, window=None, resets=state.resets + 1)

    return change


def set_board_channel(name: str | None) -> Change:
    """Say which channel is the board's own filtered curve; None: there is none."""

    def change(state: State) -> State:
        if name is not None:
            state.recording.index(name)
        return state if name == state.board else replace(state, board_choice=name)

    return change


def set_sent(sent: Sent | None) -> Callable[[State], State]:
    """The board has taken a setting, and its curve is drawn; None: what it uses is not known."""

    def change(state: State) -> State:
        if sent is not None and state.board is None and sent.filtered in state.recording.names:
            state = replace(state, board_choice=sent.filtered)
        return replace(state, sent=sent)

    return change
