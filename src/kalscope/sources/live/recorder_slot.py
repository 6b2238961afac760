"""The recorder of a live source: it starts and stops while lines arrive, never during a write."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path

from kalscope.errors import BadSetting
from kalscope.sources.layout.sniffer import Layout
from kalscope.sources.lines.line_reader import LineEvent
from kalscope.sources.recorder.recorder import Recorder


class RecorderSlot:
    """Holds one recorder or none; lines written while no recorder is active are discarded."""

    def __init__(self) -> None:
        self._recorder: Recorder | None = None
        self._lock = threading.Lock()

    @property
    def recorder(self) -> Recorder | None:
        """The active recorder; None if there is none."""
        return self._recorder

    def begin(self, path: Path, *, source: str, started: float, wall: float, resume: bool) -> Recorder:
        """Record from now on; the arguments are those of `Recorder`.

        Raises:
            BadSetting: a recording is active already.
            BadFile: as `Recorder` raises it.
        """
        from kalscope.sources.recorder.recorder import Recorder

        with self._lock:
            if self._recorder is not None:
                raise BadSetting("a recording must be stopped before the next begins (got one that is running)")
            self._recorder = Recorder(path, source=source, started=started, wall=wall, resume=resume)
            return self._recorder

    def end(self) -> None:
        """End the recording and close its file; does nothing if none is active."""
        with self._lock:
            recorder, self._recorder = self._recorder, None
            if recorder is not None:
                recorder.close()

    def write(self, stamped: Sequence[tuple[float, LineEvent]], layout: Layout | None) -> None:
        """Write lines of one layout, each with its monotonic time in s."""
        with self._lock:
            if self._recorder is not None:
                self._recorder.write(stamped, layout)

    def gap(self, kind: str, seconds: float) -> None:
        """Note how long nothing was received, and why."""
        with self._lock:
            if self._recorder is not None:
                self._recorder.gap(kind, seconds)

    def drop(self, count: int) -> None:
        """Count lines that were lost before they arrived here."""
        with self._lock:
            if self._recorder is not None:
                self._recorder.drop(count)
