"""The closed folder "Fuse sensors": which channels measure one quantity, and each of these sensors."""

from __future__ import annotations

import threading
from collections.abc import Callable

import viser

from kalscope.common.text import one_line, percent
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.changes import (
    apply_estimate,
    candidates,
    readings_of,
    set_exponent,
    set_sensor_text,
    set_taking_part,
    slider_limits,
    stop_fusing,
    studied,
)
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import MAX_SENSORS, Change, State
from kalscope_app.studies.checks import Judged
from kalscope_app.views.checks import reasons_of
from kalscope_app.views.widgets import (
    NumberWithSlider,
    SlowJobProgress,
    TypedNumber,
    escape_markdown,
    offer,
    on_decades,
    on_user,
    put,
)

# One of the sensors that are fused: whether it takes part, its noise, its offset, and its share.


MAX_NAME = 24
"""Characters of a sensor's name."""

R_HINT = "How noisy this sensor is: the variance of one reading. Larger gives it a smaller share."

OFFSET_HINT = "How much higher this sensor reads than the others. It is subtracted."


class SensorControl:
    """A tick box with the name; below it, once sensors are fused, noise, share and offset."""

    def __init__(self, gui: viser.GuiApi, session: Session, number: int) -> None:
        """Args: the usual; which row this is."""
        self._session = session
        self.name: str | None = None
        self._fused = False
        self._tick = gui.add_checkbox("", False, visible=False, hint="Whether this sensor takes part.")
        box = TypedNumber(gui, session, f"r of sensor {number}", "noise r", R_HINT, self._typed("r"))
        self._r = NumberWithSlider(gui, session, f"log₁₀ r of sensor {number}", box, self._moved)
        label = f"offset of sensor {number}"
        self._offset = TypedNumber(gui, session, label, "offset", OFFSET_HINT, self._typed("offset"))
        self._set_visible(False)
        on_user(self._tick.on_update, lambda _client: self._on_tick())

    @property
    def ticked(self) -> bool:
        """Whether its sensor is to take part."""
        return self.name is not None and self._tick.value

    def _set_visible(self, visible: bool) -> None:
        self._r.set_visible(visible)
        self._offset.set_visible(visible)

    def offer(self, name: str | None) -> None:
        """Represent this channel, not ticked; None: no channel."""
        self.name = name
        put(self._tick, label=self._title, visible=name is not None, value=False)

    @property
    def _title(self) -> str:
        return "" if self.name is None else one_line(self.name)[:MAX_NAME]

    def show(self, frame: Frame) -> None:
        """Follow the frame; a channel that is not fused has its tick box alone."""
        fusion, name = frame.state.fusion, self.name
        self._fused = fusion is not None and name in fusion.tuning.sensors
        if fusion is None or name is None or not self._fused:
            put(self._tick, label=self._title)
            self._set_visible(False)
            return
        at, used = fusion.tuning.sensors.index(name), name not in fusion.dropped
        share = f": share {percent(fusion.shares[name])}" if used else ""
        put(self._tick, value=used, label=f"{self._title}{share}")
        self._set_visible(used)
        if used:
            r = fusion.tuning.r[at]
            self._r.show(frame, r, "0", *on_decades(r, *slider_limits(frame.state, "r", name)))
            self._offset.show(frame, fusion.tuning.offset[at], "0")

    def _on_tick(self) -> None:
        if self._fused and self.name is not None:  # else it only marks a channel for the button
            self._session.request(set_taking_part(self.name, self._tick.value))

    def _typed(self, what: str) -> Callable[[str, str], Change]:
        return lambda _name, text: set_sensor_text(self.name or "", what, text)

    def _moved(self, exponent: float) -> Change:
        return set_exponent("r", exponent, self.name or "")


# The closed folder "Fuse sensors": which channels measure one quantity, and what each of them contributes.


HOW = "Tick the channels that measure the same quantity. Their noise and offsets are found from the recording."

NO_REFERENCE = "none"

REFERENCE_HINT = "A sensor that reads correctly: its offset is 0. None: the offsets add up to 0."


class FusionView:
    """Tick boxes, one button, and a row of controls for each sensor. The estimate runs as a job."""

    def __init__(self, gui: viser.GuiApi, session: Session, jobs: Jobs) -> None:
        self._session, self._jobs = session, jobs
        self._stop = threading.Event()
        self._offered: tuple[str, ...] = ()
        with gui.add_folder("Fuse sensors", expand_by_default=False, visible=False) as self._folder:
            self._said = gui.add_markdown(HOW)
            with gui.add_form(None):  # boxes and sliders side by side
                self._rows = [SensorControl(gui, session, i) for i in range(MAX_SENSORS)]
            self._reference = gui.add_dropdown("reference", list[str]([NO_REFERENCE]), hint=REFERENCE_HINT)
            self._fuse = gui.add_button("Fuse", hint="Finds q, noise and offsets; Undo reverts it.")
            self._progress = gui.add_progress_bar(0.0, visible=False)
            self._cancel = gui.add_button("Cancel", visible=False, hint="Stop and change nothing.")
            self._end = gui.add_button("Stop fusing", visible=False, hint="Back to the channel; Undo reverts it.")
            self._notes = gui.add_markdown("", visible=False)
        on_user(self._fuse.on_click, lambda _client: self._start())
        on_user(self._cancel.on_click, lambda _client: self._stop.set())
        on_user(self._end.on_click, lambda _client: session.request(stop_fusing))

    def _start(self) -> None:
        sensors = tuple(row.name for row in self._rows if row.ticked and row.name is not None)
        reference = self._reference.value if self._reference.value in sensors else None
        stop = self._stop = threading.Event()
        self._jobs.run_with_state(
            self._session, lambda state: self._search(state, sensors, reference, stop), Failed.FUSE
        )

    def _search(self, state: State, sensors: tuple[str, ...], reference: str | None, stop: threading.Event) -> None:
        from kalscope.estimation.fusion import estimate_fusion

        columns, known = readings_of(state, sensors), studied(state)
        with SlowJobProgress(self._progress, self._cancel) as shown:
            found = estimate_fusion(
                known.recording.values[:, columns],
                dt=known.dt,
                names=sensors,
                reference=reference,
                progress=shown.report,
                cancelled=stop.is_set,
            )
        self._session.request(apply_estimate(state.recording, sensors, found), failed=Failed.FUSE)

    def show(self, frame: Frame) -> None:
        """Offer the channels of the quantity on screen, and follow what is fused."""
        state = frame.state
        names, fused = candidates(state), state.fusion is not None
        self._folder.visible = bool(names)
        if names != self._offered:
            self._offered = names
            for row, name in zip(self._rows, (*names, *(None,) * MAX_SENSORS), strict=False):
                row.offer(name)
            offer(self._reference, (NO_REFERENCE, *names), NO_REFERENCE)
        for row in self._rows:
            row.show(frame)
        put(self._fuse, label="Fuse again" if fused else "Fuse", visible=bool(names))
        put(self._end, visible=state.fused is not None)
        put(self._notes, visible=fused)
        if not fused:
            put(self._said, content=HOW)

    def show_judged(self, judged: object) -> None:
        """Show what the fused value is worth, and which sensor disagrees; any other answer is about one channel."""
        if isinstance(judged, Judged):
            put(self._said, content=reasons_of(judged))
            put(self._notes, content="\n\n".join(escape_markdown(one, 400) for one in judged.notes))
