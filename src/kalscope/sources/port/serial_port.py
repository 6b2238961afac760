"""Serial ports, those that the system lists, and boards behind tcp://host:port."""

from __future__ import annotations

import errno
import os
import re
import socket
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.port.reader import CONNECT_TIMEOUT, MAX_READ_BYTES, READ_TIMEOUT, OpenPort, quoted, short

if TYPE_CHECKING:
    from kalscope.sources.port.registry import PortSpec

# The serial ports that the system lists. Opens nothing.


@dataclass(frozen=True)
class PortInfo:
    """A serial port that the system lists."""

    device: str
    """What opens it: /dev/ttyACM0, COM3."""
    description: str
    """What the system calls it; "" where it gives no description."""
    serial_number: str
    """USB serial number, by which a board is found again under another name; "" where there is none."""
    usb: tuple[int, int] | None = None
    """USB numbers of maker and product; None where it is not a USB port."""


def list_ports() -> tuple[PortInfo, ...]:
    """The serial ports that the system knows, by name. A pseudo-terminal is never among them."""
    from serial.tools import list_ports as pyserial

    return tuple(map(_info, sorted(pyserial.comports())))


def _info(port: Any) -> PortInfo:
    texts = (port.device, port.description, port.serial_number)
    usb = None if port.vid is None or port.pid is None else (port.vid, port.pid)
    return PortInfo(*("" if text in (None, "n/a") else str(text) for text in texts), usb=usb)


# tcp://host:port, which pyserial writes socket://: a board, or a program, that sends its lines over TCP.


_HOST_PORT = re.compile(r"\w+://(?:\[([0-9A-Fa-f:.%\w]+)\]|([^/:?@\s]*)):([0-9]{1,5})(?:[/?].*)?", re.IGNORECASE)


def host_and_port(address: str, default: str = "") -> tuple[str, int]:
    """The host, or a default where none is named, and the port of an address.

    Raises:
        BadSetting: it is not scheme://host:port.
    """
    match = _HOST_PORT.fullmatch(address)
    host = match and (match[1] or match[2] or default)
    if match is None or not host or not 1 <= int(match[3]) <= 65_535:
        scheme = address.partition(":")[0].lower()
        raise BadSetting(f"an address must be {scheme}://host:port (got {quoted(address)})")
    return host, int(match[3])


class SocketPort(OpenPort):
    """A connection over TCP."""

    prefixes = ("tcp://", "socket://")
    check = staticmethod(host_and_port)

    def __init__(self, spec: PortSpec, _is_ended: Callable[[], bool], _last: OpenPort | None) -> None:
        """Connect; see OpenPort."""
        self._socket = socket.create_connection(host_and_port(spec.url), CONNECT_TIMEOUT)
        self._socket.settimeout(READ_TIMEOUT)  # and no select(), which fails beyond 1,024 open files

    def fetch(self) -> bytes:
        """Bytes that have arrived; see OpenPort."""
        try:
            data = self._socket.recv(MAX_READ_BYTES)
        except TimeoutError:
            return b""
        if not data:
            raise OSError("the other side closed the connection")
        return data

    def write(self, data: bytes) -> None:
        """Send all of it."""
        self._socket.sendall(data)

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()


# Serial ports. Wraps pyserial and works around its pitfalls.


PORT_NAME = re.compile(r"(?:\\\\\.\\)?COM[0-9]+|/dev/(?:tty|cu|pts/|serial/|rfcomm).*", re.IGNORECASE | re.DOTALL)
"""Names of serial ports and of nothing else."""


def open_failure(device: str, baud: int, error: BaseException) -> str:
    """The error message where a port cannot be opened."""
    number, text = getattr(error, "errno", None), str(error)
    if number == errno.ENOENT or "FileNotFoundError" in text:
        known = ", ".join(port.device for port in list_ports()) or "no serial port at all"
        return f"port {device} is not plugged in (the system lists {known})"
    if number in (errno.EACCES, errno.EPERM) and sys.platform != "win32":
        return f"no permission to open port {device} (on Linux: sudo usermod -aG dialout $USER, then log in again)"
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in text or "PermissionError" in text:  # Windows
        return f"port {device} is in use by another program: close it there, as in the Serial Monitor"
    if number in (errno.ENOTTY, errno.ENXIO, errno.EISDIR) or "Inappropriate ioctl" in text:
        return f"{device} must be a serial port (the system says that it is none)"
    return f"port {device} cannot be opened at {baud} baud ({short(error)})"


class SerialPort(OpenPort):
    """A serial port of this computer, under whatever name its board has now."""

    prefixes = ("serial:",)
    has_baud = True
    when_lost = "was the board unplugged, or does another program read this port?"

    def __init__(self, spec: PortSpec, _is_ended: Callable[[], bool], last: OpenPort | None) -> None:
        """Open it; see OpenPort."""
        import serial

        self.serial_number: str = last.serial_number if isinstance(last, SerialPort) else ""
        listed = list_ports()
        same = [info.device for info in listed if info.serial_number == self.serial_number != ""]
        self.device = same[0] if same and os.path.realpath(spec.url) not in same else spec.url
        self._port: Any = None
        try:
            # A lock that other careful programs respect. Windows locks without being asked.
            lock = None if sys.platform == "win32" else True
            self._port = serial.serial_for_url(self.device, baudrate=spec.baud, do_not_open=True, exclusive=lock)
            self._port.timeout, self._port.write_timeout = READ_TIMEOUT, 2.0
            if not spec.reset:
                self._port.dtr = self._port.rts = False
            self._port.open()
            if hasattr(self._port, "set_buffer_size"):
                # Of Windows: the driver's own 4096 bytes are full after 0.36 s at 115200 baud.
                self._port.set_buffer_size(rx_size=1 << 20)
        except Exception as error:
            self.close()
            raise BadDevice(open_failure(self.device, spec.baud, error)) from error
        paths = (self.device, os.path.realpath(self.device))
        found = [info.serial_number for info in listed if info.device in paths]
        self.serial_number = found[0] if found else self.serial_number

    def fetch(self) -> bytes:
        """Bytes that have arrived; see OpenPort."""
        # Never more than is there: a read that waits for the rest loses it all if the board is lost.
        return self._port.read(min(max(1, self._port.in_waiting), MAX_READ_BYTES))

    def write(self, data: bytes) -> None:
        """Send all of it."""
        self._port.write(data)

    def close(self) -> None:
        """Release the port."""
        with suppress(Exception):  # the port is gone with the board, or was never made
            self._port.close()
