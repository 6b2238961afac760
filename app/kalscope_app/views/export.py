"""Leaving with the result: the tuning file, saved or downloaded, and the filtered signal as CSV."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import viser

from kalscope.atomic import check_inside
from kalscope.sources.csv_writer import filtered_csv
from kalscope.tuning import dumps, save_tuning
from kalscope_app.frame import Frame
from kalscope_app.jobs import Jobs
from kalscope_app.state import State


class ExportView:
    """The Export tab. Files are made as jobs from the state on screen."""

    def __init__(self, gui: viser.GuiApi, jobs: Jobs, tell: Any, folder: Path) -> None:
        self._jobs, self._tell, self._folder = jobs, tell, folder
        self._state: State | None = None
        self._path = gui.add_text(
            "tuning file", "tuning.toml", hint="A name inside the folder in which Kalscope was started."
        )
        self._save = gui.add_button("Save tuning file", hint="q, r, p0 and x0 of every channel, with the source.")
        self._download = gui.add_button("Download tuning file")
        self._csv = gui.add_button(
            "Download filtered CSV", hint="Time, raw, filtered and variance of every channel."
        )
        self._how = gui.add_markdown("")
        self._save.on_click(self._on_save)
        self._download.on_click(self._on_download)
        self._csv.on_click(self._on_csv)

    async def _on_save(self, _event: viser.GuiEvent[Any]) -> None:
        state, name = self._state, self._path.value.strip()
        if state is not None:
            self._jobs.run(lambda: self._save_to(state, name))

    def _save_to(self, state: State, name: str) -> None:
        path = check_inside(name or "tuning.toml", self._folder)
        save_tuning(state.as_tuning(), path)
        self._tell(f"Saved {path}", good=True)

    async def _on_download(self, event: viser.GuiEvent[Any]) -> None:
        state, client = self._state, event.client
        if state is not None and client is not None:
            content = dumps(state.as_tuning()).encode()
            self._jobs.run(lambda: client.send_file_download("tuning.toml", content, save_immediately=True))

    async def _on_csv(self, event: viser.GuiEvent[Any]) -> None:
        state, client = self._state, event.client
        if state is not None and client is not None:
            self._jobs.run(lambda: self._send_csv(state, client))

    def _send_csv(self, state: State, client: viser.ClientHandle) -> None:
        content = filtered_csv(state.recording, state.as_tuning()).encode()
        client.send_file_download("filtered.csv", content, save_immediately=True)

    def show(self, frame: Frame) -> None:
        """Keep the state to export, and say how to use the file."""
        self._state = frame.state
        source = frame.state.recording.source or frame.state.recording.title
        text = (
            "The file reopens this very state:\n\n"
            "`kalscope open --config tuning.toml`\n\n"
            "and filters without a dashboard:\n\n"
            f"`kalscope filter {shell_word(source)} --config tuning.toml -o out.csv`"
        )
        if self._how.content != text:
            self._how.content = text


def shell_word(source: str) -> str:
    """The source as one word of a command line; FILE where it could not stand in a line of code."""
    printable = source.isprintable() and "`" not in source and len(source) <= 200
    return shlex.quote(source) if source and printable else "FILE"
