"""The momentum τ: how long the signal keeps its direction. A text box, and a slider whose low end is off."""

from __future__ import annotations

import viser

from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes.momentum import (
    MAX_POSITION,
    OFF,
    momentum_words,
    set_momentum_position,
    set_momentum_text,
    slider_position,
)
from kalscope_app.session.session import Session
from kalscope_app.views.binding import TypedNumber
from kalscope_app.views.tune.controls.slider import SliderWithText

LABEL = "momentum τ, samples"

HINT = "How long the signal keeps its direction, or as 240 ms. More: less noise at the same lag, but overshoot."


MARKS = (
    (0.0, OFF),
    *((slider_position(10.0**power), text) for power, text in enumerate(("10", "100", "1000", "1e4", "1e5"), 1)),
)
"""Values beside the slider, in samples."""


class MomentumControl(SliderWithText):
    """The momentum: the exact value as text, and a slider."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        typed = TypedNumber(gui, session, "momentum", LABEL, HINT, set_momentum_text)
        slider = gui.add_slider(
            slider_label(0.0, None),
            min=0.0,
            max=MAX_POSITION,
            step=0.01,
            initial_value=0.0,
            marks=MARKS,
            hint="At the left end there is no momentum. Drag, or click and use the arrow keys.",
        )
        super().__init__(session, "momentum", typed, slider, set_momentum_position)

    def show(self, frame: Frame) -> None:
        """Follow the frame unless the slider has moved since; a slider that is dragged to off stays until then."""
        held = 0 < frame.serial <= self._serial
        self.set_visible(frame.state.uses_parameters and (frame.state.tuning.momentum > 0.0 or held))
        momentum = frame.state.tuning.momentum
        self.typed.show(frame, momentum or None, OFF)
        self._slider.label = slider_label(momentum, frame.state.recording.sample_period)
        self._follow(frame, slider_position(momentum), 0.0, MAX_POSITION)


def slider_label(momentum: float, period: float | None) -> str:
    """The label of the slider: the momentum as a time, where the sample period (s) is known."""
    return f"τ = {momentum_words(momentum, period)}" if momentum > 0.0 else "τ off"
