"""The source of the signal: a file, the generator, or a recording that comes with Kalscope."""

from __future__ import annotations

import re
import shlex
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import viser
from numpy.typing import NDArray

from kalscope.analysis.channel_kinds import channel_kinds
from kalscope.catalogue import open_source
from kalscope.common.files import temporary_folder
from kalscope.common.progress import OnProgress
from kalscope.common.text import count, one_line
from kalscope.errors import BadSetting
from kalscope.papers.reproduction import list_experiments
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import (
    OPTIONS,
    ReadOptions,
    option_words,
    options_from_text,
    split_values,
)
from kalscope.sources.reading.account import account, summary
from kalscope.sources.reading.recording_file import read_recording
from kalscope.sources.samples import list_samples
from kalscope.sources.synthetic import NOISES, SHAPES, SignalSettings
from kalscope.tuning.file import load_tuning
from kalscope.tuning.tuning import Tuning
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.guard.viser_private import take_upload
from kalscope_app.session.changes import ENDING, at_device, set_sample_period, uploaded_settings, use_settings
from kalscope_app.session.live_changes import WAITING
from kalscope_app.session.opening import opened, opened_experiment, with_sample_period
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import Change, State
from kalscope_app.views.fleet import FleetView
from kalscope_app.views.widgets import (
    SlowJobProgress,
    TypedNumber,
    capitalised,
    escape_markdown,
    on_user,
    put,
    typed,
)
from kalscope_app.views.window import PERIOD_BUTTON, PRIMARY, QUESTION
from kalscope_app.worker.worker import Worker

if TYPE_CHECKING:
    from kalscope.fleet.results import Fleet
    from kalscope.papers.document import Experiment


# How a recording was read, as short markdown; every piece from the file is escaped.


MAX_LINES, MAX_KINDS = 12, 6
"""Lines of the account that are shown, and channels that are named."""


def import_summary(recording: Recording) -> str:
    """What was read and as what, then the first lines of the account of the file; markdown, escaped."""
    report, lines = recording.report, [line.strip() for line in account(recording).splitlines()[1:]]
    if recording.sha256:  # it is finished and from a file: channels that measure nothing are not shown first
        kinds = {name: kind for name, kind in channel_kinds(recording).items() if kind}
        beside = [f"{name} ({kind})" for name, kind in kinds.items()][:MAX_KINDS]
        if 0 < len(kinds) < len(recording.names):
            lines.insert(0, f"not shown first: {', '.join(beside)}{' …' if len(kinds) > MAX_KINDS else ''}")
    more = [f"and {count(len(lines) - MAX_LINES)} more"] if len(lines) > MAX_LINES else []
    head = [f"{summary(recording)}.", *([f"Read as {report.read_as}."] if report.read_as else [])]
    head, shown = ([escape_markdown(line, 300) for line in part] for part in (head, lines[:MAX_LINES] + more))
    return "\n\n".join([*head, "\n".join(f"- {line}" for line in shown)])


# Options in place of what was detected, in the words of the command line.


def options_of(text: str) -> ReadOptions:
    """Options as on the command line: --delimiter tab --missing -200 --missing n/x.

    Raises:
        BadSetting: a word that is no option, or a value that it does not have.
    """
    given, missing, words = dict[str, Any](), list[str](), split_values(text)
    while words:
        option, is_joined, value = words.pop(0).partition("=")
        name = option.removeprefix("--").replace("-", "_")
        if option not in OPTIONS:
            raise BadSetting(f"import options must be some of {', '.join(OPTIONS)} (got {option[:40]!r})")
        if name in ("day_first", "month_first"):
            given["day_first"] = name == "day_first"
            continue
        if not is_joined and not words:
            raise BadSetting(f"{option} must have a value (got none)")
        value = value if is_joined else words.pop(0)
        if name == "missing":
            missing.append(value)
        else:
            given[name] = value
    return options_from_text(missing=missing, **given)


# Questions about the file, above the charts: each with the one option that would answer it otherwise.


_MENTIONED = re.compile(
    r"""(--(?:day|month)-first)|--([a-z]{2,9}(?:-[a-z]{2,9})?) ("[^"]{1,200}"|-?[0-9][0-9.e+-]{0,30}|[a-z]{2,9})"""
)

