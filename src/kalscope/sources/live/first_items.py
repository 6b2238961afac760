"""The first items of a source whose messages each name one variable: held until each has likely come once.

Otherwise a board of six variables would begin with one, then two, then three: each time the charts would start
again, with a new part of the recording.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from queue import Empty, SimpleQueue

from kalscope.sources.port.events import BytesReceived, Item, Opened

HOLD_S = 0.5
"""Seconds for which the first variables are held: a board sends all at once, a broker all retained messages."""
_MAX_BYTES = 1 << 20


class FirstItems:
    """Passes on the items of a port in order, the first ones late where that helps."""

    def __init__(
        self, items: SimpleQueue[Item], monotonic: Callable[[], float], on_first: Callable[[bytes], None]
    ) -> None:
        """Wrap a queue.

        Args:
            items: The items of the port.
            monotonic: The clock of their stamps, s.
            on_first: Called once with all bytes that were held, before the first of them is passed on.
        """
        self._items, self._monotonic, self._on_first = items, monotonic, on_first
        self._held: list[BytesReceived] = []
        self._ready = deque[Item]()
        self._is_first = False

    def get(self, timeout: float) -> Item:
        """The next item; Empty where none came within `timeout` s."""
        while not self._ready:
            try:
                item = self._items.get(timeout=timeout)
            except Empty:
                if not self._held or self._monotonic() - self._held[0].end < HOLD_S:
                    raise
                self._release()
                continue
            if isinstance(item, Opened):
                self._is_first = item.starts == "at a line"
            if not self._holds(item):
                self._release()
                self._ready.append(item)
        return self._ready.popleft()

    def _holds(self, item: Item) -> bool:
        """Whether this is one of the first, and more may follow."""
        if isinstance(item, Opened):
            return False
        if not isinstance(item, BytesReceived) or not self._is_first:
            self._is_first = False
            return False
        self._held.append(item)
        size = sum(len(one.data) for one in self._held)
        waits = item.end - self._held[0].end < HOLD_S and size < _MAX_BYTES
        self._is_first = waits and self._held[0].data.startswith(b">")
        if not self._is_first:
            self._held.pop()
        return self._is_first

    def _release(self) -> None:
        held, self._held, self._is_first = self._held, [], self._is_first and not self._held
        if held:
            self._on_first(b"".join(item.data for item in held))
            self._ready.extend(held)
