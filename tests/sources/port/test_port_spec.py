"""What the user types for a port, and what the system lists."""

import pytest
from each import each
from serial.tools.list_ports_common import ListPortInfo

from kalscope.catalogue import open_source
from kalscope.errors import BadSetting
from kalscope.sources.port.registry import PortSpec, is_live, port_of
from kalscope.sources.port.serial_port import PortInfo, list_ports


@each(
    ("text", "url", "baud"),
    [
        ("serial:/dev/ttyACM0@9600", "/dev/ttyACM0", 9600),
        ("serial:/dev/ttyACM0", "/dev/ttyACM0", 115200),
        ("COM3@9600", "COM3", 9600),
        ("serial:COM12@250000", "COM12", 250000),
        ("/dev/cu.usbmodem1101", "/dev/cu.usbmodem1101", 115200),
        ("/dev/serial/by-id/usb-a@b", "/dev/serial/by-id/usb-a@b", None),
        ("socket://192.168.1.20:3333", "socket://192.168.1.20:3333", 115200),
        ("rfc2217://host:4000@57600", "rfc2217://host:4000", 57600),
        (" serial:COM3@74880 ", "COM3", 74880),
        ("SERIAL:COM3@1", "COM3", 1),
    ],
)
def test_a_port_is_read_as_it_is_typed(text, url, baud):
    if baud is None:
        with pytest.raises(BadSetting, match="COM3@9600"):
            port_of(text)
        return
    assert port_of(text) == PortSpec(url, baud)


@each("text", ["serial:/dev/ttyACM0@9600", "COM3", "socket://a:1", "rfc2217://a:1@300"])
def test_a_port_written_is_the_port_read(text):
    spec = port_of(text)
    assert port_of(spec.text) == spec
    assert is_live(spec.text)


@each("text", ["", "serial:", "serial:@9600", "COM3@", "COM3@fast", "COM3@-1", "COM3@0", "COM3@1e6"])
def test_what_names_no_port_is_refused_with_what_came(text):
    with pytest.raises(BadSetting, match="got"):
        port_of(text)


@each("baud", [0, -1, 30_000_000, 9600.0, True, "9600"])
def test_a_baud_rate_is_a_whole_number_of_its_range(baud):
    with pytest.raises(BadSetting, match="baud rate"):
        PortSpec("COM3", baud)


LIVE = ["serial:x", "Serial:COM3@9600", "COM3", "COM3@9600", "/dev/ttyUSB0", "/dev/cu.usb@9600", "socket://h:1"]
LIVE += ["rfc2217://h:1", "/dev/pts/3", r"\\.\COM12", "socket://"]
FINISHED = [
    "demo",
    "sample:flex_sensor",
    "synthetic:sine",
    r"C:\x.csv",
    "C:/COM3.csv",
    "COM3.csv",
    "socket.csv",
    "",
]
FINISHED += ["http://x/y.csv", "loop://x", "./serial", "/dev/null", "experiment:x", "a@9600"]


@each(("spec", "live"), [(s, True) for s in LIVE] + [(s, False) for s in FINISHED])
def test_a_port_streams_and_a_file_is_finished(spec, live):
    assert is_live(spec) is live


@each("spec", LIVE)
def test_a_live_source_is_no_finished_recording(spec):
    with pytest.raises(BadSetting, match="a board that streams"):
        open_source(spec)


@each(
    ("address", "shown"),
    [
        ("mqtt://ada:123/rest@host/topic", "mqtt://ada:…@host/topic"),
        ("mqtt://ada@x.org:123/rest@host/topic", "mqtt://ada@x.org:…@host/topic"),
        ("mqtts://ada:123/re@st@host/topic", "mqtts://ada:…@host/topic"),
        ("ssh://ada:123/rest@host/dev/ttyACM0@9600", "ssh://ada:…@host/dev/ttyACM0"),
        ("tcp://ada:123/rest@host:3333", "tcp://ada:…@host:3333"),
        ("rfc2217://ada:123/rest@host:3333@9600", "rfc2217://ada:…@host:3333"),
    ],
)
def test_a_password_that_reads_as_a_port_is_refused_and_not_repeated(address, shown):
    with pytest.raises(BadSetting, match="must hold no password") as error:
        port_of(address)
    assert shown in str(error.value)
    assert "st@" not in str(error.value)


@each(
    "address",
    [
        "mqtt://ada@[::1]:1883/home/ada%40x.org/t",
        "mqtt://broker/ada@x.org/t",
        "ssh://me@pi:2222/home/a%40b/log.csv",
        "ssh://pi/home/a@b/log.csv",
        "file:/tmp/a:b@c/log.csv",
        "file:///tmp/a:b@c.csv",
    ],
)
def test_an_at_sign_that_is_part_of_no_password(address):
    assert port_of(address).url == address


@each("address", ["ssh://pi:2222/dev/ttyACM0@fast", "rfc2217://host:4000@fast"])
def test_a_baud_rate_that_is_none_is_named(address):
    with pytest.raises(BadSetting, match=r"baud rate must be a whole number.*'fast'"):
        port_of(address)


def test_ports_are_listed_by_name_with_what_the_system_says(monkeypatch):
    found = [ListPortInfo("COM10"), ListPortInfo("COM9")]
    vars(found[1]).update(description="Uno", serial_number="75", vid=0x2341, pid=0x43, manufacturer="A")
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: found)
    assert list_ports() == (PortInfo("COM9", "Uno", "75", "A", (0x2341, 0x43)), PortInfo("COM10", "", ""))


@each(
    "text",
    ["socket://host", "rfc2217://host", "socket://:3333", "socket://host:", "socket://a:b", "socket://a:70000"],
)
def test_an_address_names_host_and_port(text):
    with pytest.raises(BadSetting, match=r"an address must be (socket|rfc2217)://host:port"):
        port_of(text)
