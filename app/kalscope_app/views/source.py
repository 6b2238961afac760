"""The source of the signal: a file, or a recording that comes with Kalscope."""

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
from kalscope.sources.grammar import read_options
from kalscope.sources.grammar.read_options import OPTIONS, ReadOptions
from kalscope.sources.reading.account import account, summary
from kalscope.sources.reading.recording_file import read_recording
from kalscope.sources.samples import list_samples
from kalscope.sources.synthetic import SHAPES
from kalscope.tuning.file import load_tuning
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.guard.viser_private import take_upload
from kalscope_app.session import changes
from kalscope_app.session.changes import ENDING, set_sample_period
from kalscope_app.session.opening import opened, opened_experiment, with_sample_period
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import Change, State
from kalscope_app.views.fleet import fleet_of
from kalscope_app.views.widgets import SlowJob, TypedNumber, add_button, capitalised, escape_markdown, on_user, put
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
    given, missing, words = dict[str, Any](), list[str](), iter(read_options.split_values(text))
    for word in words:
        option, _, value = word.partition("=")
        if option not in OPTIONS:
            raise BadSetting(f"import options must be some of {', '.join(OPTIONS)} (got {option[:40]!r})")
        if option in ("--day-first", "--month-first"):
            given["day_first"] = option == "--day-first"
        elif not (value := value or next(words, "")):
            raise BadSetting(f"{option} must have a value (got none)")
        elif option == "--missing":
            missing.append(value)
        else:
            given[option.removeprefix("--").replace("-", "_")] = value
    return read_options.options_from_text(missing=missing, **given)


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
        hint = "Reads the file again; Undo reverts it."
        self._button = add_button(gui, "…", hint, lambda _client: self._answer(source), visible=False)
        self._text = gui.add_markdown("", visible=False)
        self._question: Question | None = None
        self._about: Recording | None = None

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


# Recordings that come with Kalscope, and the figures of the source documents.


NONE = "–"

AUTHORS = {"noise_reducer": "Ma'arif 2019", "generalized": "Khan", "lis302dl": "interactive matter 2009"}
"""Source documents, by what their experiments' names begin with."""


def add_samples(gui: viser.GuiApi, session: Session, open_spec: Callable[[str], None]) -> None:
    """The folder "Samples and papers" of the Source tab; `open_spec` opens the source of a name."""
    specs = specs_by_label()
    with gui.add_folder("Samples and papers"):
        hint = "Recordings, re-created figures of three documents that publish no data, and generated signals."
        menu = gui.add_dropdown("sample or figure", (NONE, *specs), hint=hint)

    def open_chosen() -> None:
        spec = specs.get(menu.value, "")
        menu.value = NONE  # the header names what is open, and the same one can be chosen again
        if spec.startswith("experiment:"):
            name = spec.removeprefix("experiment:")
            session.request(lambda state: opened_experiment(name, state), failed=Failed.OPEN)
        elif spec:
            open_spec(spec)

    on_user(menu.on_update, lambda _client: open_chosen())


def specs_by_label() -> dict[str, str]:
    """What the menu offers, named as on the command line; a sample that was not measured says how it was made."""
    samples = {
        f"{one.title} ({one.made})" if one.made else one.title: f"sample:{one.name}" for one in list_samples()
    }
    figures = {experiment_label(one): f"experiment:{one.name}" for one in list_experiments()}
    return samples | figures | {f"{shape.replace('_', ' ')} (generated)": f"synthetic:{shape}" for shape in SHAPES}


def experiment_label(experiment: Experiment) -> str:
    """Author and figure, short enough for a menu."""
    author = next(words for start, words in AUTHORS.items() if experiment.name.startswith(start))
    return f"{author}: {experiment.title.removeprefix('LIS302DL: ')}"


# The source of the signal: a file, uploaded or by its path; and how the file was read.


Reader = Callable[..., Recording]
"""Reads the present file in the worker: options, then progress by name."""

UPLOAD_ORDER = -1.0
"""Every browser gets an upload button of its own, above what is there already."""

MAX_NAME = 100
"""Characters of a name that an error message shows."""

OPTIONS_HINT = "As on the command line, such as --delimiter tab --missing -200; a wrong word lists them all."

PERIOD_HINT = "Time between two samples. Empty: as recorded."


