"""The events between the reader thread of a port and its consumer, and what is left out where it falls behind."""

from __future__ import annotations

import math
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from queue import Empty, SimpleQueue
from typing import Literal

# The clocks of a live source. Only the monotonic one measures; setting the wall clock changes nothing.


def _asleep() -> float:
    """Seconds that the machine has slept since it started, as far as the system reports it.

    Linux and macOS stop `time.monotonic` while the machine sleeps and have a second clock that continues; Windows
    does not stop it. Comparing with the wall clock would take every correction of that clock for a sleep.
    """
    boot = getattr(time, "CLOCK_BOOTTIME", None)  # Linux
    if boot is None and hasattr(time, "CLOCK_UPTIME_RAW"):  # macOS, whose CLOCK_MONOTONIC continues
        boot = time.CLOCK_MONOTONIC
    return 0.0 if boot is None else time.clock_gettime(boot) - time.monotonic()


@dataclass(frozen=True)
class Clock:
    """The clocks of a live source."""

    monotonic: Callable[[], float] = time.monotonic
    """Seconds that never step."""
    wall: Callable[[], float] = time.time
    """Seconds since 1970; read once for each recording, for its first line."""
    asleep: Callable[[], float] = _asleep
    """Seconds that the machine has slept; a rise of more than 1 s is a gap."""


SYSTEM = Clock()
"""The clocks of this machine."""


# The events that the reader thread of a port queues, and the state of the port.


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


# The events between the reader thread of a port and its consumer, with a count of what waits.


class EventQueue(SimpleQueue[Item]):
    """The events in order. What is taken counts as waiting until the consumer releases it."""

    def __init__(self) -> None:
        """An empty queue."""
        self._lock = threading.Lock()
        self.waiting = 0
        """Bytes that have not been released."""
        self.dropped = 0
        """Lines left out, in gaps that have not been released."""

    def put(self, item: Item, block: bool = True, timeout: float | None = None) -> None:
        """Add an event; never waits."""
        self._account(item, 1)
        super().put(item, block, timeout)

    def release(self, item: Item) -> None:
        """Note that these bytes no longer occupy the queue, or that these lines are counted elsewhere."""
        self._account(item, -1)

    def leave_out(self, received: BytesReceived) -> LinesDropped:
        """These bytes and all that wait after them, as lines that are left out: there is no time for them."""
        lines, dropped, end = LineCounter(), 0, received.end
        item: Item = received
        with suppress(Empty):
            while True:
                if isinstance(item, BytesReceived):
                    dropped, end = dropped + lines.count(item.data), item.end
                elif isinstance(item, LinesDropped):
                    dropped, end = dropped + item.count, item.end
                self.release(item)
                item = self.get_nowait()
        gap = LinesDropped(dropped, received.begin, end)
        self._account(gap, 1)
        return gap

    def _account(self, item: Item, sign: int) -> None:
        with self._lock:
            if isinstance(item, BytesReceived):
                self.waiting += sign * len(item.data)
            elif isinstance(item, LinesDropped):
                self.dropped += sign * item.count


# Lines that come faster than their consumer takes them are left out whole, and counted. Pure: no clock.


MAX_WAITING_BYTES = 4 << 20
"""Bytes that may wait for the consumer at first: 14 s of a port at 3 Mbaud. Beyond that lines are left out."""
MIN_WAITING_BYTES = 1 << 16
"""Bytes that may wait for even the slowest consumer: 5 s of 1,000 lines/s, which a disk may take for one write."""
MAX_AGE_S = 1.0
"""Once lines were left out, no more may wait than the consumer takes in this time, s: it shows what is new."""
HOLD_S = 60.0
"""Seconds since the last line that was left out after which MAX_WAITING_BYTES may wait again."""

_LINE_END = re.compile(rb"\r\n?|\n")


