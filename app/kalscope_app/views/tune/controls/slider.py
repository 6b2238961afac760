"""A parameter with a slider: its exact value as text, and its position on a scale."""

from __future__ import annotations

from collections.abc import Callable

import viser

from kalscope_app.engine.frame import Frame
from kalscope_app.session.session import Session
from kalscope_app.session.state import Change
from kalscope_app.views.binding import TypedNumber, on_user, put


class SliderWithText:
    """One parameter: its exact value as text, and a slider for its position on a scale."""

    def __init__(
        self,
        session: Session,
        name: str,
        typed: TypedNumber,
        slider: viser.GuiSliderHandle[float],
        change: Callable[[float], Change],
    ) -> None:
        """Args: the box and the slider of the parameter `name`; the change that a new position asks for."""
        self._session, self._name, self._change = session, name, change
        self.typed, self._slider = typed, slider
        self._serial = 0
        on_user(slider.on_update, lambda _client: self._file())

    def set_visible(self, visible: bool) -> None:
        """Show or hide both."""
        put(self._slider, visible=visible)
        self.typed.set_visible(visible)

    def _file(self) -> None:
        change = self._change(float(self._slider.value))
        self._serial = self._session.request(change, key=f"slider {self._name}")

    def _follow(self, frame: Frame, position: float, low: float, high: float) -> None:
        """Move the slider between its ends as the frame has it, unless it was moved since."""
        if frame.serial < self._serial:
            return
        put(self._slider, min=low, max=high)
        if abs(self._slider.value - position) > 0.005:
            self._slider.value = round(position, 2)
