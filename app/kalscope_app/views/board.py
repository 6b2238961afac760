"""The folders of the Export tab for a board that runs the exported filter: settings, measured noise."""

from __future__ import annotations

import time
from collections.abc import Callable

import viser

from kalscope.common.text import count, duration, number, typed_number
from kalscope.export.board import Calibrated, measured_text, set_kept
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.live import BoardConnection, measured_by_board, send_setting, takes_no_values
from kalscope_app.session import changes
from kalscope_app.session.changes import set_sent
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import BoardCalibration, Sent, State
from kalscope_app.studies.checks import compare_with_board
from kalscope_app.views.widgets import SlowJob, add_button, capitalised, escape_markdown, put

Tell = Callable[..., None]
"""Shows a sentence; `good`: not an error; `failed`: its heading."""

# The folder "Noise measured by the board" of the Export tab, for a board that runs the exported sketch.


KEEP, FORGET = "Keep on the board", "Forget what the board keeps"
MAX_SHOWN = 1000
"""Characters of a board's answer that are shown."""


class CalibrationView:
    """Measures in a job queue of its own; the result is filed in the session."""

    def __init__(self, gui: viser.GuiApi, session: Session, tell: Tell, connection: BoardConnection) -> None:
        self._session, self._tell, self._connection = session, tell, connection
        self._jobs = Jobs(tell)  # a measurement takes minutes: no search should wait for it
        self._ended = 0.0
        self._running: float | None = None  # length of the running measurement, s
        with gui.add_folder("Noise measured by the board", visible=False) as self._folder:
            hint = "Keep what the sensor measures constant for this long."
            self._seconds = gui.add_text("measure for (s)", "10", hint=hint)
            hint = "It then uses that r, and the q that keeps the lag of its export. Its filter keeps running."
            self._start = add_button(gui, "Let the board measure r", hint, self._on_start)
            self._measuring = SlowJob(gui, "The board keeps its values.")
            self._text = gui.add_markdown("", visible=False)

            hint = "In the tuning of this channel. Undo reverts it."
            self._use = add_button(gui, "Use its r and q here", hint, self._on_use, visible=False)
            hint = "In its EEPROM, for all channels: otherwise a reset restores those of the export."
            self._keep = add_button(gui, KEEP, hint, self._on_keep, visible=False)

    def _on_use(self, _client: viser.ClientHandle) -> None:
        self._session.request(changes.use_calibration)

    def _on_keep(self, _client: viser.ClientHandle) -> None:
        self._jobs.run_with_state(self._session, self._keep_or_forget, Failed.KEEP)

    def _on_start(self, _client: viser.ClientHandle) -> None:
        clicked = time.monotonic()

        def work(state: State) -> None:
            if clicked > self._ended:  # a second click during a measurement does not start another
                self._measure(state)

        self._jobs.run_with_state(self._session, work, Failed.MEASURE)

    def _measure(self, state: State) -> None:
        source = self._connection.source_of(state)
        seconds = typed_number("the time to measure for", self._seconds.value)
        self._running = seconds
        self._session.request(changes.set_calibration(None))  # its frame says that it measures
        try:
            with self._measuring as progress:
                measured = measured_by_board(state, source, seconds, progress)
        finally:
            self._ended, self._running = time.monotonic(), None
            self._session.request(lambda state: state)  # and the frame of this one hides it
        self._session.request(changes.set_calibration(measured))
        good = measured.values is not None
        self._tell(text_of(measured, state.tuning.unit), good=good, failed=Failed.MEASURE)

    def _keep_or_forget(self, state: State) -> None:
        kept = not (state.calibration is not None and state.calibration.kept)
        set_kept(self._connection.source_of(state), kept=kept)
        self._session.request(changes.set_kept(kept))
        starts = "these values" if kept else "the values of its export"
        self._tell(f"The board uses {starts} from its next start.", good=True)

    def show(self, frame: Frame) -> None:
        """Only a live board can measure, and only the noise of one channel."""
        state = frame.state
        put(self._folder, visible=state.live is not None and state.fusion is None)
        running, known = self._running, changes.calibration_here(state)
        for shown in self._seconds, self._start:
            put(shown, visible=running is None)
        if running is not None:
            text = f"Measuring for {duration(running)}: keep what the sensor measures constant."
        else:
            text = "" if known is None else text_of(known, state.tuning.unit)
        unbroken = text.replace(" = ", "\xa0=\xa0")  # no line break at an equals sign
        put(self._text, content=escape_markdown(unbroken, MAX_SHOWN), visible=bool(text))
        values = None if running is not None or known is None else known.values
        tuned = {"q": state.tuning.q, "r": state.tuning.r}
        put(self._use, visible=values is not None and values.parameters != tuned)
        kept = known is not None and known.kept
        put(self._keep, visible=values is not None, label=FORGET if kept else KEEP)


