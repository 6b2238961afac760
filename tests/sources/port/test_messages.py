"""Datagrams and messages of a broker become lines: udp:// with real sockets, mqtt:// with a real mosquitto."""

from __future__ import annotations

import math
import os
import shutil
import socket
import subprocess
import threading
import time
from contextlib import closing
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.program import free_port
from tests.support.required import needs, not_here
from tests.support.waiting import wait_until

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.live import source
from kalscope.sources.live.source import LiveSource
from kalscope.sources.port import messages
from kalscope.sources.port.messages import MAX_PAYLOAD, MqttPort, UdpPort, lines_of, topic_lines
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


class Broker:
    """A broker for the time of a block, which can be killed and started again at the same port."""

    def __init__(self, folder: Path, *lines: str) -> None:
        """`folder` is for its files, `lines` go into its configuration."""
        found = shutil.which("mosquitto", path=os.environ.get("PATH", "") + ":/usr/sbin")
        self.port, config = free_port(), folder / "mosquitto.conf"
        self.address = f"mqtt://127.0.0.1:{self.port}"
        own = [f"listener {self.port} 127.0.0.1", f"user {os.environ.get('USER', 'root')}", "log_dest none"]
        config.write_text("\n".join([*own, *(lines or ("allow_anonymous true",))]) + "\n")
        self._command = [found or not_here("mosquitto is not installed"), "-c", config]

    def __enter__(self) -> Broker:
        """Start, and wait until it listens."""
        self._process = subprocess.Popen(self._command, stderr=subprocess.DEVNULL)
        wait_until(self._listens, "the broker to listen")
        return self

    def _listens(self) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def __exit__(self, *_: object) -> None:
        """End it without a word to its clients."""
        self._process.kill()
        self._process.wait()


def publish(broker: Broker, *messages: tuple[object, ...]) -> None:
    """Publish (topic, payload, qos, retain) one after the other."""
    import paho.mqtt.publish as paho

    paho.multiple(messages, "127.0.0.1", broker.port)


needs("paho")
CONNECTED, REFUSED, NOT_SUBSCRIBED = b"\x20\x02\0\0", b"\x20\x02\0\x03", b"\x90\x03\0\x01\x80"
"""What a broker says: yes; not now; not this topic."""
NO_CODE = b"\x90\x02\0\x01"
"""Its answer to a subscription without the code that one must have."""


@pytest.fixture(scope="module")
def open_broker(tmp_path_factory):
    with Broker(tmp_path_factory.mktemp("broker")) as running:
        yield running


def opened(address):
    """A live source that is connected; the caller closes it."""
    live = LiveSource(address)
    live.start(require=True)
    return live


def refusal(address):
    """Why a source cannot be opened."""
    with pytest.raises(BadDevice) as error:
        LiveSource(address).start(require=True)
    return str(error.value)


@pytest.mark.slow
def test_every_message_arrives_and_the_topics_are_the_channels(open_broker, wait_for, tmp_path):
    air = "home/barn/air"
    publish(open_broker, (f"{air}/temperature", "9", 1, True), (air, '{"hum": 9}', 1, True))
    live = opened(f"{open_broker.address}/home/+/air/#")
    recorder = live.record(tmp_path / "run.csv")
    for i in range(0, 1000, 250):
        pairs = [
            ((f"{air}/temperature", f"{n}"), (air, f'{{"hum": {-n}, "at": "noon"}}')) for n in range(i, i + 250)
        ]
        publish(open_broker, *chain(*pairs))
    publish(open_broker, (f"{air}/state", "ON", 1), (f"{air}/picture", b"\xff\xd8\x00" * 1000, 1))
    wait_for(lambda: live.status().received == 2002)
    live.close()
    status, recording = live.status(), live.snapshot().recording
    assert (status.accepted, status.rejected, status.dropped) == (2000, 1, 1)
    assert set(recording.names) == {"barn/air/temperature", "barn/air.hum"}
    for name, sign in (("barn/air/temperature", 1), ("barn/air.hum", -1)):
        values = recording.channel(name)
        assert sorted(sign * values[np.isfinite(values)]) == list(range(1000))
    assert recorder.paths == (tmp_path / "run.csv",)
    assert (recorder.counts.written, recorder.counts.rejected, recorder.counts.dropped) == (2000, 1, 0)
    assert len(read_recording(tmp_path / "run.csv")) == 2000


