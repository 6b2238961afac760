"""Changes of the momentum τ of the channel on screen: by its slider, or typed in samples or as a time.

The slider counts log₁₀(1 + τ): its low end is exactly 0, and from a few samples on equal steps are equal ratios.
"""

from __future__ import annotations

import math

from kalscope.common.text import TIME_UNITS, lag_text, typed_number
from kalscope.errors import BadSetting
from kalscope.filtering.params import MAX_MOMENTUM
from kalscope.filtering.steady_state import steady_state
from kalscope_app.session.state import Change, State

MAX_POSITION = 5.0
"""Where the slider ends: at MAX_MOMENTUM, 100,000 samples."""

OFF = "off"
"""The text for no momentum."""

_SAMPLES = (" samples", " sample")


def slider_position(momentum: float) -> float:
    """The position of the slider for a momentum in samples, 0 … MAX_POSITION."""
    return math.log1p(momentum) / math.log(10.0)


def momentum_at(position: float) -> float:
    """The momentum in samples at a position of the slider, to three digits; exactly 0 at its low end."""
    held = min(max(position, 0.0), MAX_POSITION)
    return min(float(f"{math.expm1(held * math.log(10.0)):.2e}"), MAX_MOMENTUM)


def set_momentum_position(position: float) -> Change:
    """The slider was moved."""
    return lambda state: with_momentum(state, momentum_at(position)) if math.isfinite(position) else state


def set_momentum_text(_name: str, text: str) -> Change:
    """A momentum was typed: samples, or a time such as 240 ms; empty or "off" is none."""

    def change(state: State) -> State:
        return with_momentum(state, typed_momentum(text, state.recording.sample_period))

    return change


def typed_momentum(text: str, period: float | None) -> float:
    """The momentum in samples that a user typed.

    Raises:
        BadSetting: it is not a number, or it is a time and the sample period is not known.
    """
    bare = text.strip().lower()
    if bare in ("", OFF, "none"):
        return 0.0
    for word in _SAMPLES:
        bare = bare.removesuffix(word)
    unit = next(((word, length) for word, length in TIME_UNITS if bare.endswith(word)), None)
    if unit is None:
        return typed_number("momentum", bare)
    if period is None:
        raise BadSetting(f"momentum must be in samples while the sample period is not known (got {text[:40]!r})")
    word, length = unit
    return typed_number("momentum", bare.removesuffix(word)) * length / period


def with_momentum(state: State, momentum: float) -> State:
    """The state with another momentum for the channel on screen; raises what FilterParams raises."""
    return state if momentum == state.tuning.momentum else state.with_tuning(momentum=momentum, how="by hand")


def add_momentum(state: State) -> State:
    """Begin with a momentum as long as the lag, to two digits; a slider can then find a better one."""
    lag = steady_state(state.tuning.params).lag_samples
    return with_momentum(state, float(f"{min(max(lag, 1.0), MAX_MOMENTUM):.1e}"))


def momentum_words(momentum: float, period: float | None) -> str:
    """A momentum as a time, or in samples where the sample period (s) is not known; "off" for none."""
    return lag_text(momentum, period) if momentum > 0.0 else OFF
