"""The events between the reader thread of a port and its consumer, with a count of what waits."""

from __future__ import annotations

import threading
from contextlib import suppress
from queue import Empty, SimpleQueue

from kalscope.sources.port.events import BytesReceived, Item, LinesDropped
from kalscope.sources.port.overload import LineCounter


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