ANSWERS = {
    "--missing": "Read {} as missing",
    "--gaps": "Read gaps as {}",
    "--time-unit": "Read the time in {}",
    "--time-column": "Take {} as the time",
    "--decimal": "Read with a decimal {}",
    "--day-first": "Read the day first",
    "--month-first": "Read the month first",
}
"""Labels of buttons by the option that they read the file with; no other option answers a question."""


@dataclass(frozen=True)
class Question:
    """What the file does not show, and the button beside it."""

    sentence: str
    """In words; it may contain text of the file."""
    button: str
    """The label of the button."""
    options: str = ""
    """What the button reads the file with; "": it only leads to a box."""


def question_about(recording: Recording) -> Question | None:
    """The first question about a file that one option answers, gaps in time last; None where there is none."""
    gaps = [note for note in recording.report.notes if "--gaps" in note]
    for note in (*recording.report.assumptions, *gaps):
        for mention in _MENTIONED.finditer(note):
            option, value = mention[1] or f"--{mention[2]}", mention[3] or ""
            if option in ANSWERS:
                asked = note[: mention.start()].rpartition(";")[0] or note
                asked += ")" * (asked.count("(") - asked.count(")"))  # it closes after the option
                words = {"missing": "missing samples", "dt": "elapsed time"}.get(value, value)
                return Question(f"{capitalised(asked)}.", ANSWERS[option].format(words), mention[0])
    if recording.sample_period is None and recording.sha256:
        return Question("The sample rate is not known: times are in samples.", PERIOD_BUTTON)
    return None


class QuestionView:
    """One line above the charts, and one button."""

    def __init__(self, gui: viser.GuiApi, source: SourceView) -> None:
        gui.add_html(QUESTION)
        self._button = gui.add_button("…", visible=False, hint="Reads the file again; Undo reverts it.")
        self._text = gui.add_markdown("", visible=False)
        self._question: Question | None = None
        self._about: Recording | None = None
        on_user(self._button.on_click, lambda _client: self._answer(source))

    def _answer(self, source: SourceView) -> None:
        if self._question is not None and self._question.options:
            source.read_with(self._question.options)

    def asks(self, frame: Frame) -> bool:
        """Whether there is a question; none is asked while a part of the recording is on screen."""
        if frame.state.recording is not self._about:
            self._about = frame.state.recording
            self._question = question_about(self._about) if frame.state.live is None else None
        return self._question is not None and frame.state.view.window is None

    def show(self, frame: Frame) -> None:
        """Follow the frame."""
        asks = self.asks(frame)
        put(self._text, visible=asks)
        put(self._button, visible=asks)
        if self._question is not None:
            put(self._text, content=escape_markdown(self._question.sentence, 300))
            put(self._button, label=self._question.button)


# The form that generates a synthetic signal.


SETTINGS = "n", "sample_period", "amplitude", "period", "sigma", "outliers", "drop_outs", "channels", "seed"
"""The numbers of `SignalSettings` that are shown; others may be typed, too."""


class GeneratorForm:
    """The settings of a synthetic signal and the button that generates it."""

    def __init__(self, gui: viser.GuiApi, open_spec: Callable[[str, Failed], None]) -> None:
        self._open_spec, defaults = open_spec, SignalSettings()
        self._shape = gui.add_dropdown("shape", SHAPES, hint="The noise-free signal, plotted dashed as the truth.")
        self._noise = gui.add_dropdown(
            "noise", NOISES, hint="Distribution; triangular is rand − rand (Ma'arif 2019)."
        )
        text = " ".join(f"{name}={typed(float(getattr(defaults, name)))}" for name in SETTINGS)
        self._numbers = gui.add_text(
            "numbers", text, multiline=True, hint="Samples, times in s, shares 0 to 1; sigma: the noise, its std."
        )
        button = gui.add_button("Generate", hint="Generate this signal and open it.")
        on_user(button.on_click, lambda _client: self._generate())

    def _generate(self) -> None:
        query = "&".join([f"noise={self._noise.value}", *self._numbers.value.split()])
        self._open_spec(f"synthetic:{self._shape.value}?{query}", Failed.GENERATE)


