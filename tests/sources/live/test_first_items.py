"""The first variables of a source are held until each has come once, in order and with their own moments."""

from queue import Empty, SimpleQueue

import pytest
from each import each

from kalscope.sources.live.source import HOLD_S, FirstItems
from kalscope.sources.port.events import BytesReceived, Disconnected, LinesDropped, Opened


class Held:
    """The items of a port, a clock that is set, and what is announced before the first is handed on."""

    def __init__(self, *items):
        self.queue, self.now, self.announced = SimpleQueue(), 0.0, []
        self.items = FirstItems(self.queue, lambda: self.now, self.announced.append)
        for item in items:
            self.queue.put(item)

    def taken(self):
        taken = []
        while True:
            try:
                taken.append(self.items.get(0.001))
            except Empty:
                return taken


OPENED = Opened(0.0, "at a line")


def received(data, at):
    return BytesReceived(data, at, at, 0.0)


def test_variables_are_held_and_announced_together():
    first = [received(b">a:1\n", 0.1), received(b">b:2\n", 0.2)]
    held = Held(OPENED, *first)
    held.now = 0.3
    assert held.taken() == [OPENED]
    assert held.announced == []
    held.now = 0.1 + HOLD_S
    assert held.taken() == first
    assert held.announced == [b">a:1\n>b:2\n"]
    later = received(b">c:3\n", 2.0)
    held.queue.put(later)
    assert held.taken() == [later]
    assert len(held.announced) == 1


@each(
    "item",
    [
        Disconnected(0.2),
        LinesDropped(3, 0.1, 0.2),
        received(b">b:2\n", 0.1 + HOLD_S),
        received(b">b\n" * (1 << 19), 0.2),
    ],
)
def test_what_releases_them_comes_behind_them(item):
    first = received(b">a:1\n", 0.1)
    assert Held(OPENED, first, item).taken() == [OPENED, first, item]


@each("opened", [OPENED, Opened(0.0)])
def test_lines_that_need_no_names_are_not_held(opened):
    data = received(b"1,2\n" if opened is OPENED else b">a:1\n", 0.1)
    held = Held(opened, data)
    assert held.taken() == [opened, data]
    assert held.announced == []


def test_nothing_is_made_up_while_nothing_comes():
    with pytest.raises(Empty):
        Held().items.get(0.001)
