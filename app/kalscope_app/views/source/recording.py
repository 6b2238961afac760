"""Record what a board sends: the name, the buttons, and whoever watches over it while it runs."""

from __future__ import annotations

import re
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kalscope.common.files import check_inside
from kalscope.common.text import count
from kalscope.errors import BadFile, BadSetting
from kalscope.sources.recorder.paths import first_free
from kalscope_app.views.text import escape_markdown

if TYPE_CHECKING:
    from collections.abc import Callable

    import viser

    from kalscope.sources.live.live_source import LiveSource
    from kalscope.sources.live.live_status import RecordingStatus
    from kalscope.sources.recorder.counts import RecorderCounts
    from kalscope.sources.recorder.recorder import Recorder
    from kalscope_app.engine.jobs import Jobs

LOOK = 0.5
"""Seconds between two looks at a recording: a full disk must be announced within 2 s."""


class RecordingView:
    """The last part of the folder "Live board". Starting and stopping are jobs."""

    def __init__(
        self,
        gui: viser.GuiApi,
        jobs: Jobs,
        tell: Callable[..., None],
        folder: Path,
        connected: Callable[[], LiveSource | None],
    ) -> None:
        """Args: the usual, the folder to record into, and who knows the board that is connected."""
        self._jobs, self._tell, self._folder, self._connected = jobs, tell, folder, connected
        self._text = gui.add_markdown("")
        self._name = gui.add_text(
            "record to",
            first_free(folder / "recording.csv").name,
            hint="A new file in the folder in which Kalscope was started.",
        )
        self._record = gui.add_button("Record", visible=False, hint="Every line as received, before any filter.")
        self._stop = gui.add_button("Stop recording", visible=False, hint="Ends and closes the file.")
        self._record.on_click(self._on_record)
        self._stop.on_click(self._on_stop)

    async def _on_record(self, _event: viser.GuiEvent[Any]) -> None:
        name = self._name.value.strip()
        self._jobs.run(lambda: self._start(name))

    async def _on_stop(self, _event: viser.GuiEvent[Any]) -> None:
        self._jobs.run(self._end)

    def _start(self, name: str) -> None:
        path = check_inside(name, self._folder)
        if path.suffix != ".csv" or any(part.startswith(".") for part in Path(name).parts if part != "."):
            raise BadSetting(f"the recording must be named like recording.csv (got {name!r:.200})")
        source = self._connected()
        if source is None:
            raise BadSetting("a board must be connected before its lines are recorded (got none)")
        try:
            recorder = source.record(path)
        except BadFile:
            self._propose(path)
            raise
        self._tell(f"Recording to {path}", good=True)
        threading.Thread(
            target=self._watch, args=(source, recorder), name="kalscope-recording", daemon=True
        ).start()

    def _end(self) -> None:
        source = self._connected()
        recorder = source.recorder if source is not None else None
        if source is not None and recorder is not None:
            source.stop_recording()

    def _watch(self, source: LiveSource, recorder: Recorder) -> None:
        """Say at once what keeps lines from the disk, and at the end what was recorded, whatever is on screen."""
        said, rest = "", threading.Event()
        while source.recorder is recorder:
            news = recorder.error or recorder.warning
            if news and news != said:
                self._tell(f"{recorder.path.name}: {news}")
            said = news
            self._show_text(recording_text(source.status().recording))
            rest.wait(LOOK)
        done = recorder.close()  # waits until whoever ended it has closed the file
        self._tell(f"Recorded {recorder.path.name}: {account(done)}", good=not recorder.error)
        self._show_text("")
        self._propose(recorder.path)

    def _propose(self, path: Path) -> None:
        """A name near this one that is free."""
        stem = re.sub(r"_[0-9]+$", "", path.stem)
        free = first_free(path.with_name(f"{stem}{path.suffix}"))
        self._name.value = str(free.relative_to(self._folder.resolve()) if free.is_absolute() else free)

    def _show_text(self, text: str) -> None:
        if self._text.content != text:
            self._text.content = text

    def show(self, source: LiveSource | None) -> None:
        """Offer what can be done now; `source` is the board that is connected."""
        recording = source is not None and source.recorder is not None
        offered = source is not None and not recording
        for part, visible in ((self._name, not recording), (self._record, offered), (self._stop, recording)):
            if part.visible != visible:
                part.visible = visible


def recording_text(recording: RecordingStatus | None) -> str:
    """How the recording stands, as markdown; the name of the file is escaped."""
    if recording is None:
        return ""
    lines = [f"recording to **{escape_markdown(recording.name)}**", account(recording.counts)]
    if recording.counts.waiting:
        lines.append(f"{count(recording.counts.waiting)} lines wait in memory")
    lines += [f"**{escape_markdown(text, 200)}**" for text in (recording.error, recording.warning) if text]
    return "\n".join(f"- {line}" for line in lines)


def account(counts: RecorderCounts) -> str:
    """The account of a recording; it always adds up."""
    return (
        f"{count(counts.received)} lines = {count(counts.written)} written + {count(counts.rejected)} rejected"
        f" + {count(counts.dropped)} dropped"
    )
