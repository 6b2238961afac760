"""What the user types for a port, and what the system lists."""

import pytest
from serial.tools.list_ports_common import ListPortInfo

from kalscope.catalogue import open_source
from kalscope.errors import BadSetting
from kalscope.sources.port.registry import PortSpec, is_live, port_of
from kalscope.sources.port.serial_port import PortInfo, list_ports

TYPED = {
    "serial:/dev/ttyACM0@9600": ("/dev/ttyACM0", 9600),
    "serial:/dev/ttyACM0": ("/dev/ttyACM0", 115200),
    "/dev/cu.usbmodem1101": ("/dev/cu.usbmodem1101", 115200),
    "COM3@9600": ("COM3", 9600),
    " serial:COM12@250000 ": ("COM12", 250000),
    "SERIAL:COM3@1": ("COM3", 1),
    "socket://192.168.1.20:3333": ("socket://192.168.1.20:3333", 115200),
    "UDP://[::1]:47269": ("UDP://[::1]:47269", 115200),
    "udp://:47269": ("udp://:47269", 115200),
    "mqtt://ada@[::1]:1883/home/ada%40x.org/t": ("mqtt://ada@[::1]:1883/home/ada%40x.org/t", 115200),
    "mqtt://broker/ada@x.org/t": ("mqtt://broker/ada@x.org/t", 115200),
    "ssh://me@pi:2222/home/a%40b/log.csv": ("ssh://me@pi:2222/home/a%40b/log.csv", 115200),
    "ssh://pi/home/a@b/log.csv": ("ssh://pi/home/a@b/log.csv", 115200),
    "file:/tmp/a:b@c/log.csv": ("file:/tmp/a:b@c/log.csv", 115200),
    "file:///tmp/a:b@c.csv": ("file:///tmp/a:b@c.csv", 115200),
}


@pytest.mark.parametrize("text", TYPED)
def test_a_port_is_read_as_it_is_typed_and_written(text):
    spec = port_of(text)
    assert spec == PortSpec(*TYPED[text])
    assert port_of(spec.text) == spec
    assert is_live(spec.text)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        *[(text, "got") for text in ("", "serial:", "serial:@9600", "COM3@-1", "COM3@0", "COM3@1e6")],
        *[(text, "baud rate must be a whole number") for text in ("COM3@", "/dev/serial/by-id/usb-a@b")],
        ("ssh://pi:2222/dev/ttyACM0@fast", r"baud rate must be a whole number.*'fast'"),
        *[
            (f"socket://{rest}", "must be socket://host:port")
            for rest in ("host", ":3333", "host:", "a:b", "a:70000")
        ],
        *[
            (f"udp://{rest}", "must be udp://host:port")
            for rest in ("", ":", ":0", ":70000", "a b:1", "1", "u@h:1")
        ],
        ("file:", "must be file:PATH"),
        ("loop://x", "must begin with one of"),
    ],
)
def test_what_names_no_port_is_refused_with_what_came(text, says):
    with pytest.raises(BadSetting, match=says):
        port_of(text)


@pytest.mark.parametrize("baud", [0, -1, 30_000_000, 9600.0, True, "9600"])
def test_a_baud_rate_is_a_whole_number_of_its_range(baud):
    with pytest.raises(BadSetting, match="baud rate"):
        PortSpec("COM3", baud)


LIVE = ["serial:x", "Serial:COM3@9600", "COM3", "COM3@9600", "/dev/ttyUSB0", "/dev/cu.usb@9600", "socket://"]
LIVE += ["/dev/pts/3", r"\\.\COM12"]
FINISHED = ["demo", "sample:flex_sensor", r"C:\x.csv", "C:/COM3.csv", "COM3.csv", "socket.csv", ""]
FINISHED += ["http://x/y.csv", "loop://x", "./serial", "/dev/null", "experiment:x", "a@9600"]


@pytest.mark.parametrize(("spec", "live"), [(s, True) for s in LIVE] + [(s, False) for s in FINISHED])
def test_a_port_streams_and_a_file_is_finished(spec, live):
    assert is_live(spec) is live
    if live:
        with pytest.raises(BadSetting, match="a board that streams"):
            open_source(spec)


@pytest.mark.parametrize(
    ("address", "shown"),
    [
        ("mqtt://ada@x.org:123/rest@host/topic", "mqtt://ada@x.org:…@host/topic"),
        ("mqtts://ada:123/re@st@host/topic", "mqtts://ada:…@host/topic"),
        ("ssh://ada:123/rest@host/dev/ttyACM0@9600", "ssh://ada:…@host/dev/ttyACM0"),
        ("tcp://ada:123/rest@host:3333", "tcp://ada:…@host:3333"),
    ],
)
def test_a_password_that_reads_as_a_port_is_refused_and_not_repeated(address, shown):
    with pytest.raises(BadSetting, match="must hold no password") as error:
        port_of(address)
    assert shown in str(error.value)
    assert "st@" not in str(error.value)


def test_ports_are_listed_by_name_with_what_the_system_says(monkeypatch):
    found = [ListPortInfo("COM10"), ListPortInfo("COM9")]
    vars(found[1]).update(description="Uno", serial_number="75", vid=0x2341, pid=0x43)
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: found)
    assert list_ports() == (PortInfo("COM9", "Uno", "75", (0x2341, 0x43)), PortInfo("COM10", "", ""))
