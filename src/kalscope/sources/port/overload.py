"""Lines that come faster than their consumer takes them are left out whole, and counted. Pure: no clock."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

from kalscope.sources.port.events import BytesReceived, LinesDropped

MAX_WAITING_BYTES = 4 << 20
"""Bytes that may wait for the consumer: 14 s of a port at 3 Mbaud. Beyond that lines are left out."""
RESUME_BYTES = MAX_WAITING_BYTES // 2
"""Bytes that still wait when lines are kept again: few long gaps are better than many short ones."""

_LINE_END = re.compile(rb"\r\n?|\n")


class LineCounter:
    r"""Counts the lines of a stream that comes in pieces, which end with \n, \r\n or \r."""

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


class Overload:
    """Decides which lines of a port are handed over while more bytes wait than may."""

    def __init__(self) -> None:
        self._lines = LineCounter()
        self._gap: LinesDropped | None = None
        self._is_cut = False

    @property
    def dropped(self) -> int:
        """Lines left out in the gap that is not over yet."""
        gap = self._gap
        return 0 if gap is None else gap.count

    @property
    def is_endless(self) -> bool:
        """Whether more bytes have come than may wait, and no end of a line among them."""
        gap = self._gap
        return gap is not None and gap.count == 0

    def take(self, received: BytesReceived, waiting: int) -> Iterator[LinesDropped | BytesReceived]:
        """What is handed over of the next bytes: all, nothing, or the gap that ends here and the lines after it.

        Args:
            received: what was read.
            waiting: bytes that the consumer has not taken yet.
        """
        data, gap = self._without_cut_end(received.data), self._gap
        if gap is None and waiting + len(data) <= MAX_WAITING_BYTES:
            self._lines.count(data)
            if data:
                yield received if len(data) == len(received.data) else replace(received, data=data)
            return
        first_end = _LINE_END.search(data) if waiting <= RESUME_BYTES else None
        cut = len(data) if first_end is None else first_end.end()
        begin, before = (received.begin, 0) if gap is None else (gap.begin, gap.count)
        self._gap = LinesDropped(before + self._lines.count(data[:cut]), begin, received.end)
        if first_end is not None:
            yield from self.end()
            self._is_cut = cut == len(data) and data.endswith(b"\r")
            if cut < len(data):
                self._lines.count(data[cut:])
                yield replace(received, data=data[cut:])

    def _without_cut_end(self, data: bytes) -> bytes:
        r"""The bytes without the \n of an \r\n whose \r ended a gap: it would read as a blank line."""
        cut, self._is_cut = self._is_cut and data.startswith(b"\n"), False
        if cut:
            self._lines.count(b"\n")
        return data[cut:]

    def end(self) -> Iterator[LinesDropped]:
        """The gap that is not over, if there is one: nothing follows."""
        gap, self._gap = self._gap, None
        if gap is not None:
            yield gap
