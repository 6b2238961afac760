"""The thread that reads a port: every way a board goes is one calm state, and close frees the port."""

from itertools import count
from queue import Empty

import pytest
from scripted_port import ScriptedPort, scripted

from kalscope.errors import BadDevice
from kalscope.sources.port.reader import READ_TIMEOUT, BytesReceived, Clock, Disconnected, PortReader
from kalscope.sources.port.registry import PortSpec

pytestmark = pytest.mark.usefixtures("no_thread_left")


def taken(reader):
    """All items that are there."""
    items = []
    while True:
        try:
            items.append(reader.items.get_nowait())
        except Empty:
            return items


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (BadDevice("the cable was pulled"), "the cable was pulled"),
        (
            ValueError("filedescriptor out of range in select()"),
            "x was lost (filedescriptor out of range in select())",
        ),
        (RuntimeError(), "x was lost (RuntimeError)"),
    ],
)
def test_whatever_a_port_raises_it_is_closed_and_a_calm_state_says_why(wait_for, error, says):
    port = ScriptedPort([b"1\n", error], starts="at a line")
    reader = PortReader(PortSpec("x"), opener=scripted(port))
    reader.start()
    wait_for(lambda: reader.state.word == "disconnected, waiting")
    assert reader.state.reason == says
    assert port.closed
    reader.close()
    opened, *rest = taken(reader)
    assert opened.starts == "at a line"
    assert [type(item) for item in rest] == [BytesReceived, Disconnected]
    assert reader.state.word == "closed"


def test_whatever_is_raised_at_an_opening_or_a_write_is_one_sentence(wait_for):
    def broken(*_):
        raise RuntimeError("no driver")

    reader = PortReader(PortSpec("x"), opener=broken)
    with pytest.raises(BadDevice, match=r"x cannot be opened \(no driver\)"):
        reader.start(require=True)
    reader.start()  # a thread outlives it, too
    wait_for(lambda: reader.state.word == "disconnected, waiting")
    reader.close()
    port = ScriptedPort([])
    port.write = broken
    reader = PortReader(PortSpec("x"), opener=scripted(port))
    reader.start(require=True)
    with pytest.raises(BadDevice, match=r"x accepts no data \(no driver\)"):
        reader.write(b"1")
    reader.close()


def test_silence_is_time_in_which_reads_found_nothing_and_no_late_read(wait_for):
    ticks = count()  # a second for each look at the clock: all reads are late
    port = ScriptedPort([b"1", b"2", b"", b"", b"3", b"4"])
    reader = PortReader(PortSpec("x"), opener=scripted(port), clock=Clock(lambda: float(next(ticks))))
    reader.start()
    wait_for(lambda: not port.script)
    reader.close()
    items = [item for item in taken(reader) if isinstance(item, BytesReceived)]
    assert [item.silence for item in items] == [0, 0, 2 * READ_TIMEOUT, 0]
    moments = [moment for item in items for moment in (item.begin, item.end)]
    assert moments == sorted(moments)
    assert len(set(moments)) == 5
