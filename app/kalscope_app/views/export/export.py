"""Leaving with the result: the tuning file, saved or downloaded, and the filtered signal as CSV."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable
from pathlib import Path

import viser

from kalscope.common.files import check_inside
from kalscope.errors import BadSetting
from kalscope.export.filtered_csv import filtered_csv
from kalscope.tuning.tuning import dumps, save_tuning
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import State
from kalscope_app.views.binding import on_user
from kalscope_app.views.window.css import COMMAND


class ExportView:
    """The Export tab. Files are made as jobs from the state on screen."""

    def __init__(
        self, gui: viser.GuiApi, session: Session, jobs: Jobs, tell: Callable[..., None], folder: Path
    ) -> None:
        self._session, self._jobs, self._tell, self._folder = session, jobs, tell, folder
        with gui.add_folder("Tuning file and data"):
            self._path = gui.add_text(
                "tuning file", "tuning.toml", hint="A file name in the folder in which Kalscope was started."
            )
            self._save = gui.add_button(
                "Save tuning file", hint="q, r, momentum, p0 and x0 of every channel, and the source."
            )
            self._download = gui.add_button("Download tuning file", hint="The same file, as a download.")
            self._csv = gui.add_button(
                "Download filtered CSV", hint="Time, raw, filtered and variance of every channel."
            )
            self._how = gui.add_markdown("")
        on_user(self._save.on_click, lambda _client: self._ask_to_save())
        for button, name in ((self._download, "tuning.toml"), (self._csv, "filtered.csv")):
            on_user(
                button.on_click,
                lambda client, name=name: jobs.run_with_state(
                    session, lambda state: _send(state, client, name), Failed.SAVE
                ),
            )

    def _ask_to_save(self) -> None:
        name = self._path.value.strip() or "tuning.toml"
        self._jobs.run_with_state(self._session, lambda state: self._save_to(state, name), Failed.SAVE)

    def _save_to(self, state: State, name: str) -> None:
        path = check_inside(name, self._folder)
        if path.suffix != ".toml" or any(part.startswith(".") for part in Path(name).parts if part != "."):
            raise BadSetting(f"the tuning file must be named like tuning.toml (got {name!r})")
        state.require_standard_filter(state.recording.names)
        save_tuning(state.as_tuning(), path)
        self._tell(f"Saved {path}", good=True)

    def show(self, frame: Frame) -> None:
        """Say how to use the file."""
        self._how.content = how_to_use(frame.state)


def how_to_use(state: State) -> str:
    """What to type with the tuning file, as markdown."""
    source, live = state.recording.source, state.live is not None
    file = "FILE" if live else shell_word(source)
    reopen = ("open", *(() if source else ("FILE",)), "--config", "tuning.toml")
    run = ("filter", file, "--config", "tuning.toml", "-o", "out.csv")
    text = f"Reopen this session:\n\n{_command(reopen)}\n\nFilter from the command line:\n\n{_command(run)}"
    if live:
        return text + "\n\nReplace FILE with the path of a recording of the board."
    return text if source else text + "\n\nReplace FILE with the path of the file you uploaded."


def _command(words: Iterable[str]) -> str:
    """A line for a terminal, as markdown; each word a piece of its own: no option breaks after its "-"."""
    return COMMAND + " ".join(f"`{word}`" for word in ("kalscope", *words))


def _send(state: State, client: viser.ClientHandle, name: str) -> None:
    state.require_standard_filter(state.recording.names)
    tuning = state.as_tuning()
    content = dumps(tuning) if name == "tuning.toml" else filtered_csv(state.recording, tuning)
    client.send_file_download(name, content.encode(), save_immediately=True)


def shell_word(source: str) -> str:
    """The source as one word of a command line; FILE where it could not stand in a line of code."""
    printable = source.isprintable() and "`" not in source and len(source) <= 200
    return shlex.quote(source) if source and printable else "FILE"
