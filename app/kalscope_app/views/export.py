"""The Export tab: code for a device, the report, the tuning file, the commands that reopen what is open."""

from __future__ import annotations

import io
import re
import threading
import zipfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import viser

from kalscope.common.files import check_inside
from kalscope.common.text import duration, lag_text, typed_number
from kalscope.errors import BadSetting
from kalscope.export.csv import filtered_csv_chunks
from kalscope.export.registry import (
    TARGETS,
    existing_files,
    export_tuning,
    in_sketch_folder,
    limits_of,
    sketch_name,
    write_files,
)
from kalscope.export.report import Report, as_html, make_report
from kalscope.filtering.steady import steady_state
from kalscope.tuning.file import dumps, save_tuning
from kalscope.tuning.tuning import Tuning, rescaled_to_period, same_period
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.guard.viser_private import take_upload
from kalscope_app.session.changes import ENDING, share_line, uploaded_settings, use_settings
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import State
from kalscope_app.views.widgets import escape_markdown, on_user
from kalscope_app.views.window import COPY_BUTTON, PRIMARY

# Dialogs in one browser: files to read and copy, and what would be overwritten.


WIDE = """<style>
.mantine-Modal-content:has(.kalscope-files) { flex: 0 0 min(72rem, 94vw); max-width: 94vw; }
.mantine-Modal-content:has(.kalscope-files) textarea {
  min-height: calc(100vh - 21rem) !important; font: 0.8rem/1.35 ui-monospace, monospace; white-space: pre;
  overflow: auto;
}
.mantine-Modal-content:has(.kalscope-files) .mantine-Flex-root > div:first-child { display: none; }
</style><span class="kalscope-files"></span>"""
"""viser's windows are 400 px wide and its text boxes 6 lines high, too small for code. A constant: it must never
contain text from outside."""


def show_files(client: viser.ClientHandle, files: dict[str, str]) -> None:
    """A window with a tab for each file, in a text box: plain text, so nothing in it can act."""
    with client.gui.add_modal("Preview code") as window:
        client.gui.add_html(WIDE)
        tabs = client.gui.add_tab_group()
        for name, text in files.items():
            with tabs.add_tab(name):
                client.gui.add_text(name, text, multiline=True)
                client.gui.add_button(COPY_BUTTON)
        _add_close(client, window)


def ask_to_overwrite(
    client: viser.ClientHandle,
    folder: str,
    names: Iterable[str],
    overwrite: Callable[[], object],
    other: str = "folder",
) -> None:
    """Ask in one browser whether existing files may be overwritten, or another folder or name is chosen."""
    with client.gui.add_modal("Overwrite files?") as window:
        there = ", ".join(escape_markdown(name, 80) for name in names)
        client.gui.add_markdown(f"These files exist in **{escape_markdown(folder, 200)}**: {there}. Overwrite?")
        yes = client.gui.add_button("Overwrite", color=PRIMARY)
        no = client.gui.add_button(f"Choose another {other}", hint="Saves nothing.")

    def accept() -> None:
        window.close()
        overwrite()

    on_user(yes.on_click, lambda _client: accept())
    on_user(no.on_click, lambda _client: window.close())


def _add_close(client: viser.ClientHandle, window: Any) -> None:
    on_user(client.gui.add_button("Close").on_click, lambda _client: window.close())


# What the user chose to export, what will differ on the device, and the files to export. Pure.


TITLES = {target.title: name for name, target in TARGETS.items()}
"""Targets by their names on screen."""
UNEVEN = 0.5
"""Periods by which a time step must differ from one before a device would show it."""

GAPS = (
    "On screen, gaps in time count. The code and the test vectors take one period per sample: pass a NaN to the "
    "device's filter for each missing sample."
)


@dataclass(frozen=True)
class Choice:
    """What the user chose to export."""

    target: str = "arduino"
    """A name of `TARGETS`."""
    all_channels: bool = False
    """Not only the channel on screen."""
    period: str = ""
    """Sample period of the device as it was typed, s; empty = that of the recording."""
    calibration: bool = False
    """With a sketch that measures r itself, where the target has that choice."""


