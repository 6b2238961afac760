"""Serial ports, those that the system lists, and boards behind tcp://host:port."""

from __future__ import annotations

import errno
import os
import re
import select
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kalscope.errors import BadDevice, BadSetting
from kalscope.sources.port.transport import (
    CONNECT_TIMEOUT,
    MAX_READ_BYTES,
    READ_TIMEOUT,
    WRITE_TIMEOUT,
    Endpoint,
    OpenPort,
    Transport,
    quoted,
    short,
)

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
    manufacturer: str = ""
    """Maker of the USB chip or board; "" where unknown."""
    usb: tuple[int, int] | None = None
    """USB numbers of maker and product; None where it is not a USB port."""


def list_ports() -> tuple[PortInfo, ...]:
    """The serial ports that the system knows, by name. A pseudo-terminal is never among them."""
    from serial.tools import list_ports as pyserial

    return tuple(sorted((_info(port) for port in pyserial.comports()), key=lambda info: _natural(info.device)))


def _info(port: object) -> PortInfo:
    def text(name: str) -> str:
        value = getattr(port, name, None)
        return "" if value in (None, "n/a") else str(value)

    vid, pid = getattr(port, "vid", None), getattr(port, "pid", None)
    usb = (vid, pid) if isinstance(vid, int) and isinstance(pid, int) else None
    return PortInfo(text("device"), text("description"), text("serial_number"), text("manufacturer"), usb)


def _natural(device: str) -> list[tuple[int, str]]:
    """COM10 after COM9."""
    return [(int(part) if part.isdecimal() else -1, part) for part in re.split(r"([0-9]+)", device)]


# tcp://host:port, which pyserial writes socket://: a board, or a program, that sends its lines over TCP.


_HOST_PORT = re.compile(r"\w+://(?:\[([0-9A-Fa-f:.]+)\]|([^/:?@\s]+)):([0-9]{1,5})(?:[/?].*)?", re.IGNORECASE)


def host_and_port(address: str) -> tuple[str, int]:
    """The host and the port of an address.

    Raises:
        BadSetting: it is not scheme://host:port.
    """
    match = _HOST_PORT.fullmatch(address)
    if match is None or not 1 <= int(match[3]) <= 65_535:
        scheme = address.partition(":")[0].lower()
        raise BadSetting(f"an address must be {scheme}://host:port (got {quoted(address)})")
    return match[1] or match[2], int(match[3])


def connect_failure(host: str, port: int, error: Exception, what: str = "the board, or its program,") -> str:
    """Why a connection could not be made, and what to do.

    Args:
        host: The other side.
        port: Its port.
        error: What the system raised.
        what: Who should answer there.
    """
    if isinstance(error, socket.gaierror | UnicodeError):
        return f"no computer is known by the name {host} ({short(getattr(error, 'strerror', None) or str(error))})"
    if isinstance(error, ConnectionRefusedError):
        return f"nothing listens at {host}:{port}: is {what} running there?"
    if isinstance(error, TimeoutError):
        return f"{host}:{port} does not answer within {CONNECT_TIMEOUT:g} s"
    return f"{host}:{port} cannot be reached ({short(str(error))})"


class SocketEndpoint(Endpoint):
    """A host and one of its ports."""

    def __init__(self, address: str) -> None:
        """Take an address; raises BadSetting as `host_and_port`."""
        self.device = address
        self._host, self._port = host_and_port(address)

    def open(self, is_ended: Callable[[], bool]) -> OpenPort:
        """Connect; see Endpoint."""
        del is_ended  # the system's connect cannot be interrupted
        try:
            connection = socket.create_connection((self._host, self._port), CONNECT_TIMEOUT)
        except (OSError, UnicodeError) as error:
            raise BadDevice(connect_failure(self._host, self._port, error)) from error
        return SocketPort(self.device, connection)


class SocketPort(OpenPort):
    """A connection over TCP."""

    def __init__(self, name: str, connection: socket.socket) -> None:
        """Args: the name in messages; the connection, which it closes."""
        self._name, self._socket = name, connection
        connection.settimeout(WRITE_TIMEOUT)

    def fetch(self) -> bytes:
        """Bytes that have arrived; see OpenPort."""
        try:
            if not select.select([self._socket], [], [], READ_TIMEOUT)[0]:
                return b""
            data = self._socket.recv(MAX_READ_BYTES)
        except OSError as error:
            raise BadDevice(f"the connection to {self._name} was lost ({short(str(error))})") from error
        if not data:
            raise BadDevice(f"the other side of {self._name} closed the connection")
        return data

    def waiting(self) -> int:
        """1 where bytes wait."""
        return len(select.select([self._socket], [], [], 0)[0])

    def write(self, data: bytes) -> None:
        """Send all of it."""
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise BadDevice(f"{self._name} accepts no data ({short(str(error))})") from error

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()


