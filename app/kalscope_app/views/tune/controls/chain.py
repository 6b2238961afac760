"""What is shown in place of the goal while a chain of filters runs: what q and r do then, and a way back."""

from __future__ import annotations

import viser

from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes.chain import use_kalman_filter
from kalscope_app.session.session import Session
from kalscope_app.views.binding import on_user

CLASSIC = "This filter has no q and r; those of the Kalman filter are kept."
BEHIND_MEDIAN = (
    "q and r act on what the median leaves. The search for them and the tests are for the Kalman filter alone: "
    "a median makes neighbouring errors correlated."
)


class ChainView:
    """The upper part of the Tune tab while a chain runs."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        with gui.add_folder(None, visible=False) as self._folder:
            self._said = gui.add_markdown("")
            back = gui.add_button("Back to the Kalman filter", hint="At the q and r that it had; Undo reverts it.")
        on_user(back.on_click, lambda _client: session.request(use_kalman_filter))

    def show(self, frame: Frame) -> None:
        """Follow the frame."""
        chain = frame.state.tuning.chain
        self._folder.visible = chain is not None
        if chain is not None:
            self._said.content = BEHIND_MEDIAN if chain.then is None else CLASSIC
