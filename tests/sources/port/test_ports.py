"""What the user types for a port, the thread that reads it, and a file that another program still writes."""

import errno
import os
import re
from itertools import count
from unittest.mock import Mock

import numpy as np
import pytest
from serial.tools.list_ports_common import ListPortInfo
from tests.sources.scripted_port import ScriptedPort, kept, scripted

from kalscope.catalogue import open_source
from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.live.source import LiveSource
from kalscope.sources.port import serial_port
from kalscope.sources.port.far_side import GrowingFile
from kalscope.sources.port.reader import READ_TIMEOUT, BytesReceived, Clock, Disconnected, PortReader
from kalscope.sources.port.registry import PortSpec, is_live, port_of
from kalscope.sources.port.serial_port import PortInfo, SerialPort, list_ports
from kalscope.sources.reading.recording_file import read_recording

pytestmark = pytest.mark.usefixtures("no_thread_left")

ADDRESSES = ["socket://192.168.1.20:3333", "UDP://[::1]:47269", "udp://:47269", "mqtt://broker/ada@x.org/t"]
ADDRESSES += ["mqtt://ada@[::1]:1883/home/ada%40x.org/t", "ssh://me@pi:2222/home/a%40b/log.csv"]
ADDRESSES += ["ssh://pi/home/a@b/log.csv", "file:/tmp/a:b@c/log.csv", "file:///tmp/a:b@c.csv"]
TYPED = {
    "serial:/dev/ttyACM0@9600": ("/dev/ttyACM0", 9600), "serial:/dev/ttyACM0": ("/dev/ttyACM0", 115200),
    "/dev/cu.usbmodem1101": ("/dev/cu.usbmodem1101", 115200), "COM3@9600": ("COM3", 9600),
    " serial:COM12@250000 ": ("COM12", 250000), "SERIAL:COM3@1": ("COM3", 1),
    **{address: (address, 115200) for address in ADDRESSES},
}  # fmt: skip


def test_a_port_is_read_as_it_is_typed_and_written():
    for text, expected in TYPED.items():
        spec = port_of(text)
        assert spec == PortSpec(*expected) == port_of(spec.text)
        assert is_live(spec.text)


BAD_RATE, NO_SSH = "baud rate must be a whole number.*", "an address must (be|hold no password)"
REFUSED = {
    "": ["", "serial:", "serial:@9600", "COM3@-1", "COM3@0", "COM3@1e6"],
    BAD_RATE: ["COM3@", "/dev/serial/by-id/usb-a@b", "ssh://user@pi", "ssh://pi:2222/dev/ttyACM0@fast"],
    "must be socket://host:port": ["socket://host", "socket://:3333", "socket://host:", "socket://a:b", "socket://a:70000"],
    "must be udp://host:port": [f"udp://{rest}" for rest in ("", ":", ":0", ":70000", "a b:1", "1", "u@h:1")],
    r"must be mqtt://\[user@\]broker": ["mqtt://broker", "mqtt://broker/", "mqtt:///a", "mqtt://broker:0/a"],
    "must be file:PATH": ["file:"], "must begin with one of": ["loop://x"],
    NO_SSH: [f"ssh://{rest}" for rest in (
        "", "pi", "/dev/ttyACM0", "a@b@pi/dev/ttyACM0", "pi:0/dev/ttyACM0", "pi:70000/dev/ttyACM0",
        "-oProxyCommand=touch x/dev/ttyACM0", "-oProxyCommand=x@pi/dev/ttyACM0", "pi;touch x/dev/ttyACM0",
        "$(touch x)/dev/ttyACM0", "user:secret@pi/dev/ttyACM0", "pi/dev/tty%0aACM0")],
}  # fmt: skip
"""Addresses that never reach a port, ssh or a broker, by what is said."""


@pytest.mark.parametrize("said", REFUSED)
def test_what_names_no_port_is_refused_with_what_came(said):
    for text in REFUSED[said]:
        with pytest.raises(BadSetting, match=f"{said}.*got"):
            port_of(text)