TCP = Transport(
    ("tcp://", "socket://"),
    "tcp://host:port",
    host_and_port,
    lambda address, _baud, _reset: SocketEndpoint(address),
)
"""A plain TCP connection."""


# Serial ports, and the URLs that pyserial reads. Wraps pyserial and works around its pitfalls.


_WINDOWS_BUFFER = 1 << 20  # the driver's own 4096 bytes are full after 0.36 s at 115200 baud
_SOON = 10.0
"""Seconds between two losses that show another cause than a cable."""

_DEVICE = re.compile(r"(?:\\\\\.\\)?COM[0-9]+|/dev/(?:tty|cu|pts/|serial/|rfcomm).*", re.IGNORECASE | re.DOTALL)

if sys.platform == "win32":
    _TERMINAL_ERRORS: tuple[type[BaseException], ...] = ()
else:
    import termios

    _TERMINAL_ERRORS = (termios.error,)
LOST = (OSError, TypeError, *_TERMINAL_ERRORS)
"""All that pyserial raises when a board is lost: OSError, of which its SerialException is one, and two more."""


def is_serial_device(text: str) -> bool:
    """Whether a text is the name of a serial port and of nothing else."""
    return _DEVICE.fullmatch(text) is not None


class SerialEndpoint(Endpoint):
    """A serial port of this computer, under whatever name its board has now."""

    def __init__(self, path: str, baud: int, reset: bool) -> None:
        """Args: as PortSpec."""
        self._path, self.baud, self.reset = path, baud, reset
        self.device = path
        self._serial_number = ""
        self._lost_at = -_SOON

    def open(self, is_ended: Callable[[], bool]) -> OpenPort:
        """Open the port; see Endpoint."""
        del is_ended  # a driver opens at once
        self.device = self._current_path()
        port = SerialPort(self)
        if not self._serial_number:
            real = os.path.realpath(self.device)
            found = [info for info in list_ports() if info.device in (self.device, real)]
            self._serial_number = found[0].serial_number if found else ""
        return port

    def _current_path(self) -> str:
        if not self._serial_number:
            return self._path
        same = [info.device for info in list_ports() if info.serial_number == self._serial_number]
        return same[0] if same and os.path.realpath(self._path) not in same else self._path

    def new_port(self, **settings: Any) -> Any:
        """A closed port of pyserial, which locks it."""
        import serial

        # A lock that other careful programs respect. Windows locks without being asked.
        port = serial.Serial(exclusive=None if sys.platform == "win32" else True, **settings)
        port.port = self.device
        return port

    def open_failure(self, error: BaseException) -> str:
        """The error message where it cannot be opened."""
        number, text, device = getattr(error, "errno", None), str(error), self.device
        if number == errno.ENOENT or "FileNotFoundError" in text:
            known = ", ".join(port.device for port in list_ports()) or "no serial port at all"
            return f"port {device} is not plugged in (the system lists {known})"
        if number in (errno.EACCES, errno.EPERM) or "PermissionError" in text:
            return _refusal_reason(device)
        if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in text:
            return f"port {device} is in use by another program{_held_by(device)}"
        return f"port {device} cannot be opened at {self.baud} baud ({short(text)})"

    def loss(self, error: BaseException) -> str:
        """Why an open port was probably lost; pyserial raises the same for a pulled cable and a second reader."""
        now = time.monotonic()
        again, self._lost_at = now - self._lost_at < _SOON, now
        others = _held_by(self.device)
        if others:
            return f"the board was unplugged, or another program reads this port{others}"
        if again or ("multiple access" in str(error) and os.path.exists(self.device)):
            return "the board was unplugged, or another program reads this port"
        return "the board was unplugged"


class UrlEndpoint(SerialEndpoint):
    """A URL of pyserial."""

    def _current_path(self) -> str:
        return self._path

    def new_port(self, **settings: Any) -> Any:
        """A closed port of pyserial."""
        import serial

        return serial.serial_for_url(self.device, do_not_open=True, **settings)

    def open_failure(self, error: BaseException) -> str:
        """The error message where it cannot be opened."""
        return f"{self.device} does not answer ({short(str(error))})"

    def loss(self, error: BaseException) -> str:
        """Why it was lost."""
        del error
        return f"the other side of {self.device} closed the connection"


