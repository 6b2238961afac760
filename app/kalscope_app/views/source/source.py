"""The source of the signal: a file, uploaded or by its path; the generator; and how the file was read."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import viser
from numpy.typing import NDArray

from kalscope.catalogue import open_source
from kalscope.common.files import temporary_folder
from kalscope.common.progress import OnProgress
from kalscope.common.text import one_line
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.readers.recording_file import read_recording
from kalscope.tuning.tuning import Tuning
from kalscope.tuning.tuning_file import load_tuning
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.guard.viser_private import take_upload
from kalscope_app.session.changes.fleet import at_device
from kalscope_app.session.changes.live import WAITING
from kalscope_app.session.changes.parameters import set_sample_period
from kalscope_app.session.changes.settings_file import ENDING, uploaded_settings, use_settings
from kalscope_app.session.opening import opened, with_sample_period
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import Change, State
from kalscope_app.views.binding import TypedNumber, on_user
from kalscope_app.views.markdown import capitalised
from kalscope_app.views.slow_job import SlowJobProgress
from kalscope_app.views.source.fleet import FleetView
from kalscope_app.views.source.generator import GeneratorForm
from kalscope_app.views.source.import_summary import import_summary
from kalscope_app.views.source.reading_form import ReadingForm
from kalscope_app.views.source.samples import SamplesView
from kalscope_app.views.window.css import PRIMARY
from kalscope_app.worker.worker import Worker

if TYPE_CHECKING:
    from kalscope.fleet.results import Fleet

Reader = Callable[..., Recording]
"""Reads the present file in the worker: options, then progress by name."""

UPLOAD_ORDER = -1.0
"""Every browser gets an upload button of its own, above what is there already."""

MAX_NAME = 100
"""Characters of a name that an error message shows."""

PERIOD_HINT = "Time between two samples. Empty: as recorded."


def as_it_is(state: State) -> State:
    """No further change."""
    return state


class SourceView:
    """The Source tab. A job has the worker read; the session then gets the finished Recording."""

    def __init__(self, gui: viser.GuiApi, session: Session, jobs: Jobs, worker: Worker, path: str = "") -> None:
        """Args: the usual; the process that reads; the path that is offered."""
        self._session, self._jobs, self._worker = session, jobs, worker
        self._stop = threading.Event()
        self._building = threading.Lock()
        self._again: tuple[tuple[str, str], Reader] = (("", ""), open_source)
        with gui.add_folder("Your file") as self._own:
            with gui.add_form(None) as path_form:
                self._path = gui.add_text(
                    "path",
                    path,
                    hint="A log of any size on this computer, or a tuning file (.toml); press Enter to open it.",
                )
            self._open = gui.add_button("Open this path", hint="Open the file at this path.")
            self._progress = gui.add_progress_bar(0.0, visible=False)
            self._cancel = gui.add_button(
                "Cancel", visible=False, hint="Stop reading; the current recording stays open."
            )
        self._report: viser.GuiMarkdownHandle | None = None
        self._described: Recording | None = None
        for subscribe in (self._open.on_click, path_form.on_submit):
            on_user(subscribe, lambda _client: self.open_spec(self._path.value.strip()))
        on_user(self._cancel.on_click, lambda _client: self._stop.set())

    def build_rest(self, gui: viser.GuiApi) -> None:
        """The lower part: samples and papers, the generator, the import summary and the import options."""
        self._samples = SamplesView(gui, self._session, self._jobs, self.open_spec)
        with gui.add_folder("Generate a signal", expand_by_default=False):
            self._generator = GeneratorForm(gui, self.open_spec)
        self._fleet = FleetView(gui, self._session, self._jobs, self._worker, self.open_device)
        with gui.add_folder("Import summary"):
            self._period = TypedNumber(
                gui, self._session, "sample period", "sample period (s)", PERIOD_HINT, _period_typed
            )
            report = gui.add_markdown("")
            with gui.add_folder("Import options", expand_by_default=False):
                self._reading = ReadingForm(gui, self._read_again)
        self._report = report  # last: a frame may come at any time

    def add_upload(self, client: viser.ClientHandle) -> None:
        """Give one browser its own upload button: a shared one would replay each upload to new browsers."""
        with self._building, self._own:  # two browsers may come at once, and viser enters a folder only once
            button = client.gui.add_upload_button(
                "Upload a file …",
                mime_type="*/*",
                color=PRIMARY,
                order=UPLOAD_ORDER,
                hint="A log or tuning file (.toml) of up to 64 MB; larger ones by their path.",
            )

        def take(_event: viser.GuiEvent[Any]) -> None:
            upload = take_upload(button)
            self._upload(upload.name, upload.content)

        button.on_upload(take)

    def open_spec(self, spec: str, failed: Failed = Failed.OPEN) -> None:
        """Open what is named as on the command line; a tuning file is loaded onto what is open."""
        if spec.lower().endswith(ENDING):
            self._load(Path(spec).name, partial(load_tuning, spec))
        else:
            self._read(partial(open_source, spec), Path(spec).name or spec, ReadOptions(), failed=failed)

    def open_device(self, fleet: Fleet, device: int) -> None:
        """Open the recording of a device of a fleet, as the fleet read it."""
        from kalscope.fleet.results import reopen, source_of

        reader = partial(reopen, source_of(fleet, device))
        self._read(reader, fleet.devices.ids[device], fleet.note.reading, then=at_device(fleet, device))

    def _upload(self, name: str, content: bytes) -> None:
        if name.lower().endswith(ENDING):
            self._load(name, partial(uploaded_settings, name, content))
        else:
            # As an array it goes to the worker without a copy.
            self._read(partial(read_upload, name, np.frombuffer(content, np.uint8)), name, ReadOptions())

    def _load(self, name: str, read: Callable[[], Tuning]) -> None:
        def work() -> None:
            tuning = self._worker.run(read, one_line(name)[:MAX_NAME])
            self._session.request(use_settings(tuning, name), failed=Failed.OPEN)

        self._jobs.run(work, Failed.OPEN)

    def _read_again(self, options: ReadOptions) -> None:
        """Read the same file again, with other options or because it has changed."""

        def read(state: State) -> None:
            recording = state.recording
            (source, title), reader = self._again
            same = (recording.source, recording.title) == (source, title)
            period = state.open.typed_period if options.rate is None else None
            reader = reader if same else partial(open_source, recording.source)
            self._read(reader, recording.title or recording.source, options, period)

        self._session.with_state(read)

    def _read(
        self,
        reader: Reader,
        what: str,
        options: ReadOptions,
        period: float | None = None,
        failed: Failed = Failed.OPEN,
        then: Change = as_it_is,
    ) -> None:
        """Read `what` as a job, then show it; `period` is the sample period that the user typed for this file, s.

        What `then` changes belongs to the same step of Undo.
        """

        def work() -> None:
            stop = self._stop = threading.Event()  # now: Cancel stops what is being read, not what is queued
            with SlowJobProgress(self._progress, self._cancel) as shown:
                read = partial(reader, options)
                recording = self._worker.run(read, one_line(what)[:MAX_NAME], shown.report, stop.is_set)
            self._again = (recording.source, recording.title), reader

            def show(state: State) -> State:
                after = then(opened(recording, state).with_open(options=options))
                return after if period is None else with_sample_period(after, period)

            self._session.request(show, failed=failed)

        self._jobs.run(work, failed)

    def show(self, frame: Frame) -> None:
        """Show which sample or figure is open, and the import summary."""
        recording = frame.state.recording
        if self._report is None:
            return
        self._samples.show(frame)
        self._fleet.show(frame.state.fleet)
        self._period.show(frame, recording.sample_period, "")
        self._period.set_visible(frame.state.live is None)
        if recording is self._described:  # once a recording, not once a frame
            return
        waits = frame.state.live is not None and frame.state.live.waits
        self._report.content = f"{capitalised(WAITING)}." if waits else import_summary(recording)
        self._reading.show(frame.state.open.options)
        self._described = recording


def _period_typed(_name: str, text: str) -> Change:
    return set_sample_period(text)


def read_upload(
    name: str,
    content: NDArray[np.uint8],
    options: ReadOptions,
    *,
    progress: OnProgress | None = None,
) -> Recording:
    """Read what a browser sent, its bytes. Its name is shown, never used as a path."""
    shown = Path(name.replace("\\", "/")).name[:200] or "upload"
    safe = re.sub(r"[^\w.-]+", "_", shown).strip(".")[-80:] or "upload"
    with temporary_folder() as folder:
        file = folder / safe
        file.write_bytes(content.data)
        recording = read_recording(file, options, progress=progress)
    return replace(recording, source="", title=shown)
