"""An open port, and messages for the user if opening fails or the connection ends. Wraps pyserial and its traps."""

from __future__ import annotations

import errno
import os
import select
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

from kalscope.errors import BadDevice
from kalscope.sources.port.port_spec import PortSpec, list_ports

READ_TIMEOUT = 0.1
"""Seconds after which a read without data returns, so that close never waits longer."""
MAX_READ_BYTES = 1 << 13
"""Bytes of one read: a consumer that is to end is asked between two of them."""
_WRITE_TIMEOUT = 2.0
_WINDOWS_BUFFER = 1 << 20  # the driver's own 4096 bytes are full after 0.36 s at 115200 baud


if sys.platform == "win32":
    _TERMINAL_ERRORS: tuple[type[BaseException], ...] = ()
else:
    import termios

    _TERMINAL_ERRORS = (termios.error,)
DISCONNECT_ERRORS = (OSError, TypeError, *_TERMINAL_ERRORS)
"""All that pyserial raises when a board is lost: OSError, of which its SerialException is one, and two more."""


class OpenPort(Protocol):
    """What the reader needs of an open port."""

    def fetch(self) -> bytes:
        """All bytes that have arrived; after READ_TIMEOUT none."""
        ...

    def waiting(self) -> int:
        """Bytes that wait to be read."""
        ...

    def write(self, data: bytes) -> None:
        """Send."""
        ...

    def close(self) -> None:
        """Free the port."""
        ...


class SerialPort:
    """A port of pyserial, open."""

    def __init__(self, spec: PortSpec, device: str) -> None:
        """Open `device` with the settings of `spec`.

        Raises:
            BadDevice: it cannot be opened; the message names the cause where it shows one.
        """
        import serial

        self._port: Any = None
        try:
            self._port = serial.serial_for_url(
                device,
                do_not_open=True,
                baudrate=spec.baud,
                timeout=READ_TIMEOUT,
                write_timeout=_WRITE_TIMEOUT,
                # A lock that other careful programs heed. Windows locks without being asked.
                exclusive=None if spec.is_url or sys.platform == "win32" else True,
            )
            if device.lower().startswith("socket:"):
                # Its opening would read and throw away all that comes, and never end while more comes.
                self._port.reset_input_buffer = bool
            if not spec.reset:
                self._port.dtr = self._port.rts = False
            self._port.open()
            if hasattr(self._port, "set_buffer_size"):
                self._port.set_buffer_size(rx_size=_WINDOWS_BUFFER)
        except (*DISCONNECT_ERRORS, ValueError) as error:
            self.close()
            raise BadDevice(open_failure_reason(spec, device, error)) from error
        # pyserial counts the bytes of a socket as one, and its read throws away what it had when the peer goes.
        self._socket = getattr(self._port, "_socket", None) if device.lower().startswith("socket:") else None
        if self._socket is not None:
            self._port.timeout = 0

    def fetch(self) -> bytes:
        """All bytes that have arrived; after READ_TIMEOUT none. Raises DISCONNECT_ERRORS if the board is lost."""
        if self._socket is not None:
            select.select([self._socket], [], [], READ_TIMEOUT)
            return self._port.read(MAX_READ_BYTES)
        # Never more than is there: a read that waits for the rest loses it all when the board goes meanwhile.
        return self._port.read(min(max(1, self._port.in_waiting), MAX_READ_BYTES))

    def waiting(self) -> int:
        """Bytes that wait to be read; of a socket only whether there are any."""
        return self._port.in_waiting

    def write(self, data: bytes) -> None:
        """Send all of it, or raise."""
        self._port.write(data)

    def close(self) -> None:
        """Free the port; may be called twice, and after the board has gone."""
        port, self._port = self._port, None
        if port is None:
            return
        connection = getattr(port, "_socket", None)
        with suppress(*DISCONNECT_ERRORS):  # the board took the port with it
            port.close()
        if connection is not None:
            connection.close()  # pyserial forgets to, where the other side was faster


def open_failure_reason(spec: PortSpec, device: str, error: BaseException) -> str:
    """The error message for a port that cannot be opened."""
    number, text = getattr(error, "errno", None), str(error)
    if spec.is_url:
        return f"{device} does not answer ({_short(text)})"
    if number == errno.ENOENT or "FileNotFoundError" in text:
        known = ", ".join(port.device for port in list_ports()) or "no serial port at all"
        return f"port {device} is not plugged in (the system lists {known})"
    if number in (errno.EACCES, errno.EPERM) or "PermissionError" in text:
        return _refusal_reason(device)
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in text:
        return f"port {device} is in use by another program{_held_by(device)}"
    return f"port {device} cannot be opened at {spec.baud} baud ({_short(text)})"


def _refusal_reason(device: str) -> str:
    if sys.platform == "win32":
        return f"port {device} is in use by another program"
    if held := _held_by(device):
        return f"port {device} is in use by another program{held}"
    cure = "on Linux: sudo usermod -aG dialout $USER, then log in again"
    return f"no permission to open port {device} ({cure})"


def disconnect_reason(spec: PortSpec, device: str, error: BaseException, *, again: bool) -> str:
    """Why an open port was probably lost.

    Args:
        spec: The port.
        device: The device that was opened.
        error: What pyserial raised: the same for an unplugged board and for a second reader.
        again: True if it was lost soon after it was opened, more than once.
    """
    if spec.is_url:
        return f"the other side of {device} closed the connection"
    others = _held_by(device)
    if others:
        return f"the board was unplugged, or another program reads this port{others}"
    if again or ("multiple access" in str(error) and os.path.exists(device)):
        return "the board was unplugged, or another program reads this port"
    return "the board was unplugged"


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


def _short(text: str) -> str:
    return " ".join(text.split())[:200]