@dataclass(frozen=True)
class DeviceNotes:
    """The texts below the choice."""

    lag: str
    """The lag at the period of the device, markdown; "" where it is not known."""
    limits: str
    """What will differ from the screen, markdown; "" where nothing does."""


def device_notes(state: State, choice: Choice = Choice()) -> DeviceNotes:
    """How the filter on screen will run on the device at this choice. A study."""
    lag = ""
    if state.is_standard:
        with suppress(BadSetting):  # the limits say why
            lag = _lag_note(state, choice)
    return DeviceNotes(lag, limits_text(state, choice))


def _lag_note(state: State, choice: Choice) -> str:
    """The lag on the device, and as recorded where that is at another period."""
    recorded, there = state.as_tuning(), device_tuning(state, choice)
    here, period = recorded.sample_period, there.sample_period
    if period is None:
        return ""
    lag, before = (
        lag_text(steady_state(one.channel(state.channel).params, one.sample_period).lag_samples, one.sample_period)
        for one in (there, recorded)
    )
    same = here is None or same_period(period, here)
    return (
        f"Lag **{lag}** at {duration(period)} per sample{', as recorded' if same else f'; {before} as recorded'}."
    )


def limits_text(state: State, choice: Choice = Choice()) -> str:
    """What will differ from the screen, as markdown; "" where nothing does."""
    if state.tuning.paper is not None:
        return "There is no code for the Khan et al. filter: choose *Kalman filter* in the Tune tab."

    def level(name: str) -> float:
        z = state.recording.channel(name)
        return float(np.abs(z[np.isfinite(z)]).max(initial=0.0)) or 1.0

    try:
        files_of(state, choice)  # shows why an export would be refused before a button is pressed
        tuning = device_tuning(state, choice)
        limits = limits_of(tuning, choice.target, level)
    except BadSetting as error:
        return f"Cannot export: {escape_markdown(str(error), 400)}"
    lines = [escape_markdown(f"{limit[:1].upper()}{limit[1:]}", 400) for limit in limits]
    if state.dt is not None and np.any(np.abs(state.dt - 1.0) > UNEVEN):
        lines.append(GAPS)
    return "\n".join(f"- {line}" for line in lines) if len(lines) > 1 else "".join(lines)


def files_of(state: State, choice: Choice, *, vectors: bool = False) -> dict[str, str]:
    """The files of a choice for what is on screen, by name; with the test vectors if asked for.

    Raises:
        BadSetting: As `export_tuning`, and where a channel has the Khan et al. filter.
    """
    recording = state.recording if vectors else None
    return export_tuning(
        device_tuning(state, choice),
        choice.target,
        vectors=recording,
        calibration=choice.calibration,
    )


def device_tuning(state: State, choice: Choice) -> Tuning:
    """The tuning of the device: the chosen channels, or the sensors that are fused, at its period.

    Raises:
        BadSetting: The period is not valid, or a channel has the Khan et al. filter.
    """
    tuning = state.as_tuning()
    if state.fusion is not None:
        sensors = tuple(one for one in tuning.channels if one.name in state.measured)
        tuning = replace(tuning, channels=sensors, selected="")
    else:
        state.require_exportable(state.recording.names if choice.all_channels else [state.channel])
        tuning = replace(tuning.only(None if choice.all_channels else state.channel), fusion=None)
    if not choice.period.strip():
        return tuning
    return rescaled_to_period(tuning, typed_number("period", choice.period))


def packed(target: str, files: dict[str, str]) -> tuple[str, bytes]:
    """Name and bytes of one download: one file as it is, several as a zip, a sketch in a folder of its name."""
    if len(files) == 1:
        name, text = next(iter(files.items()))
        return name, text.encode()
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in in_sketch_folder(files).items():
            archive.writestr(zipfile.ZipInfo(name, (2000, 1, 1, 0, 0, 0)), text)
    title = sketch_name(files) or f"kalscope-{re.sub(r'[^a-z0-9]+', '-', target)}"
    return f"{title}.zip", buffer.getvalue()


# Code for a device: choose a target, preview its files, save or download them.


THIS, ALL = "this channel", "all channels"


