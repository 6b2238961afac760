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
from kalscope_app.views.binding import on_user
from kalscope_app.views.tune.typed_number import TypedNumber

LABEL = "momentum τ, samples"

HINT = "How long the signal keeps its direction, or as 240 ms. More: less noise at the same lag, but overshoot."


MARKS = (
    (0.0, OFF),
    *((slider_position(10.0**power), text) for power, text in enumerate(("10", "100", "1000", "1e4", "1e5"), 1)),
)
"""Values beside the slider, in samples."""


class MomentumControl:
    """The momentum: the exact value as text, and a slider."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session = session
        self.typed = TypedNumber(gui, session, "momentum", LABEL, HINT, set_momentum_text)
        self._slider = gui.add_slider(
            slider_label(0.0, None),
            min=0.0,
            max=MAX_POSITION,
            step=0.01,
            initial_value=0.0,
            marks=MARKS,
            hint="At the left end there is no momentum. Drag, or click and use the arrow keys.",
        )
        self._serial = 0
        on_user(self._slider.on_update, lambda _client: self._file())

    def set_visible(self, visible: bool) -> None:
        """Show or hide it."""
        self._slider.visible = visible
        self.typed.set_visible(visible)

    def _file(self) -> None:
        change = set_momentum_position(float(self._slider.value))
        self._serial = self._session.request(change, key="slider momentum")

    def show(self, frame: Frame) -> None:
        """Follow the frame unless the slider has moved since."""
        momentum = frame.state.tuning.momentum
        self.typed.show(frame, momentum or None, OFF)
        self._slider.label = slider_label(momentum, frame.state.recording.sample_period)
        if frame.serial < self._serial:
            return
        position = slider_position(momentum)
        if abs(self._slider.value - position) > 0.005:
            self._slider.value = round(position, 2)


def slider_label(momentum: float, period: float | None) -> str:
    """What stands beside the slider: the momentum as a time, where the sample period (s) is known."""
    return f"τ = {momentum_words(momentum, period)}" if momentum > 0.0 else "τ off"