LIVE = ["serial:x", "Serial:COM3@9600", "COM3", "COM3@9600", "/dev/ttyUSB0", "/dev/cu.usb@9600", "socket://"]
LIVE += ["/dev/pts/3", r"\\.\COM12"]
FINISHED = ["demo", "sample:flex_sensor", r"C:\x.csv", "C:/COM3.csv", "COM3.csv", "socket.csv", ""]
FINISHED += ["http://x/y.csv", "loop://x", "./serial", "/dev/null", "experiment:x", "a@9600"]


def test_a_port_streams_and_a_file_is_finished():
    assert [spec for spec in LIVE + FINISHED if is_live(spec)] == LIVE
    for spec in LIVE:
        with pytest.raises(BadSetting, match="a board that streams"):
            open_source(spec)


PASSWORDS = {
    "mqtt://ada@x.org:123/rest@host/topic": "mqtt://ada@x.org:…@host/topic",
    "mqtts://ada:123/re@st@host/topic": "mqtts://ada:…@host/topic",
    "ssh://ada:123/rest@host/dev/ttyACM0@9600": "ssh://ada:…@host/dev/ttyACM0",
    "tcp://ada:123/rest@host:3333": "tcp://ada:…@host:3333",
}


def test_a_password_that_reads_as_a_port_is_refused_and_not_repeated():
    for address, shown in PASSWORDS.items():
        with pytest.raises(BadSetting, match=f"^(?!.*st@).*must hold no password.*{re.escape(shown)}"):
            port_of(address)


def test_ports_are_listed_by_name_with_what_the_system_says(monkeypatch):
    found = [ListPortInfo("COM10"), ListPortInfo("COM9")]
    vars(found[1]).update(description="Uno", serial_number="75", vid=0x2341, pid=0x43)
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: found)
    assert list_ports() == (PortInfo("COM9", "Uno", "75", (0x2341, 0x43)), PortInfo("COM10", "", ""))


@pytest.fixture
def raw(monkeypatch):
    """What pyserial opens."""
    raw = Mock()
    monkeypatch.setattr("serial.serial_for_url", lambda _device, **_: raw)
    return raw


@pytest.mark.parametrize(("error", "words"), [
    (FileNotFoundError(errno.ENOENT, "No such file"), "is not plugged in"),
    (PermissionError(errno.EACCES, "Permission denied"), "dialout"),
    (OSError(errno.EBUSY, "Device or resource busy"), "in use by another program"),
    (ValueError("Invalid baud rate: 3"), "opened at 115200 baud"),
])  # fmt: skip
def test_a_port_that_does_not_open_says_what_to_do(error, words, raw):
    raw.open.side_effect = error
    with pytest.raises(BadDevice, match=words):
        SerialPort(PortSpec("/dev/ttyX"), bool, None)
    raw.close.assert_called()


def test_a_board_is_found_again_under_another_name_by_its_serial_number(monkeypatch, raw):
    listed = [PortInfo("/dev/ttyACM0", "Uno", "75"), PortInfo("/dev/ttyACM1", "other", "9")]
    monkeypatch.setattr(serial_port, "list_ports", lambda: tuple(listed))
    first = SerialPort(PortSpec("/dev/ttyACM0"), bool, None)
    listed[0] = PortInfo("/dev/ttyACM7", "Uno", "75")
    assert SerialPort(PortSpec("/dev/ttyACM0"), bool, first).device == "/dev/ttyACM7"


def taken(reader):
    """All items that are there."""
    return [reader.items.get_nowait() for _ in range(reader.items.qsize())]


@pytest.mark.parametrize(("error", "says"), [
    (BadDevice("the cable was pulled"), "the cable was pulled"),
    (ValueError("filedescriptor out of range in select()"), "x was lost (filedescriptor out of range in select())"),
    (RuntimeError(), "x was lost (RuntimeError)"),
])  # fmt: skip
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
    assert (moments, len(set(moments))) == (sorted(moments), 5)


