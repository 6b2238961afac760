"""The closed folder "Fuse sensors": which channels measure one quantity, and each of these sensors."""

from __future__ import annotations

from functools import partial

import viser

from kalscope.common.text import one_line, percent
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session import changes
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import MAX_SENSORS, Change, State
from kalscope_app.studies.checks import Judged
from kalscope_app.views.checks import reasons_of
from kalscope_app.views.widgets import SlowJob, TypedNumber, add_button, escape_markdown, offer, on_user, put

# One of the sensors that are fused: whether it takes part, its noise, its offset, and its share.


MAX_NAME = 24
"""Characters of a sensor's name."""

BOXES = {
    "r": ("noise r", "How noisy this sensor is: the variance of one reading. Larger gives it a smaller share."),
    "offset": ("offset", "How much higher this sensor reads than the others. It is subtracted."),
}
"""Label and hint of the box for each number of a sensor."""


class SensorControl:
    """A tick box with the name; below it, once sensors are fused, noise, share and offset."""

    def __init__(self, gui: viser.GuiApi, session: Session, number: int) -> None:
        """Args: the usual; which row this is."""
        self._session = session
        self.name: str | None = None
        self._fused = False
        self._tick = gui.add_checkbox("", False, visible=False, hint="Whether this sensor takes part.")

        def box(what: str) -> TypedNumber:
            def change(_name: str, text: str) -> Change:
                return changes.set_sensor_text(self.name or "", what, text)

            return TypedNumber(gui, session, f"{what} of sensor {number}", *BOXES[what], change)

        self._boxes = {what: box(what) for what in BOXES}
        on_user(self._tick.on_update, lambda _client: self._on_tick())

    @property
    def ticked(self) -> bool:
        """Whether its sensor is to take part."""
        return self.name is not None and self._tick.value

    def offer(self, name: str | None) -> None:
        """Represent this channel, not ticked; None: no channel."""
        self.name = name
        put(self._tick, visible=name is not None, value=False)

    def show(self, frame: Frame) -> None:
        """Follow the frame; a channel that is not fused has its tick box alone."""
        fusion, name, share, used = frame.state.fusion, self.name or "", "", False
        self._fused = fusion is not None and name in fusion.tuning.sensors
        if fusion is not None and self._fused:
            used = name not in fusion.dropped
            put(self._tick, value=used)
            share = f": share {percent(fusion.shares[name])}" if used else ""
        put(self._tick, label=f"{one_line(name)[:MAX_NAME]}{share}")
        for what, box in self._boxes.items():
            numbers = dict(zip(fusion.tuning.sensors, getattr(fusion.tuning, what), strict=True)) if fusion else {}
            box.show(frame, numbers.get(name), "0", visible=used)

    def _on_tick(self) -> None:
        if self._fused and self.name is not None:  # else it only marks a channel for the button
            self._session.request(changes.set_taking_part(self.name, self._tick.value))


# The closed folder "Fuse sensors": which channels measure one quantity, and what each of them contributes.


HOW = "Tick the channels that measure the same quantity. Their noise and offsets are found from the recording."

NO_REFERENCE = "none"

REFERENCE_HINT = "A sensor that reads correctly: its offset is 0. None: the offsets add up to 0."


class FusionView:
    """Tick boxes, one button, and a row of controls for each sensor. The estimate runs as a job."""

    def __init__(self, gui: viser.GuiApi, session: Session, jobs: Jobs) -> None:
        self._session, self._jobs = session, jobs
        self._offered: tuple[str, ...] = ()
        with gui.add_folder("Fuse sensors", expand_by_default=False, visible=False) as self._folder:
            self._said = gui.add_markdown(HOW)
            self._rows = [SensorControl(gui, session, i) for i in range(MAX_SENSORS)]
            self._reference = gui.add_dropdown("reference", list[str]([NO_REFERENCE]), hint=REFERENCE_HINT)
            self._fuse = add_button(gui, "Fuse", "Finds q, noise and offsets; Undo reverts it.", self._start)
            self._running = SlowJob(gui, "Stop and change nothing.")
            hint = "Back to the channel; Undo reverts it."
            end = partial(session.request, changes.stop_fusing)
            self._end = add_button(gui, "Stop fusing", hint, lambda _client: end(), visible=False)
            self._notes = gui.add_markdown("", visible=False)

    def _start(self, _client: viser.ClientHandle) -> None:
        sensors = tuple(row.name for row in self._rows if row.name is not None and row.ticked)
        reference = self._reference.value if self._reference.value in sensors else None
        work = partial(self._search, sensors=sensors, reference=reference)
        self._jobs.run_with_state(self._session, work, Failed.FUSE)

    def _search(self, state: State, sensors: tuple[str, ...], reference: str | None) -> None:
        from kalscope.estimation.fusion import estimate_fusion

        columns, known = changes.readings_of(state, sensors), changes.studied(state)
        with self._running as progress:
            found = estimate_fusion(
                known.recording.values[:, columns],
                dt=known.dt,
                names=sensors,
                reference=reference,
                progress=progress,
            )
        self._session.request(changes.apply_estimate(state.recording, sensors, found), failed=Failed.FUSE)

    def show(self, frame: Frame) -> None:
        """Offer the channels of the quantity on screen, and follow what is fused."""
        state = frame.state
        names, fused = changes.candidates(state), state.fusion is not None
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
