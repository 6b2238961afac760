"""The source of the signal: a file, the generator, or a recording that comes with Kalscope."""

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

from kalscope.analysis.channel_kinds import channel_kinds
from kalscope.catalogue import open_source
from kalscope.common.files import temporary_folder
from kalscope.common.progress import OnProgress
from kalscope.common.text import count, one_line
from kalscope.papers.reproduction import list_experiments
from kalscope.recording import Recording
from kalscope.sources.grammar.cells import SECONDS_PER_UNIT
from kalscope.sources.grammar.read_options import (
    OPTIONS,
    ReadOptions,
    join_values,
    option_texts,
    options_from_text,
    split_values,
)
from kalscope.sources.reading.account import read_as, summary, warnings
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
from kalscope_app.views.widgets import SlowJobProgress, TypedNumber, capitalised, escape_markdown, on_user, typed
from kalscope_app.views.window import PRIMARY
from kalscope_app.worker.worker import Worker

if TYPE_CHECKING:
    from kalscope.fleet.results import Fleet
    from kalscope.papers.document import Experiment
    from kalscope.papers.reproduction import Reproduction


# How a recording was read, as short markdown; every piece from the file is escaped.


MAX_ISSUES = 4
MAX_KINDS = 6


def import_summary(recording: Recording) -> str:
    """One line, warnings where much was lost, then what was decided and what could not be read."""
    report = recording.report
    head = [f"{escape_markdown(in_words_of_form(summary(recording)), 200)}."]
    head += [escape_markdown(in_words_of_form(sentence), 400) for sentence in read_as(recording)]
    head += [f"**{escape_markdown(in_words_of_form(sentence), 300)}.**" for sentence in warnings(recording)]
    counts = {
        "steps back in time": report.clipped_times,
        "comment lines": report.comments,
        "blank lines": report.blank,
    }
    lines = [f"{what}: {count(number)}" for what, number in counts.items() if number]
    if recording.sha256:  # it is finished and from a file
        lines += _about_channels(recording)
    lines += [
        escape_markdown(in_words_of_form(note), 160) for note in report.notes if note not in report.assumptions
    ]
    for issue in report.issues[:MAX_ISSUES]:
        where = f"line {issue.line}" + (f", {escape_markdown(issue.column, 30)}" if issue.column else "")
        lines.append(f"{where}: {escape_markdown(issue.reason, 80)}, “{escape_markdown(issue.text, 40)}”")
    if len(report.issues) > MAX_ISSUES:
        lines.append(f"and {count(report.rejected + report.bad_cells - MAX_ISSUES)} more")
    return "\n\n".join([*head, "\n".join(f"- {line}" for line in lines)])


def _about_channels(recording: Recording) -> list[str]:
    """Which channels measure nothing, where some other does: those are not shown first."""
    kinds = channel_kinds(recording)
    beside = [f"{escape_markdown(name, 30)} ({kind})" for name, kind in kinds.items() if kind]
    if not beside or len(beside) == len(kinds):
        return []
    more = f" and {len(beside) - MAX_KINDS} more" if len(beside) > MAX_KINDS else ""
    return [f"not shown first: {', '.join(beside[:MAX_KINDS])}{more}"]


# The form with the import options, named as on the command line.