@pytest.fixture
def log(tmp_path):
    return tmp_path / "log.csv"


def add(path, text):
    with path.open("a") as file:
        file.write(text)


def test_a_file_that_was_moved_is_read_to_its_end(log):
    log.write_text("a\n")
    file = GrowingFile(str(log))
    file.read()
    moved = log.rename(log.with_suffix(".1"))
    assert file.read() == b""
    add(moved, "b\n")
    log.write_text("another\n")
    assert file.read() == b"b\n"
    file.close()


def test_what_is_no_file_is_refused_and_a_fifo_holds_up_nobody(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    for name, why in (("none", "No such"), ("fifo", "must be a file"), (".", "must be a file"), ("\0", "null")):
        with pytest.raises((OSError, ValueError), match=why):
            GrowingFile(str(tmp_path / name))
        with pytest.raises((BadDevice, BadSetting)):
            LiveSource(f"file:{tmp_path / name}").start(require=True)


RECORDED = """# kalscope recording 0.1.0
# source: serial:/dev/ttyACM0@115200
# started: 2026-11-21T10:46:04.123456Z
# host time: s since the start, by this computer's monotonic clock; the rest as the board sent it
host time [s],device time [ms],temp [°C],light
"""


@pytest.mark.slow
@pytest.mark.parametrize(("head", "row", "options"), [
    *((RECORDED, "{:.6f},{},{},7\n", {}), ("millis,heat\n", "{1},{2}\n", {})),
    *(("t,heat\n", "{1},{2}\n", {"time_unit": "ms"}), ("heat;light\n", "{2},5;1,5\n", {})),
    ("heat,light\n", "{2},1.5\n", {"rate": 50.0}), ("time,heat\n", "2026-11-21 10:46:{0:09.6f},{2}\n", {}),
])  # fmt: skip
def test_a_followed_file_is_what_it_is_when_it_is_opened(log, wait_for, head, row, options):
    ticks = [20 * i + (40_000 if i >= 500 else 0) for i in range(900)]  # the board was unplugged for 40 s
    rows = [row.format(tick / 1000, tick, i % 50) for i, tick in enumerate(ticks)]
    log.write_text(head + "".join(rows[:800]))
    with LiveSource(f"file:{log}", ReadOptions(**options)) as live:
        wait_for(lambda: kept(live) == 800)
        add(log, "".join(rows[800:]))
        wait_for(lambda: kept(live) == 900)
        seen, whole = live.snapshot().recording, read_recording(str(log), ReadOptions(**options))
    assert (seen.names, seen.units) == (whole.names, whole.units)
    np.testing.assert_array_equal(seen.values, whole.values)
    np.testing.assert_allclose(seen.time - seen.time[0], whole.time - whole.time[0], atol=1e-6)
    assert live.status().rejected == 0


@pytest.mark.slow
@pytest.mark.parametrize("is_moved", [False, True])
def test_a_replaced_file_is_a_gap_and_its_new_lines_follow(log, wait_for, is_moved):
    log.write_text("t [s],heat\n0,1\n0.1,2\n0.2,")
    with LiveSource(f"file:{log}") as live:
        wait_for(lambda: kept(live) == 2)
        if is_moved:
            log.rename(log.with_suffix(".1"))
        log.write_text("t [s],heat\n0,3\n0.1,4\n0.2")
        wait_for(lambda: kept(live) == 5)
        live.close()
        live.start()
        add(log, ",5\n")  # the half of a line that was read before is completed
        wait_for(lambda: kept(live) == 6)
        recording = live.snapshot().recording
        np.testing.assert_array_equal(recording.values[:, 0], [1, 2, np.nan, 3, 4, 5])
        assert (np.diff(recording.time) > 0).all()
        status = live.status()
        assert (status.received, status.accepted, status.rejected, status.dropped) == (8, 5, 0, 3)
        with pytest.raises(BadDevice, match="nothing can be sent there: it is only read"):
            live.send("q1")