class SourceView:
    """The Source tab. A job has the worker read; the session then gets the finished Recording."""

    def __init__(self, gui: viser.GuiApi, session: Session, jobs: Jobs, worker: Worker, path: str = "") -> None:
        """Args: the usual; the process that reads; the path that is offered."""
        self._session, self._jobs, self._worker = session, jobs, worker
        self._building = threading.Lock()
        self._again: tuple[tuple[str, str], Reader] = (("", ""), open_source)
        with gui.add_folder("Your file") as self._own:
            with gui.add_form(None) as path_form:
                hint = "A log, a tuning file (.toml), a fleet's folder, or such as synthetic:step?sigma=0.2."
                self._path = gui.add_text("path", path, hint=hint)
            add_button(gui, "Open this path", "Or press Enter in the box.", self._open_path)
            self._reading = SlowJob(gui, "Stop reading; the current recording stays open.")
        self._described: Recording | None = None
        on_user(path_form.on_submit, self._open_path)

    def build_rest(self, gui: viser.GuiApi) -> None:
        """The lower part: samples and papers, the import summary and the import options."""
        add_samples(gui, self._session, self.open_spec)
        with gui.add_folder("Import summary"):
            name = "sample period"
            self._period = TypedNumber(
                gui, self._session, name, f"{name} (s)", PERIOD_HINT, lambda _, text: set_sample_period(text)
            )
            self._report = gui.add_markdown("")
            self._options = gui.add_text("import options", "", hint=OPTIONS_HINT)
            hint = "Reads the file with these options, and what was added to it."
            add_button(gui, "Re-import", hint, lambda _client: self._read_again(self._options.value))

    def add_upload(self, client: viser.ClientHandle) -> None:
        """Give one browser its own upload button: a shared one would replay each upload to new browsers."""
        with self._building, self._own:  # two browsers may come at once, and viser enters a folder only once
            hint = "A log or tuning file (.toml) of up to 64 MB; larger ones by their path."
            button = client.gui.add_upload_button(
                "Upload a file …", mime_type="*/*", color=PRIMARY, order=UPLOAD_ORDER, hint=hint
            )

        button.on_upload(lambda _event: self._upload(take_upload(button)))

    def _open_path(self, _client: viser.ClientHandle) -> None:
        self.open_spec(self._path.value.strip())

    def open_spec(self, spec: str) -> None:
        """Open what is named as on the command line; a tuning file or a fleet is added to what is open."""
        self._jobs.run(partial(self._open, spec), Failed.OPEN)  # a file system may take long to answer

    def _open(self, spec: str) -> None:
        name = Path(spec).name or spec
        if spec.lower().endswith(ENDING):
            self._load(name, partial(load_tuning, spec), lambda tuning: changes.use_settings(tuning, name))
        elif spec and Path(spec).is_dir():
            self._load(name, partial(fleet_of, Path(spec)), changes.open_fleet)
        else:
            self._read(partial(open_source, spec), name, ReadOptions())

    def open_device(self, fleet: Fleet, device: int) -> None:
        """Open the recording of a device of a fleet, as the fleet read it."""
        from kalscope.fleet.results import reopen

        reader = partial(reopen, fleet.devices.ids[device], fleet.devices.sources[device], fleet.note)
        self._read(reader, fleet.devices.ids[device], fleet.note.reading, then=changes.at_device(fleet, device))

    def _upload(self, upload: viser.UploadedFile) -> None:
        name, content = upload.name, upload.content
        if name.lower().endswith(ENDING):
            read = partial(changes.uploaded_settings, name, content)
            self._load(name, read, lambda tuning: changes.use_settings(tuning, name))
        else:
            # As an array it goes to the worker without a copy.
            self._read(partial(read_upload, name, np.frombuffer(content, np.uint8)), name, ReadOptions())

    def _load(self, name: str, read: Callable[[], Any], change: Callable[[Any], Change]) -> None:
        """Read what goes with the recording on screen, as a job."""

        def work() -> None:
            self._session.request(change(self._worker.run(read, one_line(name)[:MAX_NAME])), failed=Failed.OPEN)

        self._jobs.run(work, Failed.OPEN)

    def read_with(self, options: str) -> None:
        """Read the same file again with options more."""
        self._session.with_state(lambda state: self._read_again(f"{words_of(state.options)} {options}"))

    def _read_again(self, text: str) -> None:
        """Read the same file again, with other options or because it has changed."""

        def read(state: State) -> None:
            options, recording = options_of(text), state.recording
            before, reader = self._again
            if before != (recording.source, recording.title):
                reader = partial(open_source, recording.source)
            period = state.typed_period if options.rate is None else None
            then = [partial(with_sample_period, period=period)] if period is not None else []
            self._read(reader, recording.title or recording.source, options, *then)

        self._jobs.run_with_state(self._session, read, Failed.OPEN)

    def _read(self, reader: Reader, what: str, options: ReadOptions, then: Change = lambda state: state) -> None:
        """Read `what` as a job, then show it; what `then` changes belongs to the same step of Undo."""

        def work() -> None:
            with self._reading as job:
                read, name = partial(reader, options), one_line(what)[:MAX_NAME]
                recording = self._worker.run(read, name, job)
            self._again = (recording.source, recording.title), reader

            def show(state: State) -> State:
                return then(replace(opened(recording, state), options=options))

            self._session.request(show, failed=Failed.OPEN)

        self._jobs.run(work, Failed.OPEN)

    def show(self, frame: Frame) -> None:
        """Show the import summary."""
        recording = frame.state.recording
        self._period.show(frame, recording.sample_period, "", visible=frame.state.live is None)
        if recording is self._described:  # once a recording, not once a frame
            return
        waits = frame.state.live is not None and frame.state.live.waits
        self._report.content = f"{capitalised(changes.WAITING)}." if waits else import_summary(recording)
        self._options.value = words_of(frame.state.options)
        self._described = recording


def words_of(options: ReadOptions) -> str:
    """Options as they are typed."""
    return shlex.join(read_options.option_words(options))


def read_upload(
    name: str, content: NDArray[np.uint8], options: ReadOptions, *, progress: OnProgress | None = None
) -> Recording:
    """Read what a browser sent, its bytes. Its name is shown, never used as a path."""
    shown = Path(name.replace("\\", "/")).name[:200] or "upload"
    safe = re.sub(r"[^\w.-]+", "_", shown).strip(".")[-80:] or "upload"
    with temporary_folder() as folder:
        file = folder / safe
        file.write_bytes(content.data)
        recording = read_recording(file, options, progress=progress)
    return replace(recording, source="", title=shown)