class CodeView:
    """The folder "Export code" of the Export tab. Files are made as jobs from the state on screen."""

    def __init__(
        self, gui: viser.GuiApi, session: Session, jobs: Jobs, tell: Callable[..., None], folder: Path
    ) -> None:
        self._session, self._jobs, self._tell, self._folder = session, jobs, tell, folder
        with gui.add_folder("Export code"):
            self._target = gui.add_dropdown("target", tuple(TITLES), hint="Where it will run.")
            self._what = gui.add_markdown(TARGETS["arduino"].what)
            self._period = gui.add_text(
                "device sample period (s)", "", hint="Time between two samples on the device. Empty: as recorded."
            )
            self._lag = gui.add_markdown("", visible=False)
            self._limits = gui.add_markdown("", visible=False)
            look = gui.add_button("Preview code", hint="Shows the files, to read and copy.")
            self._name = gui.add_text("folder", "export", hint="Inside the folder in which Kalscope was started.")
            save = gui.add_button("Save to the folder", color=PRIMARY, hint="Asks before it overwrites a file.")
            download = gui.add_button("Download", hint="One file, or a zip of several.")
            self._build_options(gui)
        on_user(self._target.on_update, lambda _client: self._show_target())
        for box in (self._channels, self._period, self._calibration):
            on_user(box.on_update, lambda _client: self._ask_notes())
        on_user(look.on_click, lambda client: self._with_files(lambda files: show_files(client, files)))
        on_user(save.on_click, self._save)
        on_user(download.on_click, lambda client: self._with_files(partial(self._send, client, self.choice.target)))

    def _build_options(self, gui: viser.GuiApi) -> None:
        with gui.add_folder("Options", expand_by_default=False) as self._options:
            self._channels = gui.add_dropdown("channels", (THIS, ALL), hint="Which filters the files contain.")
            self._vectors = gui.add_checkbox(
                "test vectors",
                False,
                hint="groundtruth.csv: the first samples of this recording, raw and filtered.",
            )
            self._calibration = gui.add_checkbox(
                "self-calibration", False, hint="The board measures r itself when it is asked to."
            )

    def _show_target(self) -> None:
        name = TITLES[self._target.value]
        self._what.content = TARGETS[name].what
        self._calibration.visible = TARGETS[name].can_calibrate
        self._ask_notes()

    def _ask_notes(self) -> None:
        self._jobs.run_with_state(self._session, lambda state: self.show_notes(device_notes(state, self.choice)))

    @property
    def choice(self) -> Choice:
        """What is chosen now."""
        target = TITLES[self._target.value]
        calibration = self._calibration.value and TARGETS[target].can_calibrate
        everything = self._channels.value == ALL
        return Choice(target, everything, self._period.value, calibration)

    def _save(self, client: viser.ClientHandle) -> None:
        name = self._name.value.strip()

        def save(files: dict[str, str]) -> None:
            folder = check_inside(name, self._folder)
            if folder == self._folder.resolve() or any(part.startswith(".") for part in Path(name).parts):
                raise BadSetting(f"the folder must be named like export (got {name!r})")
            inside = in_sketch_folder(files)
            write = partial(self._write, inside, folder, force=True)
            if there := existing_files(inside, folder):
                ask_to_overwrite(client, name, there, lambda: self._jobs.run(write, Failed.SAVE))
            else:
                self._write(inside, folder)

        self._with_files(save, Failed.SAVE)

    def _write(self, files: dict[str, str], folder: Path, *, force: bool = False) -> None:
        written = write_files(files, folder, force=force)
        place = written[0].parent.relative_to(self._folder.resolve()).as_posix()
        self._tell(f"Saved {', '.join(path.name for path in written)} in {place}", good=True)

    @staticmethod
    def _send(client: viser.ClientHandle, target: str, files: dict[str, str]) -> None:
        """One file as it is, several as a zip."""
        client.send_file_download(*packed(target, files), save_immediately=True)

    def _with_files(self, use: Callable[[dict[str, str]], None], failed: Failed = Failed.EXPORT) -> None:
        """Make the files of the state on screen, as a job, and hand them on."""
        choice, vectors = self.choice, self._vectors.value
        self._jobs.run_with_state(
            self._session, lambda state: use(files_of(state, choice, vectors=vectors)), failed
        )

    def show(self, frame: Frame) -> None:
        """One channel leaves no choice, and neither do fused sensors."""
        self._channels.visible = len(frame.state.recording.names) > 1 and frame.state.fusion is None

    def show_notes(self, notes: DeviceNotes) -> None:
        """Show the lag at the period of the device, and what differs there."""
        for text, line in ((self._lag, notes.lag), (self._limits, notes.limits)):
            text.content, text.visible = line, bool(line)


