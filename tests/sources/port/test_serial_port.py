"""Serial ports by pyserial: every way in which one fails is one clear sentence."""

import errno

import pytest

from kalscope.errors import BadDevice
from kalscope.sources.port import serial_port
from kalscope.sources.port.registry import PortSpec
from kalscope.sources.port.serial_port import PortInfo, SerialPort


class LostPort:
    """What pyserial opens, of a board that goes, or that was never there."""

    def __init__(self, error=None):
        self.error, self.closed = error, False

    def open(self):
        if self.error is not None:
            raise self.error

    def close(self):
        self.closed = True


@pytest.fixture
def opened(monkeypatch):
    """Opens a port of pyserial as if it were there."""

    def open_port(raw, last=None, path="/dev/ttyX"):
        monkeypatch.setattr("serial.serial_for_url", lambda _device, **_: raw)
        return SerialPort(PortSpec(path), bool, last)

    return open_port


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (FileNotFoundError(errno.ENOENT, "No such file"), "is not plugged in"),
        (PermissionError(errno.EACCES, "Permission denied"), "dialout"),
        (OSError(errno.EBUSY, "Device or resource busy"), "in use by another program"),
        (ValueError("Invalid baud rate: 3"), "opened at 115200 baud"),
    ],
)
def test_a_port_that_does_not_open_says_what_to_do(error, words, opened):
    raw = LostPort(error)
    with pytest.raises(BadDevice, match=words):
        opened(raw)
    assert raw.closed


def test_a_board_is_found_again_under_another_name_by_its_serial_number(monkeypatch, opened):
    listed = [PortInfo("/dev/ttyACM0", "Uno", "75"), PortInfo("/dev/ttyACM1", "other", "9")]
    monkeypatch.setattr(serial_port, "list_ports", lambda: tuple(listed))
    first = opened(LostPort(), path="/dev/ttyACM0")
    listed[0] = PortInfo("/dev/ttyACM7", "Uno", "75")
    assert opened(LostPort(), first, "/dev/ttyACM0").device == "/dev/ttyACM7"


def test_what_is_no_port_says_so(tmp_path):
    (tmp_path / "log.csv").write_text("1\n")
    with pytest.raises(BadDevice, match="must be a serial port"):
        SerialPort(PortSpec(str(tmp_path / "log.csv")), bool, None)
