"""What the thread that reads a port hands over, and how the port stands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Word = Literal["closed", "connecting", "connected", "disconnected, waiting"]


@dataclass(frozen=True)
class PortState:
    """How a port stands."""

    word: Word
    """closed, connecting, connected, or "disconnected, waiting" for the board to come back."""
    why: str = ""
    """A sentence without its full stop: what ended the connection or hinders it; "" where nothing does."""
    device: str = ""
    """What is, or was last, open: the path may change when a board is plugged in again."""
    since: float = 0.0
    """Monotonic time of the change to this word, s."""
    opened: int = 0
    """How many times the port was opened; all but the first are reconnects."""


@dataclass(frozen=True)
class Came:
    """Bytes of one read."""

    data: bytes
    """At least one byte."""
    begin: float
    """Monotonic time of the read before this one, or of the opening, s."""
    end: float
    """Monotonic time at which they were there, s."""


@dataclass(frozen=True)
class Opened:
    """The port is open; what comes next may begin inside a line."""

    at: float
    """Monotonic time, s."""


@dataclass(frozen=True)
class Lost:
    """The board is gone, or the port was closed; the line that was coming will not be finished."""

    at: float
    """Monotonic time, s."""


Item = Came | Opened | Lost
"""What the thread that reads a port hands over."""