class ReadingForm:
    """Options in place of what was detected; empty boxes are detected. The rarer ones are one click away."""

    def __init__(self, gui: viser.GuiApi, read: Callable[[ReadOptions], None]) -> None:
        self._gui, self._read = gui, read
        self._shown: ReadOptions | None = None
        self._boxes: dict[str, viser.GuiInputHandle[str]] = {}
        self._add_choice("delimiter", MARKS, "The character between two cells.")
        self._add_text("time_column", "Its name, its number from 1, or none.")
        self._add_choice("time_unit", UNITS, "The unit of a numeric time column.")
        self._add_text("missing", 'Values that mark a missing sample, between blanks: -200 n/x "no data".')
        self._add_choice("gaps", GAPS, "How long gaps are filtered.")
        with gui.add_folder("More options", expand_by_default=False):
            self._add_text("header_row", "Number of the line with the names; 0 = none.")
            self._add_text("unit_row", "Number of the line with the units; 0 = none.")
            self._add_choice("decimal", POINTS, "The decimal mark of numbers.")
            self._add_text("time_format", "Format of a time stamp, such as %d.%m.%Y %H:%M:%S.")
            self._add_choice("day_first", ORDERS, "What 03/04/2025 is: 3 April, or March 4.")
            self._add_text("rate", "The sample rate, instead of that of the stamps.")
            self._add_text("part", "The sheet, topic, group or variable of a file that holds several.")
            self._add_text("unpack_gb", "What a packed file may unpack to; empty: 0.134 GB, or 32 times its size.")
        button = gui.add_button("Re-import", hint="Also reads what was added to the file.")
        on_user(button.on_click, lambda _client: self._submit())

    def _add_text(self, option: str, hint: str) -> None:
        self._boxes[option] = self._gui.add_text(_label(option), "", hint=hint)

    def _add_choice(self, option: str, choices: dict[str, str], hint: str) -> None:
        self._boxes[option] = self._gui.add_dropdown(_label(option), tuple(choices), hint=hint)

    def show(self, options: ReadOptions) -> None:
        """Fill in what the open file was read with; what is typed stays until another is."""
        if options is self._shown:
            return
        self._shown, texts = options, option_texts(options)
        for option, box in self._boxes.items():
            values = texts.get(option, ())
            text = join_values(values) if option == "missing" else "".join(values)
            words = {meaning: word for word, meaning in CHOICES.get(option, {}).items()}
            box.value = words.get(text, text)

    def _submit(self) -> None:
        typed = {option: box.value.strip() for option, box in self._boxes.items()}
        given = {option: CHOICES.get(option, {}).get(text, text) or None for option, text in typed.items()}
        order, missing = given.pop("day_first"), given.pop("missing")
        self._read(
            options_from_text(
                missing=split_values(missing or ""),
                day_first=None if order is None else order == "day",
                **given,
            )
        )


FOUND = "auto"
"""Detect it from the file."""

MARKS = {FOUND: "", **{word: word for word in ("comma", "semicolon", "tab", "bar", "space")}}
UNITS = {FOUND: "", **{word: word for word in SECONDS_PER_UNIT}}
POINTS = {FOUND: "", "point": "point", "comma": "comma"}
ORDERS = {FOUND: "", "day first": "day", "month first": "month"}
GAPS = {"as rows": "", "as missing samples": "missing", "as elapsed time": "dt"}
"""How long gaps in time are filtered."""
CHOICES = {"delimiter": MARKS, "time_unit": UNITS, "decimal": POINTS, "day_first": ORDERS, "gaps": GAPS}
"""What a menu shows and what the command line takes, by the name of the option."""

LABELS = {
    "missing": "missing values",
    "gaps": "gaps in time",
    "decimal": "decimal mark",
    "day_first": "date order",
    "rate": "rate (Hz)",
    "unpack_gb": "unpack at most (GB)",
}
"""Labels of the boxes whose label is not the name of the option."""
_MENTIONED = re.compile(
    r"--([a-z]{2,9}(?:-[a-z]{2,9})?)"
    r"""(?:[ =](NAME|"[^"]{1,200}"|-?[0-9][0-9.e+-]{0,30}|[a-z]{2,9})(?![\w.]))?"""
)


def in_words_of_form(sentence: str) -> str:
    """A sentence about options of the command line in the words of this form: `--gaps dt` is its box for gaps."""
    return _MENTIONED.sub(_box_and_value, sentence)


