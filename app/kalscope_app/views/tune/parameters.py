"""q, r and p0 of the channel on screen, its momentum where it has one, and the row Pin, Undo, Redo, Reset."""

from __future__ import annotations

import viser

from kalscope_app.engine.frame import Frame
from kalscope_app.session.changes.parameters import reset_parameters
from kalscope_app.session.changes.variants import pin_present
from kalscope_app.session.session import Session, redo, undo
from kalscope_app.views.binding import on_user
from kalscope_app.views.tune.controls.momentum import MomentumControl
from kalscope_app.views.tune.controls.variance import VarianceControl

STEPS = {"Pin": pin_present, "Undo": undo, "Redo": redo, "Reset": reset_parameters}
"""The row of small buttons."""


class ParametersView:
    """A text box and a slider for each parameter. Callbacks only file requests."""

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        with gui.add_folder(None):  # indented as the goal above
            self._controls = [VarianceControl(gui, session, name) for name in ("q", "r", "p0")]
            _, self._r, _ = self._controls  # each sensor has its own where several are fused
            self._momentum = MomentumControl(gui, session)
            self._steps = gui.add_button_group(
                "",
                tuple(STEPS),
                hint="Pin: keep this setting as A, B, C … in the Compare tab. Reset: r = var(Δz)/2, q = r/100; "
                "for fused sensors, the values found.",
            )
        on_user(self._steps.on_click, lambda _client: session.request(STEPS[self._steps.value]))
        for command, change in (
            (gui.add_command("Undo", hotkey="Z", modifier="cmd/ctrl"), undo),
            (gui.add_command("Redo", hotkey="Z", modifier="cmd/ctrl+shift"), redo),
            (gui.add_command("Redo (Ctrl+Y)", hotkey="Y", modifier="cmd/ctrl"), redo),
        ):
            on_user(command.on_trigger, lambda _client, change=change: session.request(change))

    def show(self, frame: Frame) -> None:
        """Set every control to the frame's values, except those that have changed since."""
        used = frame.state.uses_parameters
        for control in self._controls:
            control.show(frame)
            control.set_visible(used and (control is not self._r or frame.state.fusion is None))
        self._momentum.show(frame)
