"""A number typed as text, exact to the last digit, and one that has a slider too."""

from __future__ import annotations

from collections.abc import Callable

import viser

from kalscope.common.text import squared
from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes.parameters import set_text
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import Change
from kalscope_app.views.binding import on_user, put
from kalscope_app.views.text import typed


class TypedNumber:
    """A number typed as text, so that 1e-9 works. `text_boxes.js` sends a text when it counts, not each key."""

    def __init__(
        self,
        gui: viser.GuiApi,
        session: Session,
        name: str,
        label: str,
        hint: str,
        change: Callable[[str, str], Change] = set_text,
        written: Callable[[float], str] = typed,
    ) -> None:
        self._session, self._name, self._hint, self._change = session, name, hint, change
        self._written = written
        self._text = gui.add_text(label, "", hint=hint)
        self._value: object = self  # nothing has been shown yet
        self._serial, self._stale = 0, False
        on_user(self._text.on_update, lambda _client: self._file())

    def set_visible(self, visible: bool) -> None:
        """Show or hide the box."""
        put(self._text, visible=visible)

    def _file(self) -> None:
        """Request what was typed; the frame of it, or of its refusal, writes what the filter uses."""
        self._stale = True  # before the request: its frame may come before its serial
        change = self._change(self._name, self._text.value)
        self._serial = self._session.request(change, key=f"text {self._name}", failed=Failed.NUMBER)

    def show(self, frame: Frame, value: float | None, missing: str) -> None:
        """Write the frame's value, unless a newer one was typed or the value has not changed."""
        if "{unit}" in self._hint:
            put(self._text, hint=self._hint.format(unit=squared(frame.state.tuning.unit)))
        if frame.serial < self._serial or (value == self._value and not self._stale):
            return
        self._value, self._stale = value, False
        self._text.value = missing if value is None else self._written(value)


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
