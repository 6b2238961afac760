"""The tuning file: saved, downloaded, and loaded onto what is open."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import viser

from kalscope.common.files import check_inside
from kalscope.errors import BadSetting
from kalscope.tuning.tuning import Tuning
from kalscope.tuning.tuning_file import dumps, load_tuning, save_tuning
from kalscope_app.engine.jobs import Jobs
from kalscope_app.guard.viser_private import take_upload
from kalscope_app.session.changes.settings_file import ENDING, uploaded_settings, use_settings
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import State
from kalscope_app.views.binding import on_user
from kalscope_app.views.export.files import ask_to_overwrite

DEFAULT_NAME = f"tuning{ENDING}"


class TuningFileView:
    """The folder "Tuning file" of the Export tab. Files are written and read as jobs."""

    def __init__(
        self, gui: viser.GuiApi, session: Session, jobs: Jobs, tell: Callable[..., None], folder: Path
    ) -> None:
        self._session, self._jobs, self._tell, self._folder = session, jobs, tell, folder
        self._building = threading.Lock()
        self._ours = set[Path]()  # files saved or loaded here: saving again asks nothing
        with gui.add_folder("Tuning file") as self._widgets:
            self._path = gui.add_text(
                "tuning file", DEFAULT_NAME, hint="A file name in the folder in which Kalscope was started."
            )
            save = gui.add_button("Save tuning file", hint="q, r, momentum, p0 and x0 of every channel.")
            load = gui.add_button("Load tuning file", hint="Its values for the open recording; Undo reverts it.")
            download = gui.add_button("Download tuning file", hint="The same file, as a download.")
        on_user(save.on_click, self._ask_to_save)
        on_user(load.on_click, lambda _client: self._ask_to_load())
        on_user(
            download.on_click,
            lambda client: jobs.run_with_state(session, lambda state: _send(state, client), Failed.SAVE),
        )

    def add_upload(self, client: viser.ClientHandle) -> None:
        """Give one browser its own upload button: a shared one would replay each upload to new browsers."""
        with self._building, self._widgets:  # two browsers may come at once, and viser enters a folder only once
            button = client.gui.add_upload_button(
                "Upload tuning file …", mime_type=ENDING, hint="Loads a tuning file of this computer."
            )

        def take(_event: viser.GuiEvent[Any]) -> None:
            upload = take_upload(button)
            self._jobs.run(lambda: self._upload(upload.name, upload.content), Failed.OPEN)

        button.on_upload(take)

    def _upload(self, name: str, content: bytes) -> None:
        self._session.request(use_settings(uploaded_settings(name, content), name), failed=Failed.OPEN)

    @property
    def _name(self) -> str:
        return self._path.value.strip() or DEFAULT_NAME

    def _checked(self, name: str) -> Path:
        """The path inside the folder of Kalscope; BadSetting where it is outside or not that of a tuning file."""
        path = check_inside(name, self._folder)
        if path.suffix != ENDING or any(part.startswith(".") for part in Path(name).parts if part != "."):
            raise BadSetting(f"the tuning file must be named like {DEFAULT_NAME} (got {name!r})")
        return path

    def _ask_to_load(self) -> None:
        name = self._name
        self._jobs.run(lambda: self._load(name), Failed.OPEN)

    def _load(self, name: str) -> None:
        path = self._checked(name)
        tuning = load_tuning(path)
        self._ours.add(path)
        self._session.request(use_settings(tuning, name), failed=Failed.OPEN)

    def _ask_to_save(self, client: viser.ClientHandle) -> None:
        name = self._name

        def save(state: State) -> None:
            path = self._checked(name)
            state.require_exportable(state.recording.names)
            write = partial(self._write, state.as_tuning(), path)
            if path.exists() and path not in self._ours:
                place = self._folder.resolve().name
                ask_to_overwrite(client, place, [name], lambda: self._jobs.run(write, Failed.SAVE), "name")
            else:
                write()

        self._jobs.run_with_state(self._session, save, Failed.SAVE)

    def _write(self, tuning: Tuning, path: Path) -> None:
        save_tuning(tuning, path)
        self._ours.add(path)
        self._tell(f"Saved {path}", good=True)


def _send(state: State, client: viser.ClientHandle) -> None:
    state.require_exportable(state.recording.names)
    client.send_file_download(DEFAULT_NAME, dumps(state.as_tuning()).encode(), save_immediately=True)
