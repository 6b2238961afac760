"""Serial ports by pyserial: every way in which one fails is one clear sentence."""

import errno

import pytest
import serial
from each import each

from kalscope.errors import BadDevice
from kalscope.sources.port import serial_port
from kalscope.sources.port.registry import PortSpec
from kalscope.sources.port.serial_port import PortInfo, SerialPort, SocketPort


class LostPort:
    """What pyserial opens, of a board that goes at the first call of `where`."""

    def __init__(self, error, where):
        self.error, self.where, self.closed = error, where, False

    def _maybe_fail(self, where):
        if where == self.where:
            raise self.error

    def open(self):
        self._maybe_fail("open")

    @property
    def in_waiting(self):
        self._maybe_fail("in_waiting")
        return 1

    def read(self, _size):
        self._maybe_fail("read")
        return b"1"

    def close(self):
        self.closed = True


@pytest.fixture
def opened(monkeypatch):
    """Opens a port of pyserial as if it were there."""

    def open_port(raw, last=None, path="/dev/ttyX"):
        monkeypatch.setattr(serial_port, "new_port", lambda _device, **_: raw)
        return SerialPort(PortSpec(path), bool, last)

    return open_port


def termios_error():
    import termios

    return termios.error(errno.EIO, "Input/output error")


@each(
    "error",
    [
        serial.SerialException("device reports readiness to read but returned no data"),
        OSError(errno.EIO, "Input/output error"),
        termios_error(),
        TypeError("'NoneType' object cannot be interpreted as an integer"),
    ],
    ids=lambda error: type(error).__module__ + "." + type(error).__name__,
)
@each("where", ["read", "in_waiting"])
def test_whatever_is_raised_it_is_one_sentence(error, where, opened):
    raw = LostPort(error, where)
    port = opened(raw)
    with pytest.raises(BadDevice, match="was unplugged"):
        port.fetch()
    port.close()
    port.close()
    assert raw.closed


@each(
    ("error", "words"),
    [
        (FileNotFoundError(errno.ENOENT, "No such file"), "is not plugged in"),
        (PermissionError(errno.EACCES, "Permission denied"), "dialout"),
        (OSError(errno.EBUSY, "Device or resource busy"), "in use by another program"),
        (ValueError("Invalid baud rate: 3"), "opened at 115200 baud"),
    ],
)
def test_a_port_that_does_not_open_says_what_to_do(error, words, opened):
    raw = LostPort(error, "open")
    with pytest.raises(BadDevice, match=words):
        opened(raw)
    assert raw.closed


def test_a_board_is_found_again_under_another_name_by_its_serial_number(monkeypatch, opened):
    listed = [PortInfo("/dev/ttyACM0", "Uno", "75"), PortInfo("/dev/ttyACM1", "other", "9")]
    monkeypatch.setattr(serial_port, "list_ports", lambda: tuple(listed))
    first = opened(LostPort(None, ""), path="/dev/ttyACM0")
    listed[0] = PortInfo("/dev/ttyACM7", "Uno", "75")
    assert opened(LostPort(None, ""), first, "/dev/ttyACM0").device == "/dev/ttyACM7"


def test_a_port_that_is_still_there_may_have_a_second_reader(opened, tmp_path):
    (tmp_path / "port").touch()
    assert "another program reads this port" in opened(LostPort(None, ""), path=str(tmp_path / "port")).loss()


def test_what_is_no_port_or_has_no_server_says_so(tmp_path):
    (tmp_path / "log.csv").write_text("1\n")
    with pytest.raises(BadDevice, match="cannot be opened at"):
        SerialPort(PortSpec(str(tmp_path / "log.csv")), bool, None)
    with pytest.raises(BadDevice, match=r"127.0.0.1:1 cannot be reached \(Connection refused\)"):
        SocketPort(PortSpec("socket://127.0.0.1:1"), bool, None)
