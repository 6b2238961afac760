"""Share: the command that reopens file, channel and setting, to be copied."""

from __future__ import annotations

import viser

from kalscope_app.engine.frame import Frame
from kalscope_app.session.share import share_line


class ShareView:
    """A box with the command; what is typed into it is overwritten."""

    def __init__(self, gui: viser.GuiApi) -> None:
        with gui.add_folder("Share in one line"):
            self._line = gui.add_text(
                "command",
                "",
                multiline=True,
                hint="Click into it, press Ctrl+A and Ctrl+C; run it in a terminal.",
            )
            self._remarks = gui.add_markdown("")

    def show(self, frame: Frame) -> None:
        """Write the line."""
        shared = share_line(frame.state)
        self._line.value = shared.line
        self._remarks.content = " ".join(("It reopens this file, channel and setting.", *shared.remarks))