# The commands that reopen and filter what is open, to be copied into a terminal.


class CommandLineView:
    """A closed folder; what is typed into its box is overwritten."""

    def __init__(self, gui: viser.GuiApi) -> None:
        with gui.add_folder("Command line", expand_by_default=False):
            self._line = gui.add_text("reopen", "", multiline=True, hint="Opens what is on screen again.")
            gui.add_button(COPY_BUTTON, hint="Copies the line above.")
            self._text = gui.add_markdown("")

    def show(self, frame: Frame) -> None:
        """Write the lines."""
        shared = share_line(frame.state)
        self._line.value = shared.line
        self._text.content = " ".join(shared.remarks)


# The one-page report for the lab book, HTML, and the filtered signal as CSV.


PAGE = "One page on what is on screen: chart, parameters, tests, pinned settings, and how to reopen it."


class ReportView:
    """Three buttons in the Export tab; what they send is made as a job."""

    def __init__(self, gui: viser.GuiApi, session: Session, jobs: Jobs) -> None:
        def add(label: str, hint: str, name: str, make: Callable[[State], bytes]) -> None:
            def send(state: State, client: viser.ClientHandle) -> None:
                client.send_file_download(name, make(state), save_immediately=True)

            on_user(
                gui.add_button(label, hint=hint).on_click,
                lambda client: jobs.run_with_state(session, lambda state: send(state, client), Failed.SAVE),
            )

        with gui.add_folder("Report and data"):
            add("Download report", f"{PAGE} Prints on one sheet.", "report.html", html_report)
            add("Download filtered CSV", "Time, raw, filtered and variance of every channel.", "filtered.csv", csv)


def html_report(state: State) -> bytes:
    """The page as HTML."""
    return as_html(_report(state)).encode()


def csv(state: State) -> bytes:
    """The filtered signal of every channel, or the fused one of its sensors."""
    file = io.BytesIO()  # not one text and then its bytes: of 10 million samples each is 0.6 GB
    for text in _csv_chunks(state):
        file.write(text.encode())
    return file.getvalue()


def _csv_chunks(state: State) -> Iterator[str]:
    if state.fusion is not None:
        return filtered_csv_chunks(state.recording, [state.fusion.used])
    state.require_exportable(state.recording.names)
    return filtered_csv_chunks(state.recording, state.as_tuning().channels)


def _report(state: State) -> Report:
    if state.fusion is not None:
        return make_report(state.recording, state.as_tuning(), fusion=state.fusion.used)
    state.require_exportable([state.channel])
    pins = [(variant.name, variant.tuning) for variant in state.variants]
    return make_report(state.recording, state.as_tuning(), state.channel, command=share_line(state).line, pins=pins)


# The tuning file: saved, downloaded, and uploaded onto what is open.


DEFAULT_NAME = f"tuning{ENDING}"


class TuningFileView:
    """The folder "Tuning file" of the Export tab. Files are written as jobs."""

    def __init__(
        self, gui: viser.GuiApi, session: Session, jobs: Jobs, tell: Callable[..., None], folder: Path
    ) -> None:
        self._session, self._jobs, self._tell, self._folder = session, jobs, tell, folder
        self._building = threading.Lock()
        self._ours = set[Path]()  # files saved here: saving again asks nothing
        with gui.add_folder("Tuning file") as self._widgets:
            self._path = gui.add_text(
                "tuning file", DEFAULT_NAME, hint="A file name in the folder in which Kalscope was started."
            )
            save = gui.add_button("Save tuning file", hint="q, r, momentum, p0 and x0 of every channel.")
            download = gui.add_button("Download tuning file", hint="The same file, as a download.")
        on_user(save.on_click, self._ask_to_save)
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
