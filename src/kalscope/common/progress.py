"""Progress of a long task, and whether to stop it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from kalscope.common.files import Unpacking
from kalscope.errors import Cancelled

OnProgress = Callable[[float, str], None]
"""Called with the fraction done, 0 … 1, and what is being done."""


@dataclass(frozen=True)
class Progress:
    """Reports the progress of a task, or of one part of it; itself an `OnProgress`."""

    report: OnProgress | None = None
    """Called with the progress of the whole task; None = not reported."""
    cancelled: Callable[[], bool] | None = None
    """Whether to stop; None = never."""
    start: float = 0.0
    """Fraction of the whole at which this part starts."""
    stop: float = 1.0
    """Fraction of the whole at which this part ends."""
    unpacking: Unpacking | None = None
    """Counts what is unpacked; None = not limited."""

    def __call__(self, fraction: float, text: str) -> None:
        """Report the fraction of this part that is done; raises Cancelled if the task is to stop."""
        if self.cancelled is not None and self.cancelled():
            raise Cancelled("the task was cancelled before it was finished")
        if self.report is not None:
            self.report(self.start + (self.stop - self.start) * min(max(fraction, 0.0), 1.0), text)

    def step(self, count: int, text: str) -> None:
        """Report that `count` steps are done, of a number that is not known."""
        self(1.0 - 0.8**count, text)

    def unpack(self, size: int) -> None:
        """Count `size` bytes that are unpacked; raises BadFile where they are too many."""
        if self.unpacking is not None:
            self.unpacking.add(size)

    def part(self, start: float, stop: float) -> Progress:
        """The part of this one from `start` to `stop`."""
        width = self.stop - self.start
        return replace(self, start=self.start + width * start, stop=self.start + width * stop)