def text_of(calibration: BoardCalibration, unit: str) -> str:
    """The result of a measurement, in a sentence or two."""
    found = calibration.found
    if found is None:
        return f"{capitalised(calibration.failed)}."
    return f"{'The board measured ' * isinstance(found.answer, Calibrated)}{measured_text(found, unit)}"


# The folder "Send to the board" of the Export tab: the present setting into the board that is connected.


HOW = (
    "Works with the exported Arduino sketch. Its filter restarts with these values; the initial estimate and the "
    "outlier gate remain those of the export."
)


class BoardView:
    """Sends as a job; what the board answered is filed in the session, the comparison is a study."""

    def __init__(
        self, gui: viser.GuiApi, session: Session, jobs: Jobs, tell: Tell, connection: BoardConnection
    ) -> None:
        self._session, self._jobs, self._tell, self._connection = session, jobs, tell, connection
        with gui.add_folder("Send to the board", visible=False) as self._folder:
            self._how = gui.add_markdown(HOW)
            hint = "And the momentum, where the sketch has it. The board confirms each value."
            self._button = add_button(gui, "Send q, r and p0", hint, self._on_send)
            self._text = gui.add_markdown("")
        self._calibration = CalibrationView(gui, session, tell, connection)

    def _on_send(self, _client: viser.ClientHandle) -> None:
        self._jobs.run_with_state(self._session, self._send, Failed.SEND)

    def _send(self, state: State) -> None:
        source = self._connection.source_of(state)
        self._session.request(set_sent(None))  # of three values some may arrive and some not
        sent = send_setting(state, source)
        self._session.request(set_sent(sent))
        self._tell(f"The board now uses {values(sent)}", good=True)

    def show(self, frame: Frame) -> None:
        """Only a live board can be sent to, and only the filter of one channel."""
        self._calibration.show(frame)
        self._folder.visible = frame.state.live is not None
        why = takes_no_values(frame.state)
        self._button.visible = self._text.visible = not why
        self._how.content = f"{capitalised(why)}." if why else HOW

    def show_check(self, text: str) -> None:
        """Show how the board's curve compares."""
        self._text.content = text


def compared(state: State) -> str:
    """How the board's rows compare with ours since it took a setting, as markdown; "" where there are none."""
    check, sent = compare_with_board(state), state.sent
    if sent is None or check is None or check.rows == 0:
        return ""
    since = f"since the board took {values(sent)}"
    if check.different == 0:
        text = f"**Equal bit for bit** in {count(check.rows)} rows {since}."
    else:
        text = (
            f"{count(check.different)} of {count(check.rows)} rows differ {since}, by up to "
            f"{number(check.largest)}. A board that was reset uses the exported values again: send again."
        )
    chain = state.tuning.chain
    if state.params != sent.asked or sent.params.median != (1 if chain is None else chain.median):
        text += " The current values have not been sent."
    return text


def values(sent: Sent) -> str:
    """What a board uses."""
    used = {name: float(getattr(sent.params, name)) for name in ("q", "r", "p0")}
    if sent.params.momentum is not None:
        used["momentum"] = float(sent.params.momentum.momentum)
    return ", ".join(f"{name} = {value:.6g}" for name, value in used.items())
