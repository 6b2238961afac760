"""The Export tab: code for a device, the report and data as downloads, the command that reopens what is open."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import viser

from kalscope.common.text import duration, lag_text, typed_number
from kalscope.errors import BadSetting
from kalscope.export.csv import filtered_csv_chunks
from kalscope.export.page import make_page
from kalscope.export.registry import TARGETS, export_tuning, in_sketch_folder, limits_of, sketch_name
from kalscope.export.report import as_html, make_report
from kalscope.filtering.steady import steady_state
from kalscope.tuning.file import dumps
from kalscope.tuning.tuning import Tuning, rescaled_to_period
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.changes import ENDING, share_line
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import State
from kalscope_app.views.widgets import add_button, escape_markdown, on_user, put
from kalscope_app.views.window import COPY_BUTTON, FILES, PRIMARY

# Files for one browser: to read and copy in a dialog, or as a download.


def show_files(client: viser.ClientHandle, files: dict[str, str], title: str = "Preview code") -> None:
    """A window with a tab for each file, in a text box: plain text, so nothing in it can act."""
    with client.gui.add_modal(title) as window:
        client.gui.add_html(FILES)
        tabs = client.gui.add_tab_group()
        for name, text in files.items():
            with tabs.add_tab(name):
                client.gui.add_text(name, text, multiline=True)
                client.gui.add_button(COPY_BUTTON)
        add_button(client.gui, "Close", None, lambda _client: window.close())


def send_file(client: viser.ClientHandle, name: str, content: bytes) -> None:
    """Have a browser save a file."""
    client.send_file_download(name, content, save_immediately=True)


# What the user chose to export, what will differ on the device, and the files to export. Pure.


TITLES = {target.title: name for name, target in TARGETS.items()}
"""Targets by their names on screen."""
UNEVEN = 0.5
"""Periods by which a time step must differ from one before a device would show it."""

GAPS = (
    "On screen, gaps in time count. The code takes one period per sample: pass a NaN to the device's filter "
    "for each missing sample."
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


def device_notes(state: State, choice: Choice = Choice()) -> str:
    """How the filter on screen will run on the device at this choice, as markdown. A study."""
    notes = [limits_text(state, choice)]
    if state.is_standard:
        with suppress(BadSetting):  # the limits say why
            there = device_tuning(state, choice)
            if (period := there.sample_period) is not None:
                lag = steady_state(there.channel(state.channel).params, period).lag_samples
                notes.insert(0, f"Lag **{lag_text(lag, period)}** at {duration(period)} per sample.")
    return "\n\n".join(filter(None, notes))


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


def files_of(state: State, choice: Choice) -> dict[str, str]:
    """The files of a choice for what is on screen, by name.

    Raises:
        BadSetting: As `export_tuning`, and where a channel has the Khan et al. filter.
    """
    return export_tuning(device_tuning(state, choice), choice.target, calibration=choice.calibration)


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


# Code for a device: choose a target, preview its files, download them.


THIS, ALL = "this channel", "all channels"


class CodeView:
    """The folder "Export code" of the Export tab. Files are made as jobs from the state on screen."""

    def __init__(self, gui: viser.GuiApi, session: Session, jobs: Jobs) -> None:
        self._session, self._jobs = session, jobs
        with gui.add_folder("Export code"):
            self._target = gui.add_dropdown("target", tuple(TITLES), hint="Where it will run.")
            self._what = gui.add_markdown(TARGETS["arduino"].what)
            self._channels = gui.add_dropdown("channels", (THIS, ALL), hint="Which filters the files contain.")
            hint = "Time between two samples on the device. Empty: as recorded."
            self._period = gui.add_text("device sample period (s)", "", hint=hint)
            hint = "The board measures r itself when it is asked to."
            self._calibration = gui.add_checkbox("self-calibration", False, hint=hint)
            self._notes = gui.add_markdown("", visible=False)
            add_button(gui, "Preview code", "Shows the files, to read and copy.", self._preview)
            add_button(gui, "Download code", "One file, or a zip of several.", self._send, color=PRIMARY)
        for box in (self._target, self._channels, self._period, self._calibration):
            on_user(box.on_update, lambda _client: self._show_choice())

    def _show_choice(self) -> None:
        target = TARGETS[self.choice.target]
        put(self._what, content=target.what)
        put(self._calibration, visible=target.can_calibrate)
        self._jobs.run_with_state(self._session, lambda state: self.show_notes(device_notes(state, self.choice)))

    @property
    def choice(self) -> Choice:
        """What is chosen now."""
        target = TITLES[self._target.value]
        calibration = self._calibration.value and TARGETS[target].can_calibrate
        return Choice(target, self._channels.value == ALL, self._period.value, calibration)

    def _preview(self, client: viser.ClientHandle) -> None:
        self._with_files(lambda files: show_files(client, files))

    def _send(self, client: viser.ClientHandle) -> None:
        target = self.choice.target
        self._with_files(lambda files: send_file(client, *packed(target, files)))

    def _with_files(self, use: Callable[[dict[str, str]], None]) -> None:
        """Make the files of the state on screen, as a job, and hand them on."""
        choice = self.choice
        self._jobs.run_with_state(self._session, lambda state: use(files_of(state, choice)), Failed.EXPORT)

    def show(self, frame: Frame) -> None:
        """One channel leaves no choice, and neither do fused sensors."""
        self._channels.visible = len(frame.state.recording.names) > 1 and frame.state.fusion is None

    def show_notes(self, notes: str) -> None:
        """Show the lag at the period of the device, and what differs there."""
        put(self._notes, content=notes, visible=bool(notes))


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


# Downloads: the one-page report for the lab book, the filtered signal, and the tuning file.


def add_downloads(gui: viser.GuiApi, session: Session, jobs: Jobs) -> None:
    """The folder "Report and data" of the Export tab; what its buttons send is made as a job."""

    def add(label: str, hint: str, name: str, make: Callable[[State], bytes]) -> None:
        def send(client: viser.ClientHandle) -> None:
            jobs.run_with_state(session, lambda state: send_file(client, name, make(state)), Failed.SAVE)

        add_button(gui, label, hint, send)

    with gui.add_folder("Report and data"):
        hint = "One page on what is on screen: chart, parameters, tests, pinned settings. Prints on one sheet."
        add("Download report", hint, "report.html", html_report)
        hint = "One file with the data and these sliders, which opens in any browser without Kalscope."
        add("Share as a page", hint, "page.html", shared_page)
        hint = "Time, raw, filtered and variance of every channel."
        add("Download filtered CSV", hint, "filtered.csv", csv)
        hint = "q, r, momentum, p0 and x0 of every channel; Source opens it."
        add("Download tuning file", hint, f"tuning{ENDING}", tuning_file)


def html_report(state: State) -> bytes:
    """The report on the channel on screen, or on the fused sensors, as HTML."""
    tuning = state.as_tuning()
    if state.fusion is not None:
        return as_html(make_report(state.recording, tuning, fusion=state.fusion.used)).encode()
    state.require_exportable([state.channel])
    pins = [(variant.name, variant.tuning) for variant in state.variants]
    line = share_line(state).line
    return as_html(make_report(state.recording, tuning, state.channel, command=line, pins=pins)).encode()


def shared_page(state: State) -> bytes:
    """Every channel with its filter and sliders, as HTML."""
    return make_page(state.recording, _every_channel(state).channels, state.channel).encode()


def csv(state: State) -> bytes:
    """The filtered signal of every channel, or the fused one of its sensors."""
    filters = [state.fusion.used] if state.fusion is not None else _every_channel(state).channels
    file = io.BytesIO()  # not one text and then its bytes: of 10 million samples each is 0.6 GB
    for text in filtered_csv_chunks(state.recording, filters):
        file.write(text.encode())
    return file.getvalue()


def tuning_file(state: State) -> bytes:
    """The tuning of every channel, as it is saved."""
    return dumps(_every_channel(state)).encode()


def _every_channel(state: State) -> Tuning:
    state.require_exportable(state.recording.names)
    return state.as_tuning()
