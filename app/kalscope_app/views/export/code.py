"""Code for a device: choose a target, preview its files, save or download them."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import viser

from kalscope.common.files import check_inside
from kalscope.common.text import typed_number
from kalscope.errors import BadSetting
from kalscope.export.device_period import rescaled_to_period
from kalscope.export.registry import TARGETS, export_tuning
from kalscope.export.write import limits_of, write_files
from kalscope.tuning.tuning import Tuning
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import State
from kalscope_app.views.binding import on_user
from kalscope_app.views.export.files import show_files, show_refusal
from kalscope_app.views.text import escape_markdown
from kalscope_app.views.window.css import PRIMARY

THIS, ALL = "this channel", "all channels"

TITLES = {target.title: name for name, target in TARGETS.items()}
"""Targets by the words on screen."""

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
    fixed_gains: bool = False
    """Only the settled filter, where the target has that choice."""


class CodeView:
    """The folder "Export code" of the Export tab. Files are made as jobs from the state on screen."""

    def __init__(
        self, gui: viser.GuiApi, session: Session, jobs: Jobs, tell: Callable[..., None], folder: Path
    ) -> None:
        self._session, self._jobs, self._tell, self._folder = session, jobs, tell, folder
        with gui.add_folder("Export code"):
            self._target = gui.add_dropdown("target", tuple(TITLES), hint="Where the filter will run.")
            self._what = gui.add_markdown(TARGETS["arduino"].what)
            self._limits = gui.add_markdown("", visible=False)
            self._channels = gui.add_dropdown("channels", (THIS, ALL), hint="Which filters the files contain.")
            self._vectors = gui.add_checkbox(
                "with test vectors",
                False,
                hint="groundtruth.csv: the first samples of this recording, raw and filtered.",
            )
            self._fixed = gui.add_checkbox(
                "fixed gains",
                False,
                hint="Only the settled filter: its gains never change, and one to three multiplications do.",
            )
            self._period = gui.add_text(
                "device sample period (s)",
                "",
                hint="q is converted to it. Empty: as recorded.",
            )
            look = gui.add_button("Preview code", hint="Shows the files, to read and copy.")
            self._name = gui.add_text(
                "folder", "export", hint="A new folder inside the one in which Kalscope was started."
            )
            save = gui.add_button("Save to the folder", color=PRIMARY, hint="Existing files are not overwritten.")
            download = gui.add_button("Download", hint="One file, or a zip of several.")
        on_user(self._target.on_update, lambda _client: self._show_target())
        for box in (self._channels, self._period):
            on_user(box.on_update, lambda _client: self._ask_limits())
        on_user(self._fixed.on_update, lambda _client: self._show_target())
        on_user(
            look.on_click, lambda client: self._with_files(client, lambda _target, files: show_files(client, files))
        )
        on_user(save.on_click, self._save)
        on_user(
            download.on_click,
            lambda client: self._with_files(client, lambda target, files: send_files(client, target, files)),
        )

    def _show_target(self) -> None:
        name = TITLES.get(self._target.value)
        self._what.content = "" if name is None else TARGETS[name].what
        self._fixed.visible = has_fixed_gains(name)
        self._vectors.visible = not self.choice.fixed_gains  # they are those of the whole filter
        self._ask_limits()

    def _ask_limits(self) -> None:
        self._jobs.run_with_state(self._session, lambda state: self.show_limits(limits_text(state, self.choice)))

    @property
    def choice(self) -> Choice:
        """What is chosen now."""
        target = TITLES.get(self._target.value, "")
        fixed = self._fixed.value and has_fixed_gains(target)
        return Choice(target, self._channels.value == ALL, self._period.value, fixed)

    def _save(self, client: viser.ClientHandle) -> None:
        name = self._name.value.strip()

        def save(_target: str, files: dict[str, str]) -> None:
            folder = check_inside(name, self._folder)
            if folder == self._folder.resolve() or any(part.startswith(".") for part in Path(name).parts):
                raise BadSetting(f"the folder must be named like export (got {name!r})")
            there = ", ".join(file for file in files if (folder / file).exists())
            if there:
                raise BadSetting(f"the folder must not hold these files yet: {there} (got {name!r})")
            written = write_files(files, folder)
            self._tell(f"Saved {', '.join(path.name for path in written)} in {folder}", good=True)

        self._with_files(client, save, Failed.SAVE)

    def _with_files(
        self,
        client: viser.ClientHandle,
        use: Callable[[str, dict[str, str]], None],
        failed: Failed = Failed.EXPORT,
    ) -> None:
        """Make the files of the state on screen, as a job, and hand them on; or say why there are none."""
        choice = self.choice
        vectors = self._vectors.value and not choice.fixed_gains

        def work(state: State) -> None:
            try:
                files = files_of(state, choice, vectors=vectors)
            except BadSetting as error:
                show_refusal(client, str(error))
            else:
                use(choice.target, files)

        self._jobs.run_with_state(self._session, work, failed)

    def show(self, frame: Frame) -> None:
        """One channel leaves no choice."""
        self._channels.visible = len(frame.state.recording.names) > 1

    def show_limits(self, text: str) -> None:
        """Show what differs on a small board."""
        self._limits.content, self._limits.visible = text, bool(text)


def has_fixed_gains(target: str | None) -> bool:
    """Whether the settled filter alone can be exported to a target."""
    return target is not None and target in TARGETS and TARGETS[target].fixed_gains is not None


def limits_text(state: State, choice: Choice = Choice()) -> str:
    """What will differ from the screen, as markdown; "" where nothing does. A study."""
    if not state.filter.is_standard:
        return "There is no code for the Khan et al. filter: choose *Kalman filter* in the Tune tab."

    def level(name: str) -> float:
        z = state.recording.channel(name)
        return float(np.abs(z[np.isfinite(z)]).max(initial=0.0)) or 1.0

    try:
        files_of(state, choice)  # what would be refused is said before a button is pressed
        limits = limits_of(*chosen(state, choice), choice.target, level, fixed_gains=choice.fixed_gains)
    except BadSetting as error:
        return f"This choice cannot be exported: {escape_markdown(str(error), 400)}"
    lines = [f"On a small board: {escape_markdown(limit, 400)}" for limit in limits]
    if state.dt is not None and np.any(np.abs(state.dt - 1.0) > UNEVEN):
        lines.append(GAPS)
    return "\n".join(f"- {line}" for line in lines)


def files_of(state: State, choice: Choice, *, vectors: bool = False) -> dict[str, str]:
    """The files of a choice for what is on screen, by name; with the test vectors if asked for.

    Raises:
        BadSetting: As `export_tuning`, and where a channel has the Khan et al. filter.
    """
    tuning, channel = chosen(state, choice)
    recording = state.recording if vectors else None
    return export_tuning(tuning, choice.target, channel=channel, vectors=recording, fixed_gains=choice.fixed_gains)


def chosen(state: State, choice: Choice) -> tuple[Tuning, str | None]:
    """The tuning of the device, and which of its channels is meant; None = all.

    Raises:
        BadSetting: The period is none, or a channel has the Khan et al. filter.
    """
    state.require_standard_filter(state.recording.names if choice.all_channels else [state.channel])
    tuning = state.as_tuning()
    if choice.period.strip():
        tuning = rescaled_to_period(tuning, typed_number("period", choice.period))
    return tuning, None if choice.all_channels else state.channel


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
