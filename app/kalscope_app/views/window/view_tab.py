"""The View tab: the theme, and what is drawn beside the filtered signal."""

from __future__ import annotations

import viser

from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes.view import set_dark, set_smoother, set_velocity
from kalscope_app.session.session import Session
from kalscope_app.views.binding import bind


class ViewTab:
    """Three checkboxes; the map puts its own controls below them."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._dark = gui.add_checkbox("dark theme", False, hint="In every browser that shows this session.")
        self._smoother = gui.add_checkbox(
            "show smoother (offline bound)", False, hint="It also uses later samples, which a device cannot."
        )
        self._velocity = gui.add_checkbox(
            "show velocity", False, hint="In place of the gain, where the filter has momentum."
        )
        bind(self._dark, session, set_dark)
        bind(self._smoother, session, set_smoother)
        bind(self._velocity, session, set_velocity)

    def show(self, frame: Frame) -> None:
        """Follow the frame."""
        view = frame.state.view
        self._dark.value, self._smoother.value, self._velocity.value = view.dark, view.smoother, view.velocity
