"""One variance, q, r or p0: the exact value as text, and a slider over its exponent."""

from __future__ import annotations

import math

import viser

from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes.parameters import set_exponent, slider_limits
from kalscope_app.session.session import Session
from kalscope_app.views.binding import TypedNumber
from kalscope_app.views.tune.controls.slider import SliderWithText

NAMES = {"q": "process noise q", "r": "measurement noise r", "p0": "initial variance p0"}

HINTS = {
    "q": "How fast the true value moves: the variance it gains per sample, {unit}. Larger follows faster.",
    "r": "How noisy the sensor is: the variance of one reading, {unit}. Larger smooths more.",
    "p0": "How uncertain the initial estimate is: its variance, {unit}. automatic: start from the first sample.",
}

AUTOMATIC = "automatic"
"""The text in the box of p0 for a start from the first sample."""


class VarianceControl(SliderWithText):
    """The box and the slider of one variance."""

    def __init__(self, gui: viser.GuiApi, session: Session, name: str) -> None:
        typed = TypedNumber(gui, session, name, NAMES[name], HINTS[name])
        slider = gui.add_slider(
            f"log₁₀ {name}",
            min=-6.0,
            max=6.0,
            step=0.01,
            initial_value=0.0,
            hint=f"Drag, or click and use the arrow keys: one step changes {name} by 2.3 %.",
        )
        super().__init__(session, name, typed, slider, lambda exponent: set_exponent(name, exponent))

    def show(self, frame: Frame) -> None:
        """Follow the frame unless the slider has moved since."""
        value = getattr(frame.state.tuning, self._name)
        self.typed.show(frame, value, AUTOMATIC)
        low, high = slider_limits(frame.state, self._name)
        if value is None:  # the automatic start has the variance of one reading after its first sample
            value = frame.state.tuning.r
        exponent = min(max(math.log10(value), low), high) if value > 0.0 else float(low)
        self._follow(frame, exponent, float(low), float(high))
