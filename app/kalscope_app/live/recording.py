"""Records what the connected board sends, and reports on it while it runs."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from kalscope.common.files import check_inside
from kalscope.common.text import count
from kalscope.errors import BadFile, BadSetting
from kalscope.sources.live.live_source import LiveSource
from kalscope.sources.live.live_status import RecordingStatus
from kalscope.sources.recorder.counts import RecorderCounts
from kalscope.sources.recorder.paths import first_free
from kalscope_app.session.session import Failed

if TYPE_CHECKING:
    from kalscope.sources.recorder.recorder import Recorder
    from kalscope_app.live.connection import BoardConnection

CHECK_EVERY = 0.5
"""Seconds between two checks of a recording: a full disk must be announced within 2 s."""


class BoardRecording:
    """Starts and stops the recording; both wait for the disk, so call them from a job."""

    def __init__(
        self, connection: BoardConnection, folder: Path, tell: Callable[..., None], wake: Callable[[], None]
    ) -> None:
        """Args: the connection; the folder to record into; how to notify the user; how to wake the engine."""
        self._connection, self._folder, self._tell, self._wake = connection, folder, tell, wake
        self.name = first_free(folder / "recording.csv").name
        """Name of a file that does not exist yet."""
        self.last: Path | None = None
        """The file that was recorded last."""
        self.on_change: Callable[[RecordingStatus | None], None] = lambda _status: None
        """Called with the status of the recording that runs, or with None when it has ended or `name` changed."""

    def start(self, name: str) -> None:
        """Record to a new file.

        Raises:
            BadSetting: no board is connected, or the name is not one for a recording.
            BadFile: the file exists already or cannot be written.
        """
        path = check_inside(name, self._folder)
        if path.suffix != ".csv" or any(part.startswith(".") for part in Path(name).parts if part != "."):
            raise BadSetting(f"the recording must be named like recording.csv (got {name!r:.200})")
        source = self._connection.source
        if source is None:
            raise BadSetting("no board is connected: connect one in the Source tab first")
        try:
            recorder = source.record(path)
        except BadFile:
            self._propose(path)
            raise
        self._tell(f"Recording to {path}", good=True)
        watch = partial(self._watch, source, recorder)
        threading.Thread(target=watch, name="kalscope-recording", daemon=True).start()

    def stop(self) -> None:
        """End and close the file; does nothing where no recording runs."""
        source = self._connection.source
        if source is not None:
            source.stop_recording()

    def _watch(self, source: LiveSource, recorder: Recorder) -> None:
        """Report at once what prevents lines from being written, and at the end what was recorded."""
        reported, pause = "", threading.Event()
        while source.recorder is recorder:
            problem = recorder.error or recorder.warning
            if problem and problem != reported:
                self._tell(f"Recording: {problem}", failed=Failed.RECORD)
            reported = problem
            self.on_change(source.status().recording)
            pause.wait(CHECK_EVERY)
        done = recorder.close()  # waits until the file is closed
        whole = not recorder.error and not done.removed
        self._tell(f"Recorded {recorder.files}: {account(done)}", good=whole, failed=Failed.RECORD)
        self.last = next(filter(Path.exists, recorder.paths), recorder.path)
        self._propose(recorder.path)
        self._wake()  # a board in the background is closed once it is no longer recorded

    def _propose(self, path: Path) -> None:
        """Propose a free name like this one."""
        stem = re.sub(r"_[0-9]+$", "", path.stem)
        free = first_free(path.with_name(f"{stem}{path.suffix}"))
        self.name = str(free.relative_to(self._folder.resolve()) if free.is_absolute() else free)
        self.on_change(None)


def account(counts: RecorderCounts) -> str:
    """The line counts of a recording; they always add up."""
    return (
        f"{count(counts.received)} lines = {count(counts.written)} written + {count(counts.rejected)} rejected"
        f" + {count(counts.dropped)} dropped"
    )
