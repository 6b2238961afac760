"""Code for a device: choose a target, preview its files, save or download them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import viser

from kalscope.common.files import check_inside
from kalscope.errors import BadSetting
from kalscope.estimation.finding import Request
from kalscope.export.registry import TARGETS
from kalscope.export.write import existing_files, in_sketch_folder, write_files
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import State
from kalscope_app.views.binding import offer, on_user
from kalscope_app.views.export.choice import (
    COMMON_TITLES,
    TITLES,
    Choice,
    DeviceNotes,
    device_notes,
    files_of,
    has_calibration,
    has_fixed_gains,
    packed,
    toggled,
)
from kalscope_app.views.export.files import ask_to_overwrite, show_files, show_refusal
from kalscope_app.views.window.css import PRIMARY

THIS, ALL = "this channel", "all channels"
MORE = "more …"

TARGET_HINT = (
    "Where it will run; more … lists every target. SimpleKalmanFilter and GyverFilters use q differently: "
    "take the Arduino sketch."
)


class CodeView:
    """The folder "Export code" of the Export tab. Files are made as jobs from the state on screen."""

    def __init__(
        self, gui: viser.GuiApi, session: Session, jobs: Jobs, tell: Callable[..., None], folder: Path
    ) -> None:
        self._session, self._jobs, self._tell, self._folder = session, jobs, tell, folder
        self._goal: Request | None = None
        self._title = COMMON_TITLES[0]
        with gui.add_folder("Export code"):
            self._target = gui.add_dropdown("target", (*COMMON_TITLES, MORE), hint=TARGET_HINT)
            self._what = gui.add_markdown(TARGETS["arduino"].what)
            self._period = gui.add_text(
                "device sample period (s)", "", hint="Time between two samples on the device. Empty: as recorded."
            )
            self._lag = gui.add_markdown("", visible=False)
            self._meet = gui.add_button("Meet the goal", visible=False, hint="Changes q in the exported code only.")
            self._limits = gui.add_markdown("", visible=False)
            look = gui.add_button("Preview code", hint="Shows the files, to read and copy.")
            self._name = gui.add_text("folder", "export", hint="Inside the folder in which Kalscope was started.")
            save = gui.add_button("Save to the folder", color=PRIMARY, hint="Asks before it overwrites a file.")
            download = gui.add_button("Download", hint="One file, or a zip of several.")
            self._build_options(gui)
        on_user(self._target.on_update, lambda _client: self._show_target())
        for box in (self._channels, self._period):
            on_user(box.on_update, lambda _client: self._ask_notes())
        for box in (self._fixed, self._calibration):
            on_user(box.on_update, lambda _client: self._show_target())
        on_user(self._meet.on_click, lambda _client: jobs.run_with_state(session, self._toggle_goal, Failed.EXPORT))
        on_user(
            look.on_click, lambda client: self._with_files(client, lambda _target, files: show_files(client, files))
        )
        on_user(save.on_click, self._save)
        on_user(
            download.on_click,
            lambda client: self._with_files(client, lambda target, files: send_files(client, target, files)),
        )

    def _build_options(self, gui: viser.GuiApi) -> None:
        with gui.add_folder("Options", expand_by_default=False) as self._options:
            self._channels = gui.add_dropdown("channels", (THIS, ALL), hint="Which filters the files contain.")
            self._vectors = gui.add_checkbox(
                "test vectors",
                False,
                hint="groundtruth.csv: the first samples of this recording, raw and filtered.",
            )
            self._fixed = gui.add_checkbox(
                "fixed gains", False, hint="Only the settled filter: one to three multiplications per sample."
            )
            self._calibration = gui.add_checkbox(
                "self-calibration", False, hint="The board measures r itself when it is asked to."
            )

    def _show_target(self) -> None:
        if self._target.value == MORE:
            offer(self._target, TITLES, self._title)
        self._title = self._target.value
        name = TITLES[self._title]
        self._what.content = TARGETS[name].what
        self._fixed.visible = has_fixed_gains(name)
        self._calibration.visible = has_calibration(name) and not self.choice.fixed_gains
        self._vectors.visible = not self.choice.fixed_gains  # they are those of the whole filter
        self._ask_notes()

    def _ask_notes(self) -> None:
        self._jobs.run_with_state(self._session, lambda state: self.show_notes(device_notes(state, self.choice)))

    def _toggle_goal(self, state: State) -> None:
        self._goal = toggled(self.choice, state).goal
        self.show_notes(device_notes(state, self.choice))

    @property
    def choice(self) -> Choice:
        """What is chosen now."""
        target = TITLES[self._title]
        fixed = self._fixed.value and has_fixed_gains(target)
        calibration = self._calibration.value and has_calibration(target) and not fixed
        everything = self._channels.value == ALL
        return Choice(target, everything, self._period.value, fixed, calibration, self._goal)

    def _save(self, client: viser.ClientHandle) -> None:
        name = self._name.value.strip()

        def save(_target: str, files: dict[str, str]) -> None:
            folder = check_inside(name, self._folder)
            if folder == self._folder.resolve() or any(part.startswith(".") for part in Path(name).parts):
                raise BadSetting(f"the folder must be named like export (got {name!r})")
            inside = in_sketch_folder(files)
            there = existing_files(inside, folder)
            if there:
                ask_to_overwrite(client, name, there, lambda: self._overwrite(inside, folder))
            else:
                self._write(inside, folder)

        self._with_files(client, save, Failed.SAVE)

    def _overwrite(self, files: dict[str, str], folder: Path) -> None:
        self._jobs.run(lambda: self._write(files, folder, force=True), Failed.SAVE)

    def _write(self, files: dict[str, str], folder: Path, *, force: bool = False) -> None:
        written = write_files(files, folder, force=force)
        place = written[0].parent.relative_to(self._folder.resolve()).as_posix()
        self._tell(f"Saved {', '.join(path.name for path in written)} in {place}", good=True)

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
        """One channel leaves no choice, and neither do fused sensors."""
        self._channels.visible = len(frame.state.recording.names) > 1 and frame.state.fusion is None

    def show_notes(self, notes: DeviceNotes) -> None:
        """Show the lag at the period of the device, and what differs there."""
        for text, line in ((self._lag, notes.lag), (self._limits, notes.limits)):
            text.content, text.visible = line, bool(line)
        if notes.offer:
            self._meet.label = notes.offer
        self._meet.visible = bool(notes.offer)


def send_files(client: viser.ClientHandle, target: str, files: dict[str, str]) -> None:
    """One file as it is, several as a zip."""
    name, content = packed(target, files)
    client.send_file_download(name, content, save_immediately=True)
