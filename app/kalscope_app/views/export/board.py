"""The folder "Send to the board" of the Export tab: the present setting into the board that is connected."""

from __future__ import annotations

from collections.abc import Callable

import viser

from kalscope.common.text import count, number
from kalscope.export.float32 import float32_params
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.live.connection import BoardConnection
from kalscope_app.live.sending import send_setting, takes_no_values
from kalscope_app.session.changes.live import set_sent
from kalscope_app.session.live_state import Sent
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import State
from kalscope_app.studies.board import compare_with_board
from kalscope_app.views.binding import on_user
from kalscope_app.views.export.calibration import CalibrationView
from kalscope_app.views.markdown import capitalised

HOW = (
    "Works with the exported Arduino sketch. Its filter restarts with these values; the initial estimate and the "
    "outlier gate remain those of the export."
)


class BoardView:
    """Sends as a job; what the board answered is filed in the session, the comparison is a study."""

    def __init__(
        self,
        gui: viser.GuiApi,
        session: Session,
        jobs: Jobs,
        tell: Callable[..., None],
        connection: BoardConnection,
    ) -> None:
        self._session, self._tell, self._connection = session, tell, connection
        with gui.add_folder("Send to the board", visible=False) as self._folder:
            self._how = gui.add_markdown(HOW)
            self._button = gui.add_button(
                "Send q, r and p0", hint="And the momentum, where the sketch has it. The board confirms each value."
            )
            self._text = gui.add_markdown("")
        self._calibration = CalibrationView(gui, session, tell, connection)
        on_user(self._button.on_click, lambda _client: jobs.run_with_state(session, self._send, Failed.SEND))

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
            f"{count(check.largest_steps)} steps of float32 ({number(check.largest)}). A board that was reset uses "
            "the exported values again: send again."
        )
    if float32_params(sent.asked).settled_gain > 0.0:
        text += " The board's gain stays larger than on screen: only the exported code can use so small a q/r."
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
