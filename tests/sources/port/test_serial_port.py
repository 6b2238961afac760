"""Serial ports by pyserial: every way in which one fails is one clear sentence."""

import errno
import subprocess
import sys

import pytest
import serial
from each import each

from kalscope.errors import BadDevice
from kalscope.sources.port.serial_port import PortInfo, SerialEndpoint, SocketEndpoint, holders


def never():
    return False


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

    def write(self, _data):
        self._maybe_fail("write")

    def close(self):
        self.closed = True


def endpoint_of(port, path="/dev/ttyX"):
    endpoint = SerialEndpoint(path, 115_200, True)
    endpoint.new_port = lambda **_: port
    return endpoint


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
@each("where", ["read", "in_waiting", "write"])
def test_whatever_is_raised_it_is_one_sentence(error, where):
    raw = LostPort(error, where)
    port = endpoint_of(raw).open(never)
    with pytest.raises(BadDevice, match="cannot write to port /dev/ttyX" if where == "write" else "was unplugged"):
        port.write(b"x") if where == "write" else port.fetch()
    if where == "in_waiting":
        with pytest.raises(BadDevice, match="was unplugged"):
            port.waiting()
    port.close()
    port.close()
    assert raw.closed


def test_a_board_is_found_again_under_another_name_by_its_serial_number(monkeypatch):
    listed = [PortInfo("/dev/ttyACM0", "Uno", "75"), PortInfo("/dev/ttyACM1", "other", "9")]
    monkeypatch.setattr("kalscope.sources.port.serial_port.list_ports", lambda: tuple(listed))
    endpoint = endpoint_of(LostPort(None, ""), "/dev/ttyACM0")
    endpoint.open(never)
    listed[0] = PortInfo("/dev/ttyACM7", "Uno", "75")
    endpoint.open(never)
    assert endpoint.device == "/dev/ttyACM7"


def test_a_second_reader_is_named_as_a_possible_cause(board):
    endpoint = SerialEndpoint(board.link, 115_200, True)
    script = (
        "import os,sys,time; os.open(sys.argv[1], os.O_RDWR|os.O_NOCTTY); print('open', flush=True); time.sleep(9)"
    )
    with subprocess.Popen([sys.executable, "-c", script, board.link], stdout=subprocess.PIPE) as other:
        assert other.stdout.readline() == b"open\n"
        held = holders(board.link)
        text = endpoint.loss(OSError(5, "x"))
        other.kill()
    assert held == [f"{held[0].split(' (')[0]} (process {other.pid})"]
    assert "unplugged" in text
    assert "another program reads this port" in text
    assert str(other.pid) in text


def test_the_words_of_both_causes_name_both(tmp_path):
    (tmp_path / "port").touch()
    error = serial.SerialException("(device disconnected or multiple access on port?)")
    assert "another program" in SerialEndpoint(str(tmp_path / "port"), 9600, True).loss(error)
    gone = SerialEndpoint("/dev/gone", 9600, True)
    assert gone.loss(error) == "the board was unplugged"
    assert "another program" in gone.loss(error)  # soon after the first


@each(
    ("error", "words"),
    [
        (FileNotFoundError(errno.ENOENT, "No such file"), "is not plugged in"),
        (PermissionError(errno.EACCES, "Permission denied"), "dialout"),
        (OSError(errno.EBUSY, "Device or resource busy"), "in use by another program"),
        (ValueError("Invalid baud rate: 3"), "opened at 115200 baud"),
    ],
)
def test_a_port_that_does_not_open_says_what_to_do(error, words):
    raw = LostPort(error, "open")
    with pytest.raises(BadDevice, match=words):
        endpoint_of(raw).open(never)
    assert raw.closed


def test_a_file_is_no_port(tmp_path):
    (tmp_path / "log.csv").write_text("1\n")
    with pytest.raises(BadDevice, match="cannot be opened at"):
        SerialEndpoint(str(tmp_path / "log.csv"), 115_200, True).open(never)


def test_a_network_port_without_a_server_says_so():
    with pytest.raises(BadDevice, match="nothing listens at 127"):
        SocketEndpoint("socket://127.0.0.1:1").open(never)
