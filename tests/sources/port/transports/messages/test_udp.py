"""udp://: datagrams of real sockets on loopback, none of them lost unseen."""

import socket
import time
from contextlib import closing

import numpy as np
import pytest
from tests.support.program import free_port

from kalscope.errors import BadDevice
from kalscope.sources.live import source
from kalscope.sources.live.source import LiveSource
from kalscope.sources.port import messages
from kalscope.sources.port.messages import UdpPort
from kalscope.sources.port.registry import port_of
from kalscope.sources.reading.recording_file import read_recording

pytestmark = pytest.mark.usefixtures("no_thread_left")


@pytest.fixture
def port():
    return free_port(socket.SOCK_DGRAM)


@pytest.fixture
def say(port):
    """Sends a datagram to the port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        yield lambda text: udp.sendto(text.encode(), ("127.0.0.1", port))


@pytest.fixture
def heard(port):
    live = LiveSource(f"udp://:{port}")
    live.start(require=True)
    yield live
    live.close()


def test_every_datagram_arrives_from_the_first_one_on(say, heard, wait_for):
    for i in range(2000):
        say(f"temp:{10 * i}:{i}|g\nhum:{10 * i}:{-i}§%\nstate:ok|t")
        if i % 20 == 0:
            time.sleep(0.001)
    wait_for(lambda: heard.status().received == 6000)
    status, recording = heard.status(), heard.snapshot().recording
    assert (status.accepted, status.rejected, status.dropped) == (4000, 0, 2000)
    assert (recording.names, recording.units) == (("temp", "hum"), ("", "%"))
    np.testing.assert_array_equal(recording.values, np.column_stack([np.arange(2000), -np.arange(2000)]))
    assert recording.time[-1] == pytest.approx(19.99)


def test_variables_that_come_in_turn_are_one_recording(say, heard, wait_for, tmp_path, monkeypatch):
    monkeypatch.setattr(messages, "HOLD_S", 3.0)  # on a busy machine the first six take their time
    recorder = heard.record(tmp_path / "run.csv")
    for i in range(5):
        for name in ("ax", "ay", "az", "gx", "gy", "gz"):
            say(f"{name}:{i}")
    wait_for(lambda: heard.status().accepted == 30)
    heard.close()
    assert recorder.paths == (tmp_path / "run.csv",)
    assert (recorder.counts.written, recorder.counts.dropped) == (30, 0)
    again = read_recording(tmp_path / "run.csv")
    assert again.names == ("ax", "ay", "az", "gx", "gy", "gz")
    assert [int(np.nansum(again.values[:, i])) for i in range(6)] == [10] * 6


def test_a_port_that_is_taken_and_an_address_of_another_machine(port, heard):
    for host, why in (("127.0.0.1", "Address already in use"), ("203.0.113.7", "Cannot assign requested address")):
        address = f"udp://{host}:{port}"
        with pytest.raises(BadDevice, match=rf"{address} cannot be opened \({why}\)"):
            LiveSource(address).start(require=True)


def test_a_source_from_which_nothing_arrives_says_what_to_check(port, say, heard, wait_for, monkeypatch):
    monkeypatch.setattr(source, "_SILENT_AFTER", 0.2)
    wait_for(lambda: f"udp://0.0.0.0:{port} is open to all networks" in heard.status().hint)
    monkeypatch.setattr(source, "_SILENT_AFTER", 60.0)
    say("a:1")
    wait_for(lambda: heard.status().accepted == 1 and heard.status().hint == "")


def test_only_this_machine_is_heard_unless_an_interface_is_named(port):
    with closing(UdpPort(port_of(f"udp://:{port}"), bool, None)) as opened:
        assert opened._socket.getsockname()[0] == "127.0.0.1"
