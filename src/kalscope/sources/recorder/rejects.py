"""NAME.rejects, the file of the lines of a recording that are not data; it exists once there is one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from kalscope.recording import LineIssue
from kalscope.sources.lines.line_reader import LineEvent
from kalscope.sources.recorder.append_file import AppendFile
from kalscope.sources.recorder.format import REJECTS_HEADER, preamble, rejects_lines
from kalscope.sources.recorder.paths import free_part, rejects_path
from kalscope.sources.recorder.repair import repair


class RejectsFile:
    """Takes lines with the reasons why they are not data."""

    def __init__(self, recording: Path, source: str) -> None:
        """Args: NAME.csv; what is recorded, as the command line names it."""
        self.file = AppendFile(rejects_path(recording))
        """The file itself."""
        self._source = source
        self._begun = False

    def resume(self) -> None:
        """Continue the file where there is one, because the recording is resumed.

        Raises:
            BadFile: it cannot be repaired.
        """
        if self.file.path.exists():
            self._begun = repair(self.file.path).kept > 0

    def continue_in_new(self, wall: float, at: float) -> Path:
        """Go on in NAME-2.rejects, because another program changed the file; returns the new path.

        Raises:
            OSError: It cannot be created.
        """
        _, path = free_part(self.file.path, 2)
        self.file = self.file.continued(path, preamble(self._source, wall, rejects=True) + REJECTS_HEADER, at)
        return path

    def put(
        self, host: float, at: float, wall: float, event: LineEvent, issues: Sequence[LineIssue], lines: int
    ) -> bool:
        """Queue a line with its reasons; False where it is lost because too much waits already.

        Args:
            host: Host time, s.
            at: Monotonic time, s.
            wall: Unix time at host time 0, s.
            event: The line.
            issues: Why it is not data, or which of its cells are not.
            lines: 1 where it counts as rejected, else 0.
        """
        if not self._begun:
            self._begun = True
            self.file.put_note(preamble(self._source, wall, rejects=True) + REJECTS_HEADER, at)
        text = rejects_lines(host, event.number, event.text, issues)
        return self.file.put(text.encode("utf-8", "backslashreplace"), at, lines)