def _box_and_value(mention: re.Match[str]) -> str:
    option, value = mention[1].replace("-", "_"), mention[2] or ""
    if f"--{mention[1]}" not in OPTIONS:
        return mention[0]
    if option in ("day_first", "month_first"):
        option, value, rest = "day_first", option.replace("_", " "), f" {value}" if value else ""
        return f"“{_label(option)}”: {value}{rest}"
    words = {meaning: word for word, meaning in CHOICES.get(option, {}).items() if meaning}
    if value in words or (value and not value.isalpha()) or value == "none":
        return f"“{_label(option)}”: {words.get(value, value)}"
    return f"“{_label(option)}”" + (f" {value}" if value not in ("", "NAME") else "")


def _label(option: str) -> str:
    return LABELS.get(option) or option.replace("_", " ")


# The form that generates a synthetic signal.


SETTINGS = {
    "n": ("samples", "Number of samples."),
    "sample_period": ("sample period (s)", "Time between two samples."),
    "channels": ("channels", "Number of channels, 1 to 16, each with its own noise."),
    "amplitude": ("amplitude", "Size of the shape."),
    "level": ("level", "Mean of the signal."),
    "period": ("period (s)", "One cycle, the rise time of a ramp, the time of a step."),
    "sigma": ("noise σ", "Standard deviation of the noise; r of the filter is its square."),
    "outliers": ("outliers (share)", "Share of samples that are outliers, 0 to 1."),
    "outlier_size": ("outlier size", "Size of an outlier, in the unit of the signal."),
    "quantum": ("ADC step", "Step of the analogue-to-digital converter; 0 for none."),
    "drop_outs": ("drop-outs (share)", "Share of samples that are missing, 0 to 1."),
    "seed": ("seed", "The same seed gives the same signal."),
}
"""Label and hint of each number of `SignalSettings`."""


class GeneratorForm:
    """The settings of a synthetic signal and the button that generates it."""

    def __init__(self, gui: viser.GuiApi, open_spec: Callable[[str, Failed], None]) -> None:
        self._open_spec = open_spec
        defaults = SignalSettings()
        self._shape = gui.add_dropdown(
            "shape",
            SHAPES,
            initial_value=defaults.shape,
            hint="The noise-free signal, plotted dashed as the truth.",
        )
        self._noise = gui.add_dropdown(
            "noise",
            NOISES,
            initial_value=defaults.noise,
            hint="Distribution; triangular is rand − rand (Ma'arif 2019).",
        )
        self._texts = {
            name: gui.add_text(label, typed(float(getattr(defaults, name))), hint=hint)
            for name, (label, hint) in SETTINGS.items()
        }
        button = gui.add_button("Generate", hint="Generate this signal and open it.")
        on_user(button.on_click, lambda _client: self._generate())

    def _generate(self) -> None:
        query = "&".join(f"{name}={text.value.strip()}" for name, text in self._texts.items())
        self._open_spec(f"synthetic:{self._shape.value}?noise={self._noise.value}&{query}", Failed.GENERATE)


# Recordings that come with Kalscope, the figures of the source documents, and their page with Table 1.


NONE = "–"

PAGE_NAME = "kalscope-papers.html"

AUTHORS = {"noise_reducer": "Ma'arif 2019", "generalized": "Khan", "lis302dl": "interactive matter 2009"}
"""Source documents, by what their experiments' names begin with."""


