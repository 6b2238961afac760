"""The account of a recording."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class RecorderCounts:
    """The account of a recording: received = written + rejected + dropped, always. Recorders return copies."""

    received: int = 0
    """Lines with data, or that should have been data, that were written, rejected or dropped."""
    written: int = 0
    """Lines whose rows are in NAME.csv."""
    rejected: int = 0
    """Lines that are in NAME.rejects because they are not rows."""
    dropped: int = 0
    """Lines that are in neither: lost before they reached the recorder, while the disk was full for too long, or
    because another program truncated or deleted the file."""
    unwritable: int = 0
    """Of the dropped lines, those that the disk refused for too long."""
    removed: int = 0
    """Of the dropped lines, those that were in a file until another program truncated or deleted it."""
    waiting: int = 0
    """Lines in memory, because the disk refuses them; they count as received once written or dropped."""
    other: int = 0
    """Blank lines, comments, headers and text such as a boot message; the text is in NAME.rejects."""

    def __str__(self) -> str:
        """The account in words."""
        text = (
            f"received {self.received} lines = {self.written} written + {self.rejected} rejected"
            f" + {self.dropped} dropped"
        )
        text += f"; {self.other} other{'s' * (self.other != 1)}" if self.other else ""
        return text + (f"; another program removed {self.removed} written lines" if self.removed else "")

    def add_unwritable(self, lines: int) -> None:
        """Count lines that the disk did not take."""
        self.dropped += lines
        self.unwritable += lines

    def move_removed(self, lines: int) -> None:
        """Count lines that another program removed from a file after they were written."""
        self.written -= lines
        self.dropped += lines
        self.removed += lines
