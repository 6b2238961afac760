"""Code for a device: choose a target, look at its files, take them along."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import viser

from kalscope.atomic import check_inside
from kalscope.errors import BadSetting
from kalscope.export import TARGETS, export_tuning
from kalscope.export.device_limits import device_limits
from kalscope.export_command import write_files
from kalscope_app.frame import Frame
from kalscope_app.jobs import Jobs
from kalscope_app.session import Session
from kalscope_app.state import State
from kalscope_app.views.words import plain

THIS, ALL = "this channel", "all channels"


class CodeView:
    """The folder "Code for a device" of the Export tab. Files are made as jobs from the state on screen."""

    def __init__(
        self, gui: viser.GuiApi, session: Session, jobs: Jobs, tell: Callable[..., None], folder: Path
    ) -> None:
        self._session, self._jobs, self._tell, self._folder = session, jobs, tell, folder
        with gui.add_folder("Code for a device"):
            self._target = gui.add_dropdown("for", tuple(TARGETS), hint="Where the filter is to run.")
            self._what = gui.add_markdown(TARGETS["arduino"].what)
            self._limits = gui.add_markdown("", visible=False)
            self._channels = gui.add_dropdown("filters", (THIS, ALL), hint="What the files hold.")
            self._vectors = gui.add_checkbox(
                "with test vectors",
                False,
                hint="groundtruth.csv: the first samples of this recording and what the filter makes of them.",
            )
            look = gui.add_button("Look and copy", hint="Shows the files; click into one, Ctrl+A, Ctrl+C.")
            self._name = gui.add_text(
                "folder", "export", hint="A new folder inside the one in which Kalscope was started."
            )
            save = gui.add_button("Save to the folder", hint="Files that are there already are not replaced.")
            download = gui.add_button("Download", hint="One file, or a zip of all.")
        self._target.on_update(self._on_target)
        look.on_click(self._on_look)
        save.on_click(self._on_save)
        download.on_click(self._on_download)

    async def _on_target(self, _event: viser.GuiEvent[Any]) -> None:
        target = TARGETS.get(self._target.value)
        self._what.content = "" if target is None else target.what

    async def _on_look(self, event: viser.GuiEvent[Any]) -> None:
        client = event.client
        if client is not None:
            self._with_files(lambda _target, files: show_files(client, files))

    async def _on_save(self, _event: viser.GuiEvent[Any]) -> None:
        name = self._name.value.strip()

        def save(_target: str, files: dict[str, str]) -> None:
            folder = check_inside(name, self._folder)
            if folder == self._folder.resolve() or any(part.startswith(".") for part in Path(name).parts):
                raise BadSetting(f"the folder must be named like export (got {name!r})")
            written = write_files(files, folder)
            self._tell(f"Saved {', '.join(path.name for path in written)} in {folder}", good=True)

        self._with_files(save)

    async def _on_download(self, event: viser.GuiEvent[Any]) -> None:
        client = event.client
        if client is not None:
            self._with_files(lambda target, files: send_files(client, target, files))

    def _with_files(self, use: Callable[[str, dict[str, str]], None]) -> None:
        """Make the files of the state on screen, as a job, and hand them on."""
        target, all_channels, vectors = self._target.value, self._channels.value == ALL, self._vectors.value

        def work(state: State) -> None:
            use(target, files_of(state, target, all_channels=all_channels, vectors=vectors))

        self._session.ask(lambda state: self._jobs.run(lambda: work(state)))

    def show(self, frame: Frame) -> None:
        """One channel leaves no choice."""
        several = len(frame.state.recording.names) > 1
        if self._channels.visible != several:
            self._channels.visible = several

    def show_limits(self, text: str) -> None:
        """What differs on a small board."""
        if self._limits.content != text:
            self._limits.content = text
            self._limits.visible = bool(text)


def limits_text(state: State) -> str:
    """What differs on a small board, as markdown, for the channel on screen; "" where nothing does. A study."""
    if state.rule is not None:
        return ""
    z = state.recording.channel(state.channel)
    level = float(np.abs(z[np.isfinite(z)]).max(initial=0.0)) or 1.0
    limits = device_limits(state.params, level=level, sample_period=state.recording.sample_period)
    return "\n".join(f"- On a small board: {plain(limit.message, 400)}" for limit in limits)


def files_of(state: State, target: str, *, all_channels: bool, vectors: bool) -> dict[str, str]:
    """The files of a target for what is on screen, by name."""
    channel = None if all_channels else state.channel
    return export_tuning(state.as_tuning(), target, channel=channel, vectors=state.recording if vectors else None)


def show_files(client: viser.ClientHandle, files: dict[str, str]) -> None:
    """A window with every file in a text box of its own: plain text, so nothing in it can act."""
    with client.gui.add_modal("Files to copy") as modal:
        for name, text in files.items():
            client.gui.add_text(name, text, multiline=True, hint="Click into it, then Ctrl+A and Ctrl+C.")
        close = client.gui.add_button("Close")
        close.on_click(lambda _event: modal.close())


def send_files(client: viser.ClientHandle, target: str, files: dict[str, str]) -> None:
    """One file as it is, several as a zip."""
    name, content = packed(target, files)
    client.send_file_download(name, content, save_immediately=True)


def packed(target: str, files: dict[str, str]) -> tuple[str, bytes]:
    """Name and bytes of one download that holds all files."""
    if len(files) == 1:
        name, text = next(iter(files.items()))
        return name, text.encode()
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in files.items():
            archive.writestr(zipfile.ZipInfo(name, (2000, 1, 1, 0, 0, 0)), text)
    return f"kalscope-{re.sub(r'[^a-z0-9]+', '-', target)}.zip", buffer.getvalue()