class LineCounter:
    r"""Counts the lines of a stream that arrives in pieces, which end with \n, \r\n or \r."""

    def __init__(self) -> None:
        self._after_cr = False

    def count(self, data: bytes) -> int:
        r"""How many lines end in the next piece; a \n right after the \r of the piece before ends none."""
        ends = data.count(b"\n") + data.count(b"\r") - data.count(b"\r\n")
        if self._after_cr and data.startswith(b"\n"):
            ends -= 1
        if data:
            self._after_cr = data.endswith(b"\r")
        return ends


class Pace:
    """How fast the consumer takes bytes; while none wait for it, it may be faster than the port."""

    def __init__(self) -> None:
        self.rate = 0.0
        """Bytes a second, over the last second or longer."""
        self._since, self._taken, self._is_idle = -math.inf, 0, True

    def note(self, at: float, taken: int, *, is_idle: bool) -> None:
        """Note that it has taken `taken` bytes by the monotonic time `at`, s; `is_idle`: none wait."""
        self._is_idle |= is_idle
        seconds = at - self._since
        if seconds >= 1.0:
            rate = (taken - self._taken) / seconds
            self.rate = max(rate, self.rate) if self._is_idle else rate
            self._since, self._taken, self._is_idle = at, taken, is_idle


class Overload:
    """Decides which lines of a port are passed on while more bytes wait than allowed."""

    def __init__(self) -> None:
        self._lines = LineCounter()
        self._gap: LinesDropped | None = None
        self._is_cut = False
        self._pace, self._handed = Pace(), 0
        self._full_from = -math.inf  # when MAX_WAITING_BYTES may wait again

    @property
    def dropped(self) -> int:
        """Lines left out in the gap that is not over yet."""
        gap = self._gap
        return 0 if gap is None else gap.count

    @property
    def is_endless(self) -> bool:
        """Whether more bytes have come than may wait, without a line end among them."""
        gap = self._gap
        return gap is not None and gap.count == 0

    def take(self, received: BytesReceived, waiting: int) -> Iterator[LinesDropped | BytesReceived]:
        """What is passed on of the next bytes: all, nothing, or the gap that ends here and the lines after it.

        Args:
            received: what was read.
            waiting: bytes that the consumer has not taken yet.
        """
        self._pace.note(received.end, self._handed - waiting, is_idle=waiting == 0)
        for item in self._taken(received, waiting):
            self._handed += len(item.data) if isinstance(item, BytesReceived) else 0
            yield item

    def _taken(self, received: BytesReceived, waiting: int) -> Iterator[LinesDropped | BytesReceived]:
        data, gap, most = self._without_cut_end(received.data), self._gap, self._most_waiting(received.end)
        if gap is None and waiting + len(data) <= most:
            self._lines.count(data)
            if data:
                yield received if len(data) == len(received.data) else replace(received, data=data)
            return
        self._full_from = received.end + HOLD_S
        # Few long gaps are better than many short ones.
        first_end = _LINE_END.search(data) if waiting <= most // 2 else None
        cut = len(data) if first_end is None else first_end.end()
        begin, before = (received.begin, 0) if gap is None else (gap.begin, gap.count)
        self._gap = LinesDropped(before + self._lines.count(data[:cut]), begin, received.end)
        if first_end is not None:
            yield from self.end()
            self._is_cut = cut == len(data) and data.endswith(b"\r")
            if cut < len(data):
                self._lines.count(data[cut:])
                yield replace(received, data=data[cut:])

    def _most_waiting(self, at: float) -> int:
        """Bytes that may wait at the monotonic time `at`, s."""
        if at >= self._full_from:
            return MAX_WAITING_BYTES
        return min(max(round(MAX_AGE_S * self._pace.rate), MIN_WAITING_BYTES), MAX_WAITING_BYTES)

    def _without_cut_end(self, data: bytes) -> bytes:
        r"""The bytes without the \n of an \r\n whose \r ended a gap: it would read as a blank line."""
        cut, self._is_cut = self._is_cut and data.startswith(b"\n"), False
        if cut:
            self._lines.count(b"\n")
        return data[cut:]

    def end(self) -> Iterator[LinesDropped]:
        """The gap that is still open, if there is one: nothing follows."""
        gap, self._gap = self._gap, None
        if gap is not None:
            yield gap
