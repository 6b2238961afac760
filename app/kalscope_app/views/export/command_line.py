"""The commands that reopen and filter what is open, to be copied into a terminal."""

from __future__ import annotations

import shlex
from collections.abc import Iterable

import viser

from kalscope_app.engine.frame import Frame
from kalscope_app.session.share import share_line
from kalscope_app.session.state import State
from kalscope_app.views.window.css import COMMAND


class CommandLineView:
    """A closed folder; what is typed into its box is overwritten."""

    def __init__(self, gui: viser.GuiApi) -> None:
        with gui.add_folder("Command line", expand_by_default=False):
            self._line = gui.add_text("reopen", "", multiline=True, hint="Click into it, press Ctrl+A and Ctrl+C.")
            self._text = gui.add_markdown("")

    def show(self, frame: Frame) -> None:
        """Write the lines."""
        shared = share_line(frame.state)
        self._line.value = shared.line
        self._text.content = "\n\n".join(filter(None, (" ".join(shared.remarks), with_tuning_file(frame.state))))


def with_tuning_file(state: State) -> str:
    """What to type once the tuning file is saved, as markdown."""
    source, live = state.recording.source, state.live is not None
    file = "FILE" if live else shell_word(source)
    reopen = ("open", *(() if source else ("FILE",)), "--config", "tuning.toml")
    run = ("filter", file, "--config", "tuning.toml", "-o", "out.csv")
    text = f"With the saved tuning file:\n\n{_command(reopen)}\n\n{_command(run)}"
    if live:
        return text + "\n\nReplace FILE with the path of a recording of the board."
    return text


def _command(words: Iterable[str]) -> str:
    """A line for a terminal, as markdown; each word is marked up alone, so that no option breaks after its "-"."""
    return COMMAND + " ".join(f"`{word}`" for word in ("kalscope", *words))


def shell_word(source: str) -> str:
    """The source as one word of a command line; FILE where it cannot be shown in a line of code."""
    printable = source.isprintable() and "`" not in source and len(source) <= 200
    return shlex.quote(source) if source and printable else "FILE"