@pytest.mark.slow
def test_a_broker_that_is_killed_is_waited_for(tmp_path, wait_for):
    with Broker(tmp_path) as running:
        live = opened(f"{running.address}/t")
        running.__exit__()
        wait_for(lambda: live.status().word == "disconnected, waiting")
        wait_for(lambda: "cannot be opened (Connection refused)" in live.status().hint)
        running.__enter__()
        wait_for(lambda: live.status().word == "connected")
        publish(running, ("t", "21.5"))
        wait_for(lambda: live.status().accepted == 1)
        assert live.status().reconnects == 1
        live.close()
    assert live.snapshot().recording.names == ("t",)


def test_a_password_comes_from_the_environment(tmp_path, monkeypatch):
    made = shutil.which("mosquitto_passwd") or not_here("mosquitto_passwd is not installed")
    subprocess.run([made, "-b", "-c", tmp_path / "passwords", "ada", "correct horse"], check=True)
    says = "refuses this user or this topic (reason code 135): mqtt://user@127.0.0.1/…, and set KALSCOPE_MQTT_PASS"
    with Broker(tmp_path, "allow_anonymous false", f"password_file {tmp_path}/passwords") as running:
        address = f"mqtt://ada@127.0.0.1:{running.port}/home/#"
        assert says in refusal(address)
        assert says in refusal(address.replace("ada@", ""))
        monkeypatch.setenv("KALSCOPE_MQTT_PASSWORD", "wrong")
        assert says in refusal(address)
        monkeypatch.setenv("KALSCOPE_MQTT_PASSWORD", "correct horse")
        opened(address).close()


def test_a_broker_over_tls_must_be_trusted(tmp_path, monkeypatch):
    line = (
        "req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -keyout own.key -out own.pem -subj /CN=test"
        " -days 9 -addext subjectAltName=IP:127.0.0.1 -addext keyUsage=critical,keyCertSign,digitalSignature"
    )
    tool = shutil.which("openssl") or not_here("openssl is not installed")
    subprocess.run([tool, *line.split()], cwd=tmp_path, check=True, capture_output=True)
    keys = (f"certfile {tmp_path}/own.pem", f"keyfile {tmp_path}/own.key")
    with Broker(tmp_path, "allow_anonymous true", *keys) as running:
        address = f"mqtts://127.0.0.1:{running.port}/t"
        assert "certificate verify failed" in refusal(address)
        monkeypatch.setenv("SSL_CERT_FILE", str(tmp_path / "own.pem"))
        opened(address).close()


def hang_up(listening, *answers):
    """A broker that says so much, a part after each packet that it hears, and hangs up after one more."""
    with listening.accept()[0] as connection:
        for answer in answers:
            connection.recv(4096)
            connection.sendall(answer)
        connection.recv(4096)


def test_a_server_that_stays_silent_is_given_up_at_once_where_nobody_waits():
    with socket.create_server(("127.0.0.1", 0)) as mute:
        asked = iter([False, False, True])
        with pytest.raises(TimeoutError, match="no answer within 5 s"):
            MqttPort(port_of(f"mqtt://127.0.0.1:{mute.getsockname()[1]}/t"), lambda: next(asked), None)


def test_what_is_no_broker(open_broker):
    assert "cannot be opened (Connection refused)" in refusal(f"mqtt://127.0.0.1:{free_port()}/t")
    assert "no.such.host.invalid/t cannot be opened (" in refusal("mqtt://no.such.host.invalid/t")
    assert "cannot be opened (" in refusal(f"mqtts://127.0.0.1:{open_broker.port}/t")
    with socket.create_server(("127.0.0.1", 0)) as mute:
        for answers, said in (
            ((), "closed the connection"),
            ((CONNECTED, NOT_SUBSCRIBED), "refuses this user or this topic"),
            ((CONNECTED, NO_CODE), "refuses this user or this topic"),
            ((REFUSED,), "(reason code 136)"),
        ):
            threading.Thread(target=hang_up, args=(mute, *answers)).start()
            assert said in refusal(f"mqtt://127.0.0.1:{mute.getsockname()[1]}/t")
    assert "cannot be opened (Invalid subscription filter.)" in refusal(f"{open_broker.address}/a/#/b")


def test_a_library_that_is_missing_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "paho.mqtt.client", None)
    with pytest.raises(BadSetting, match=r'needs paho-mqtt: pip install "kalscope\[mqtt\]"'):
        LiveSource("mqtt://broker/t")