class SamplesView:
    """The folder "Samples and papers" of the Source tab."""

    def __init__(
        self, gui: viser.GuiApi, session: Session, jobs: Jobs, open_spec: Callable[[str, Failed], None]
    ) -> None:
        """Args: the usual; opens the source of this name."""
        self._jobs, self._stop = jobs, threading.Event()
        self._page: Reproduction | None = None
        self._samples = {sample_label(sample.title, sample.made): sample.name for sample in list_samples()}
        self._figures = {experiment_label(one): one.name for one in list_experiments()}
        with gui.add_folder("Samples and papers"):
            self._sample = gui.add_dropdown(
                "sample", (NONE, *self._samples), hint="Recordings that come with Kalscope."
            )
            self._figure = gui.add_dropdown(
                "re-created figure",
                (NONE, *self._figures),
                hint="Figures of the three source documents, which publish pictures and no data.",
            )
            page = gui.add_button(
                "Open the paper page", hint="Recomputes Table 1 and every figure, in about 10 s, as one page."
            )
            self._progress = gui.add_progress_bar(0.0, visible=False)
            self._cancel = gui.add_button("Cancel", visible=False, hint="Stop computing the page.")

        def open_sample() -> None:
            if (name := self._samples.get(self._sample.value)) is not None:
                open_spec(f"sample:{name}", Failed.OPEN)

        def open_figure() -> None:
            if (name := self._figures.get(self._figure.value)) is not None:
                session.request(lambda state: opened_experiment(name, state), failed=Failed.OPEN)

        on_user(self._sample.on_update, lambda _client: open_sample())
        on_user(self._figure.on_update, lambda _client: open_figure())
        on_user(page.on_click, self._open_page)
        on_user(self._cancel.on_click, lambda _client: self._stop.set())

    def _open_page(self, client: viser.ClientHandle) -> None:
        stop = self._stop = threading.Event()

        def work() -> None:
            from kalscope.papers.reproduction import reproduce  # with matplotlib, which starts slowly

            if self._page is None:  # the same at every run
                with SlowJobProgress(self._progress, self._cancel) as shown:
                    self._page = reproduce(progress=shown.report, cancelled=stop.is_set)
            show_page(client, self._page)

        self._jobs.run(work, Failed.REPRODUCE)

    def show(self, frame: Frame) -> None:
        """Show which sample or figure is open."""
        source = frame.state.recording.source
        for menu, names, kind in (
            (self._sample, self._samples, "sample:"),
            (self._figure, self._figures, "experiment:"),
        ):
            menu.value = next((label for label, name in names.items() if source == f"{kind}{name}"), NONE)


def sample_label(title: str, made: str) -> str:
    """A sample in the menu, and how it was made where it was not measured."""
    return f"{title} ({made})" if made else title


def experiment_label(experiment: Experiment) -> str:
    """Author and figure, short enough for a menu."""
    author = next(words for start, words in AUTHORS.items() if experiment.name.startswith(start))
    return f"{author}: {experiment.title.removeprefix('LIS302DL: ')}"


def show_page(client: viser.ClientHandle, page: Reproduction) -> None:
    """A window with Table 1, and the whole page as a download."""
    with client.gui.add_modal("Ma'arif 2019, Table 1") as window:
        client.gui.add_markdown(table_1(page))
        download = client.gui.add_button(
            "Download the whole page (HTML)", color=PRIMARY, hint="All figures and tables; one file."
        )
        close = client.gui.add_button("Close")

    def send(client: viser.ClientHandle) -> None:
        client.send_file_download(PAGE_NAME, page.html.encode(), save_immediately=True)

    on_user(download.on_click, send)
    on_user(close.on_click, lambda _client: window.close())


def table_1(page: Reproduction) -> str:
    """Table 1 as markdown, and how many reproduced numbers hold."""
    rows = [
        f"| {row['r']:g} | {row['q']:g} | "
        + " | ".join(f"{row[key]:.4f}" for key in ("printed", "simulated", "theoretical"))
        + " |"
        for row in page.results["noise_reducer"]["table_1"]
    ]
    head = "| R | Q | printed | simulated | theory |\n|---|---|---|---|---|\n"
    within = len(page.checks) - len(page.failed)
    said = f"{within} of {len(page.checks)} reproduced numbers of all three documents are within their tolerance."
    return f"Mean error of the filtered signal.\n\n{head}{chr(10).join(rows)}\n\n{said}"


# The source of the signal: a file, uploaded or by its path; the generator; and how the file was read.


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
        self._fleet = FleetView(gui, self._session, self._jobs, self._worker)
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
