"""The closed folder "Fuse sensors": which channels measure one quantity, and what each of them contributes."""

from __future__ import annotations

import threading

import viser

from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.changes.fusion import apply_estimate, candidates, readings_of, stop_fusing
from kalscope_app.session.changes.live import studied
from kalscope_app.session.fusion import MAX_SENSORS
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import State
from kalscope_app.studies.fusion import Judged
from kalscope_app.views.binding import offer, on_user, put
from kalscope_app.views.markdown import escape_markdown
from kalscope_app.views.slow_job import SlowJobProgress
from kalscope_app.views.tune.controls.sensor import SensorControl
from kalscope_app.views.tune.verdict import reasons_of

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
        from kalscope.estimation.fusion.estimate_fusion import estimate_fusion

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
        put(self._end, visible=state.settings.fusion is not None)
        put(self._notes, visible=fused)
        if not fused:
            put(self._said, content=HOW)

    def show_judged(self, judged: object) -> None:
        """Show what the fused value is worth, and which sensor disagrees; any other answer is about one channel."""
        if isinstance(judged, Judged):
            put(self._said, content=reasons_of(judged))
            put(self._notes, content="\n\n".join(escape_markdown(one, 400) for one in judged.notes))