# Recordings that come with Kalscope, and the figures of the source documents.


NONE = "–"

AUTHORS = {"noise_reducer": "Ma'arif 2019", "generalized": "Khan", "lis302dl": "interactive matter 2009"}
"""Source documents, by what their experiments' names begin with."""


class SamplesView:
    """The folder "Samples and papers" of the Source tab."""

    def __init__(self, gui: viser.GuiApi, session: Session, open_spec: Callable[[str, Failed], None]) -> None:
        """Args: the usual; opens the source of this name."""
        samples = {sample_label(sample.title, sample.made): f"sample:{sample.name}" for sample in list_samples()}
        self._specs = samples | {experiment_label(one): f"experiment:{one.name}" for one in list_experiments()}
        with gui.add_folder("Samples and papers"):
            hint = "What comes with Kalscope, and figures re-created from three documents that publish no data."
            self._menu = gui.add_dropdown("sample or figure", (NONE, *self._specs), hint=hint)

        def open_chosen() -> None:
            kind, _, name = self._specs.get(self._menu.value, "").partition(":")
            if kind == "experiment":
                session.request(lambda state: opened_experiment(name, state), failed=Failed.OPEN)
            elif kind:
                open_spec(f"sample:{name}", Failed.OPEN)

        on_user(self._menu.on_update, lambda _client: open_chosen())

    def show(self, frame: Frame) -> None:
        """Show which one is open."""
        source = frame.state.recording.source
        self._menu.value = next((label for label, spec in self._specs.items() if spec == source), NONE)


def sample_label(title: str, made: str) -> str:
    """A sample in the menu, and how it was made where it was not measured."""
    return f"{title} ({made})" if made else title


def experiment_label(experiment: Experiment) -> str:
    """Author and figure, short enough for a menu."""
    author = next(words for start, words in AUTHORS.items() if experiment.name.startswith(start))
    return f"{author}: {experiment.title.removeprefix('LIS302DL: ')}"


# The source of the signal: a file, uploaded or by its path; the generator; and how the file was read.


Reader = Callable[..., Recording]
"""Reads the present file in the worker: options, then progress by name."""

UPLOAD_ORDER = -1.0
"""Every browser gets an upload button of its own, above what is there already."""

MAX_NAME = 100
"""Characters of a name that an error message shows."""

OPTIONS_HINT = "As on the command line, such as --delimiter tab --missing -200; a wrong word lists them all."

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
        self._samples = SamplesView(gui, self._session, self.open_spec)
        with gui.add_folder("Generate a signal", expand_by_default=False):
            self._generator = GeneratorForm(gui, self.open_spec)
        self._fleet = FleetView(gui, self._session, self._jobs, self._worker)
        with gui.add_folder("Import summary"):
            self._period = TypedNumber(
                gui, self._session, "sample period", "sample period (s)", PERIOD_HINT, _period_typed
            )
            report = gui.add_markdown("")
            self._options = gui.add_text(
                "import options",
                "",
                hint=OPTIONS_HINT,
            )
            again = gui.add_button("Re-import", hint="Reads the file with these options, and what was added to it.")
        on_user(again.on_click, lambda _client: self._read_again(self._options.value))
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
        from kalscope.fleet.results import reopen

        reader = partial(reopen, fleet.devices.ids[device], fleet.devices.sources[device], fleet.note)
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

    def read_with(self, options: str) -> None:
        """Read the same file again with options more."""
        self._session.with_state(lambda state: self._read_again(f"{words_of(state.open.options)} {options}"))

    def _read_again(self, text: str) -> None:
        """Read the same file again, with other options or because it has changed."""

        def read(state: State) -> None:
            options, recording = options_of(text), state.recording
            (source, title), reader = self._again
            same = (recording.source, recording.title) == (source, title)
            period = state.open.typed_period if options.rate is None else None
            reader = reader if same else partial(open_source, recording.source)
            self._read(reader, recording.title or recording.source, options, period)

        self._jobs.run_with_state(self._session, read, Failed.OPEN)

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
        self._options.value = words_of(frame.state.open.options)
        self._described = recording


def words_of(options: ReadOptions) -> str:
    """Options as they are typed."""
    return shlex.join(option_words(options))


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
