"""Progress of a reader, and the wish to stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from kalscope.errors import Cancelled

Progress = Callable[[float, str], None]
"""Called with the fraction done, 0…1, and what is being done."""


@dataclass(frozen=True)
class Watch:
    """Whom to tell how far a reader is, and whom to ask whether to go on."""

    progress: Progress | None = None
    """Told how far it is; None = nobody looks."""
    cancelled: Callable[[], bool] | None = None
    """Asked whether to stop; None = never."""

    def tell(self, fraction: float, text: str) -> None:
        """Tell how far this is; raises Cancelled where the caller wants to stop."""
        if self.cancelled is not None and self.cancelled():
            raise Cancelled("reading was cancelled before it was finished")
        if self.progress is not None:
            self.progress(min(max(fraction, 0.0), 1.0), text)
