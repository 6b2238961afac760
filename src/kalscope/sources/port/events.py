"""The events that the reader thread of a port queues, and the state of the port."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Word = Literal["closed", "connecting", "connected", "disconnected, waiting"]
Start = Literal["inside a line", "at a line", "where it stopped"]
"""Where the first byte after an opening is: in general inside a line, of which the beginning is lost; at the
beginning of a line, as that of a message or a file; or right after the last whole line of the opening before."""


@dataclass(frozen=True)
class PortState:
    """The state of a port."""

    word: Word
    """closed, connecting, connected, or "disconnected, waiting" for the board to come back."""
    reason: str = ""
    """What ended or prevents the connection, a sentence without its full stop; "" if nothing does."""
    device: str = ""
    """The device that is, or was last, open: the path may change when a board is plugged in again."""
    since: float = 0.0
    """Monotonic time of the change to this word, s."""
    opened: int = 0
    """How many times the port was opened; all but the first are reconnects."""


@dataclass(frozen=True)
class BytesReceived:
    """Bytes of one read."""

    data: bytes
    """At least one byte."""
    begin: float
    """Monotonic time of the previous read, or of the opening, s."""
    end: float
    """Monotonic time at which they had arrived, s."""
    silence: float
    """Seconds before them in which reads found nothing: not those in which this machine did not read."""


@dataclass(frozen=True)
class Opened:
    """The port is open."""

    at: float
    """Monotonic time, s."""
    starts: Start = "inside a line"
    """Where the next bytes begin."""
    keeps: bool = False
    """True where the other side keeps its lines, as a file does: the times in them can then be trusted."""


@dataclass(frozen=True)
class Disconnected:
    """The board was lost or the port closed; the current line will not be finished."""

    at: float
    """Monotonic time, s."""


@dataclass(frozen=True)
class LinesDropped:
    """Lines were left out, because too many bytes waited; the next bytes begin a line."""

    count: int
    """How many, including the one whose beginning was passed on."""
    begin: float
    """Monotonic time of the first of their bytes, s."""
    end: float
    """Monotonic time of the next line that is kept, s."""


Item = BytesReceived | Opened | LinesDropped | Disconnected
"""An event of the reader thread."""
