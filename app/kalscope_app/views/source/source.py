"""The source of the signal: a sample recording, a file or the generator; and how it was read."""

from __future__ import annotations

import re
import tempfile
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import viser

from kalscope.catalogue import open_source
from kalscope.papers.experiments import list_experiments
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.readers.recording_file import read_recording
from kalscope.sources.samples import list_samples
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.guard.viser_private import take_upload
from kalscope_app.session.changes.parameters import set_sample_period
from kalscope_app.session.opening import opened, opened_experiment
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import State
from kalscope_app.views.binding import on_user
from kalscope_app.views.slow_job import SlowJobProgress
from kalscope_app.views.source.generator import GeneratorForm
from kalscope_app.views.source.import_summary import import_summary
from kalscope_app.views.source.reading_form import ReadingForm

if TYPE_CHECKING:
    from kalscope.papers.parts import Experiment

MINE = "–"

Reader = Callable[..., Recording]
"""Reads the present file: options, then progress and cancelled by name."""


class SourceView:
    """The Source tab. Reading runs as a job; the session then gets the finished Recording."""

    def __init__(self, gui: viser.GuiApi, session: Session, jobs: Jobs) -> None:
        self._session, self._jobs = session, jobs
        self._stop = threading.Event()
        self._building = threading.Lock()
        self._again: tuple[tuple[str, str], Reader] = (("", ""), open_source)
        self._samples = {sample.title: sample for sample in list_samples()}
        self._sample = gui.add_dropdown(
            "sample recording", (MINE, *self._samples), hint="Recordings that come with Kalscope."
        )
        self._experiments = {experiment_label(e): e.name for e in list_experiments()}
        self._experiment = gui.add_dropdown(
            "experiment", (MINE, *self._experiments), hint="Figures of the three source documents."
        )
        with gui.add_folder("Your own file") as self._own:
            with gui.add_form(None) as path_form:
                self._path = gui.add_text(
                    "path",
                    "",
                    hint="A log or measurement file on this computer, of any size; press Enter to open it.",
                )
            self._open = gui.add_button("Open this path", hint="Open the file at this path.")
            self._progress = gui.add_progress_bar(0.0, visible=False)
            self._cancel = gui.add_button(
                "Cancel", visible=False, hint="Stop reading; the current recording stays open."
            )
            with gui.add_form(None) as form:
                self._period = gui.add_text(
                    "sample period (s)",
                    "",
                    hint="Time between two samples, for a file without a time column; press Enter.",
                )
        self._report: viser.GuiMarkdownHandle | None = None
        self._described: Recording | None = None
        on_user(self._sample.on_update, lambda _client: self._open_sample())
        on_user(self._experiment.on_update, lambda _client: self._open_experiment())
        for subscribe in (self._open.on_click, path_form.on_submit):
            on_user(subscribe, lambda _client: self._open_spec(self._path.value.strip()))
        on_user(self._cancel.on_click, lambda _client: self._stop.set())
        on_user(
            form.on_submit,
            lambda _client: session.request(set_sample_period(self._period.value), failed=Failed.NUMBER),
        )

    def build_rest(self, gui: viser.GuiApi) -> None:
        """The lower part: the generator, the import summary and the import options."""
        with gui.add_folder("Generate a signal", expand_by_default=False):
            self._generator = GeneratorForm(gui, self._open_spec)
        with gui.add_folder("Import summary"):
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
                hint="A log or measurement file of up to 64 MB; larger ones by their path.",
            )

        def take(_event: viser.GuiEvent[Any]) -> None:
            upload = take_upload(button)
            self._upload(upload.name, upload.content)

        button.on_upload(take)

    def _open_sample(self) -> None:
        sample = self._samples.get(self._sample.value)
        if sample is not None:
            self._open_spec(f"sample:{sample.name}")

    def _open_experiment(self) -> None:
        name = self._experiments.get(self._experiment.value)
        if name is not None:
            self._session.request(lambda state: opened_experiment(name, state), failed=Failed.OPEN)

    def _open_spec(self, spec: str) -> None:
        self._read(partial(open_source, spec), ReadOptions())

    def _upload(self, name: str, content: bytes) -> None:
        self._read(partial(read_upload, name, content), ReadOptions())

    def _read_again(self, options: ReadOptions) -> None:
        """Read the same file again, with other options or because it has changed."""

        def read(state: State) -> None:
            recording = state.recording
            (source, title), reader = self._again
            same = (recording.source, recording.title) == (source, title)
            self._read(reader if same else partial(open_source, recording.source), options)

        self._session.with_state(read)

    def _read(self, reader: Reader, options: ReadOptions) -> None:
        stop = self._stop = threading.Event()

        def work() -> None:
            with SlowJobProgress(self._progress, self._cancel) as shown:
                recording = reader(options, progress=shown.report, cancelled=stop.is_set)
            self._again = (recording.source, recording.title), reader
            self._session.request(
                lambda state: opened(recording, state).with_open(options=options), failed=Failed.OPEN
            )

        self._jobs.run(work, Failed.OPEN)

    def show(self, frame: Frame) -> None:
        """Show which sample or experiment is open, and the import summary."""
        recording = frame.state.recording
        sample, experiment = (recording.source.removeprefix(kind) for kind in ("sample:", "experiment:"))
        self._sample.value = next((title for title, one in self._samples.items() if one.name == sample), MINE)
        self._experiment.value = next(
            (title for title, name in self._experiments.items() if name == experiment), MINE
        )
        self._period.visible = not recording.sample_period or bool(self._period.value)
        if self._report is not None and recording is not self._described:  # once a recording, not once a frame
            self._described = recording
            self._report.content = import_summary(recording)
            self._reading.show(frame.state.open.options)


AUTHORS = {"noise_reducer": "Ma'arif 2019", "generalized": "Khan", "lis302dl": "interactive matter 2009"}
"""Source documents, by what their experiments' names begin with."""


def experiment_label(experiment: Experiment) -> str:
    """Author and figure, short enough for a menu."""
    author = next(words for start, words in AUTHORS.items() if experiment.name.startswith(start))
    return f"{author}: {experiment.title.removeprefix('LIS302DL: ')}"


def read_upload(
    name: str,
    content: bytes,
    options: ReadOptions,
    *,
    progress: Callable[[float, str], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> Recording:
    """Read what a browser sent. Its name is shown, never used as a path."""
    shown = Path(name.replace("\\", "/")).name[:200] or "upload"
    safe = re.sub(r"[^\w.-]+", "_", shown).strip(".")[-80:] or "upload"
    with tempfile.TemporaryDirectory(prefix="kalscope-") as folder:
        file = Path(folder) / safe
        file.write_bytes(content)
        recording = read_recording(file, options, progress=progress, cancelled=cancelled)
    return replace(recording, source="", title=shown)
