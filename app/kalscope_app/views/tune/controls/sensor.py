"""One of the sensors that are fused: whether it takes part, its noise, its offset, and its share."""

from __future__ import annotations

import math

import viser

from kalscope.common.text import one_line, percent
from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes.fusion import (
    sensor_limits,
    set_sensor_exponent,
    set_sensor_text,
    set_taking_part,
)
from kalscope_app.session.session import Session
from kalscope_app.session.state import Change
from kalscope_app.views.binding import TypedNumber, on_user, put
from kalscope_app.views.tune.controls.slider import SliderWithText

MAX_NAME = 24
"""Characters of a sensor's name."""

R_HINT = "How noisy this sensor is: the variance of one reading. Larger gives it a smaller share."

OFFSET_HINT = "How much higher this sensor reads than the others. It is subtracted."


class SensorControl(SliderWithText):
    """A tick box with the name; below it, once sensors are fused, noise, share and offset."""

    def __init__(self, gui: viser.GuiApi, session: Session, number: int) -> None:
        """Args: the usual; which row this is."""
        self.name: str | None = None
        self._fused = False
        self._tick = gui.add_checkbox("", False, visible=False, hint="Whether this sensor takes part.")
        typed = TypedNumber(gui, session, f"r of sensor {number}", "noise r", R_HINT, self._r_typed)
        slider = gui.add_slider(
            "log₁₀ r",
            min=-6.0,
            max=6.0,
            step=0.01,
            initial_value=0.0,
            hint="Drag, or click and use the arrow keys. To the left the sensor counts more.",
        )
        super().__init__(session, f"r of sensor {number}", typed, slider, self._r_moved)
        self._offset = TypedNumber(
            gui, session, f"offset of sensor {number}", "offset", OFFSET_HINT, self._offset_typed
        )
        self.set_visible(False)
        on_user(self._tick.on_update, lambda _client: self._on_tick())

    @property
    def ticked(self) -> bool:
        """Whether its sensor is to take part."""
        return self.name is not None and self._tick.value

    def set_visible(self, visible: bool) -> None:
        """Show or hide what belongs to a fused sensor."""
        super().set_visible(visible)
        self._offset.set_visible(visible)

    def offer(self, name: str | None) -> None:
        """Represent this channel, not ticked; None: no channel."""
        self.name = name
        put(self._tick, label=self._title, visible=name is not None)
        put(self._tick, value=False)

    @property
    def _title(self) -> str:
        return "" if self.name is None else one_line(self.name)[:MAX_NAME]

    def show(self, frame: Frame) -> None:
        """Follow the frame; a channel that is not fused has its tick box alone."""
        fusion, name = frame.state.fusion, self.name
        self._fused = fusion is not None and name in fusion.tuning.sensors
        if fusion is None or name is None or not self._fused:
            put(self._tick, label=self._title)
            self.set_visible(False)
            return
        at, used = fusion.tuning.sensors.index(name), name not in fusion.dropped
        share = f": share {percent(fusion.shares[name])}" if used else ""
        put(self._tick, value=used, label=f"{self._title}{share}")
        self.set_visible(used)
        if not used:
            return
        r = fusion.tuning.r[at]
        self.typed.show(frame, r, "0")
        self._offset.show(frame, fusion.tuning.offset[at], "0")
        low, high = sensor_limits(fusion, name)
        self._follow(frame, min(max(math.log10(r), low), high) if r > 0.0 else float(low), float(low), float(high))

    def _on_tick(self) -> None:
        if self._fused and self.name is not None:  # else it only marks a channel for the button
            self._session.request(set_taking_part(self.name, self._tick.value))

    def _r_typed(self, _name: str, text: str) -> Change:
        return set_sensor_text(self.name or "", "r", text)

    def _offset_typed(self, _name: str, text: str) -> Change:
        return set_sensor_text(self.name or "", "offset", text)

    def _r_moved(self, exponent: float) -> Change:
        return set_sensor_exponent(self.name or "", exponent)