class SerialPort(OpenPort):
    """A port of pyserial, open."""

    def __init__(self, endpoint: SerialEndpoint) -> None:
        """Open the current device of `endpoint`.

        Raises:
            BadDevice: it cannot be opened; the message names the cause where it shows one.
        """
        self._endpoint = endpoint
        self._port: Any = None
        try:
            self._port = endpoint.new_port(
                baudrate=endpoint.baud, timeout=READ_TIMEOUT, write_timeout=WRITE_TIMEOUT
            )
            if not endpoint.reset:
                self._port.dtr = self._port.rts = False
            self._port.open()
            if hasattr(self._port, "set_buffer_size"):
                self._port.set_buffer_size(rx_size=_WINDOWS_BUFFER)
        except (*LOST, ValueError) as error:
            self.close()
            raise BadDevice(endpoint.open_failure(error)) from error

    def fetch(self) -> bytes:
        """Bytes that have arrived; see OpenPort."""
        try:
            # Never more than is there: a read that waits for the rest loses it all if the board is lost.
            return self._port.read(min(max(1, self._port.in_waiting), MAX_READ_BYTES))
        except LOST as error:
            raise BadDevice(self._endpoint.loss(error)) from error

    def waiting(self) -> int:
        """Bytes that wait to be read."""
        try:
            return self._port.in_waiting
        except LOST as error:
            raise BadDevice(self._endpoint.loss(error)) from error

    def write(self, data: bytes) -> None:
        """Send all of it."""
        try:
            self._port.write(data)
        except LOST as error:
            raise BadDevice(f"cannot write to port {self._endpoint.device} ({short(str(error))})") from error

    def close(self) -> None:
        """Release the port."""
        port, self._port = self._port, None
        if port is None:
            return
        connection = getattr(port, "_socket", None)
        with suppress(*LOST):  # the port is gone with the board
            port.close()
        if connection is not None:
            connection.close()  # pyserial forgets to, where the other side was faster


def _refusal_reason(device: str) -> str:
    if sys.platform == "win32":
        return f"port {device} is in use by another program"
    if held := _held_by(device):
        return f"port {device} is in use by another program{held}"
    cure = "on Linux: sudo usermod -aG dialout $USER, then log in again"
    return f"no permission to open port {device} ({cure})"


def _held_by(device: str) -> str:
    names = holders(device)
    return f": {', '.join(names)}" if names else ""


def holders(device: str) -> list[str]:
    """Programs that hold `device` open, as "name (process 123)", except this one; [] if the system does not say.

    Only Linux does, and only for the user's own programs.
    """
    try:
        target, own = os.path.realpath(device), os.getpid()
        processes = [entry for entry in os.listdir("/proc") if entry.isdecimal() and int(entry) != own]
    except OSError:
        return []
    return [f"{_name(pid)} (process {pid})" for pid in processes if _holds(pid, target)]


def _holds(pid: str, target: str) -> bool:
    folder = f"/proc/{pid}/fd"
    try:
        return any(os.readlink(f"{folder}/{fd}") == target for fd in os.listdir(folder))
    except OSError:  # another user's, or just ended
        return False


def _name(pid: str) -> str:
    try:
        return Path(f"/proc/{pid}/comm").read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return "a program"


def _check_url(address: str) -> None:
    scheme, _, rest = address.partition("://")
    if not rest:
        raise BadSetting(f"an address must be {scheme.lower()}://NAME (got {quoted(address)})")


SERIAL = Transport(("serial:",), "/dev/ttyACM0 or COM3@9600", lambda _path: None, SerialEndpoint, has_baud=True)
"""A serial port of this computer; its path alone is an address, too."""
RFC2217 = Transport(("rfc2217://",), "rfc2217://host:port", host_and_port, UrlEndpoint, has_baud=True)
"""A serial port of another machine, by RFC 2217."""
PYSERIAL = Transport(
    ("loop://", "spy://", "alt://", "hwgrep://", "cp2110://"),
    "loop://",
    _check_url,
    UrlEndpoint,
    has_baud=True,
    in_dashboard=False,  # spy:// writes a file
)
"""The other URLs of pyserial, for tests and rare hardware."""
