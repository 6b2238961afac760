"""Datagrams and messages of a broker become lines that the one line parser reads; udp:// with real sockets."""

import math
import socket
import time
from contextlib import closing

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.program import free_port

from kalscope.errors import BadDevice
from kalscope.sources.live import source
from kalscope.sources.live.source import LiveSource
from kalscope.sources.port import messages
from kalscope.sources.port.messages import MAX_PAYLOAD, UdpPort, lines_of, topic_lines
from kalscope.sources.port.registry import port_of
from kalscope.sources.reading.line_parser import LineParser
from kalscope.sources.reading.recording_file import read_recording

pytestmark = pytest.mark.usefixtures("no_thread_left")


def rows_of(*messages):
    """[(kind, {channel: value})] of messages as the parser reads them."""
    parser, found = LineParser(), []
    for message in messages:
        parser.feed(message)
        for event in parser:
            channels = parser.layout.channels if event.rows else ()
            values = {parser.layout.columns[i].name: event.rows[-1][i] for i in channels}
            found.append((event.kind, {name: x for name, x in values.items() if not math.isnan(x)}))
    return found


DATAGRAMS = {
    "temp:21.3|g": [{"temp": 21.3}], "temp:1500:21.3§°C|g,np": [{"temp": 21.3}], ">temp:21.3\n": [{"temp": 21.3}],
    "temp:1500:21.3;1510:21.5": [{"temp": 21.5}], "temp:1\nhum:2\r\n\n": [{"temp": 1.0}, {"hum": 2.0}],
    "512,300": [{"value 1": 512.0, "value 2": 300.0}], '{"temp": 21.5}': [{"temp": 21.5}], "": [],
}  # fmt: skip


def test_what_a_datagram_holds():
    for datagram, rows in DATAGRAMS.items():
        assert rows_of(lines_of(datagram.encode())) == [("row", row) for row in rows]


@pytest.mark.parametrize(("subscribed", "topic", "name"), [
    ("home/barn/temperature", "home/barn/temperature", "temperature"),
    ("home/+/temperature", "home/barn/temperature", "barn/temperature"),
    *(("home/#", "home/barn/temperature", "barn/temperature"), ("home/#", "home", "home")),
    *(("#", "home/barn", "home/barn"), ("+/+", "AA:BB/x>y", "AA_BB/x_y"), ("t", "t", "t")),
])  # fmt: skip
def test_a_topic_names_its_channel(subscribed, topic, name):
    assert rows_of(topic_lines(subscribed, topic, b"21.5")) == [("row", {name: 21.5})]


SENSOR = b'{"Time":"2026-11-23T10:00:00","AM2301":{"Temperature":21.3,"Humidity":40}}'


@pytest.mark.parametrize(("payload", "one", "of_many"), [
    (b"21.5", {"s": 21.5}, {"b/s": 21.5}), ("21.5 °C".encode(), {"s": 21.5}, {"b/s": 21.5}),
    (b'{"temp": 21.3}', {"temp": 21.3}, {"b/s.temp": 21.3}),
    (b"512,300", {"value 1": 512.0, "value 2": 300.0}, {"b/s[0]": 512.0, "b/s[1]": 300.0}),
    (b"temp:1 hum:2", {"temp": 1.0, "hum": 2.0}, {"b/s.temp": 1.0, "b/s.hum": 2.0}),
    (SENSOR, None, {"b/s.AM2301.Temperature": 21.3, "b/s.AM2301.Humidity": 40.0}),
])  # fmt: skip
def test_what_a_payload_holds(payload, one, of_many):
    def merged(lines):
        return {name: value for kind, row in rows_of(lines) for name, value in row.items()}

    assert one is None or merged(topic_lines("a/b/s", "a/b/s", payload)) == one
    assert merged(topic_lines("a/#", "a/b/s", payload)) == of_many


def test_a_payload_that_is_no_sample_is_counted():
    before = b">a:1\n"
    large = b"x" * (MAX_PAYLOAD + 1)
    for payload, kind in ((b"ON", "text"), (b"", "text"), (b"\x00\xff\xd8", "rejected"), (large, "rejected")):
        assert rows_of(before, topic_lines("home/#", "home/a", payload))[1:] == [(kind, {})]
    assert len(topic_lines("home/#", "home/a", large)) < 200


@pytest.mark.slow
@given(st.sampled_from(["home/#", "home/x"]), st.text(max_size=20), st.binary(max_size=300))
def test_no_message_breaks_a_line(subscribed, topic, data):
    lines = topic_lines(subscribed, topic, data)
    assert b"\r" not in lines
    assert all(text == b"" or text.endswith(b"\n") for text in (lines, lines_of(data)))
    assert rows_of(b"1,2\n" + lines_of(data) + b"3,4\n")[-1] == ("row", {"value 1": 3.0, "value 2": 4.0})


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
