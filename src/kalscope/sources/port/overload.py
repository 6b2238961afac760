"""Lines that come faster than their consumer takes them are left out whole, and counted. Pure: no clock."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import replace

from kalscope.sources.port.events import BytesReceived, LinesDropped

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
