"""Follows a file that grows; on the other machine of an ssh:// address it opens a serial port, too.

`ssh.py` sends this text to a Python that the machine has: it imports nothing of Kalscope and keeps to Python 3.7.
Standard input is lines: one of JSON that names what to open; then one for each piece to send to the board, in
hexadecimal digits, and an empty one now and then, to show that the reader is there. Standard output is MARK, the
position in the file, or DEVICE, on a line, and then the bytes as they arrive. Standard error says why nothing was
opened.

Python rather than stty and cat: it sets 250000 baud, locks the port, knows its place in a file, and gives a port up
when nothing was received for MAX_SILENCE. A cat would hold it after the network has gone, and take half of the
bytes from the next reader.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import select
import stat
import sys
from typing import Any

MARK = b"\0kalscope "
"""Precedes the first answer: what a login shell prints before it is skipped."""
DEVICE = -1
"""The answer for a serial port, in place of a position."""
MAX_SILENCE = 15
"""Seconds without a line on standard input after which a port is given up."""
PIECE = 8_192
"""Bytes of one read of a file, unless its first line is longer."""
MAX_PIECE = 65_536
"""Bytes of a line beyond which it comes in pieces."""
MAX_BEFORE = 64
"""Bytes before a position in a file by which the position is recognised."""
_POLL = 0.1


class Replaced(Exception):
    """The file was cut short, or another one has its name: it is to be read again, from its beginning."""


class GrowingFile:
    """Reads whole lines. What follows the last line end is left for later: it may be half a line."""

    def __init__(self, path: str, position: int = 0, before: bytes = b"") -> None:
        """Open a file.

        Args:
            path: The file.
            position: Where to begin.
            before: The bytes before that position, MAX_BEFORE at most: where others are there now, it
                begins at 0.

        Raises:
            OSError: There is no such file, it may not be read, or it is not a regular file.
        """
        if not stat.S_ISREG(os.stat(path).st_mode):  # before it is opened: a FIFO would wait for a writer
            raise OSError(errno.EINVAL, "must be a file or a serial port")
        self._path = path
        self._open_file = open(path, "rb", buffering=0)  # noqa: SIM115
        start = position - len(before)
        self.position = position if before and start >= 0 and self._at(start, len(before)) == before else 0
        self.before = before if self.position else b""

    def read(self) -> bytes:
        """The next whole lines, PIECE bytes at most, or one longer line; b"" where there are none yet.

        Raises:
            Replaced: What follows is in another file.
            OSError: It cannot be read from the disk.
        """
        data = self._at(self.position, PIECE)
        end = max(data.rfind(b"\n"), data.rfind(b"\r")) + 1
        if not end and len(data) == PIECE:
            data = self._at(self.position, MAX_PIECE)
            ends = [data.find(mark) + 1 for mark in (b"\n", b"\r") if mark in data]
            end = min(ends, default=len(data) if len(data) == MAX_PIECE else 0)
        if not end and self._is_replaced():
            raise Replaced
        self.position += end
        self.before = (self.before + data[:end])[-MAX_BEFORE:]
        return data[:end]

    def _at(self, position: int, size: int) -> bytes:
        self._open_file.seek(position)
        return self._open_file.read(size)

    def _is_replaced(self) -> bool:
        here = os.fstat(self._open_file.fileno())
        try:
            there = os.stat(self._path)
        except OSError:  # renamed: it may still be written until the next one exists
            there = here
        return here.st_size < self.position or (there.st_dev, there.st_ino) != (here.st_dev, here.st_ino)

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._open_file.close()


def open_device(path: str, baud: int, reset: bool) -> int:
    """A serial port: raw, 8N1, locked as pyserial locks one.

    Raises:
        OSError: It cannot be opened.
    """
    import fcntl
    import termios
    import tty

    device = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        fcntl.flock(device, fcntl.LOCK_EX | fcntl.LOCK_NB)
        tty.setraw(device)
        settings = termios.tcgetattr(device)
        settings[2] = (settings[2] & ~(termios.CSTOPB | termios.CRTSCTS)) | termios.CLOCAL | termios.CREAD
        speed = getattr(termios, f"B{baud}", None)
        settings[4] = settings[5] = termios.B38400 if speed is None else speed
        termios.tcsetattr(device, termios.TCSANOW, settings)
        if speed is None:
            _set_odd_speed(device, baud)
        if not reset:
            low = (termios.TIOCM_DTR | termios.TIOCM_RTS).to_bytes(4, sys.byteorder)
            with contextlib.suppress(OSError):  # a pseudo-terminal has no such lines
                fcntl.ioctl(device, termios.TIOCMBIC, low)
        termios.tcflush(device, termios.TCIFLUSH)
    except BlockingIOError:
        raise OSError(errno.EBUSY, "is in use by another program") from None
    except termios.error as error:
        raise OSError(error.args[0], "is not a serial port: " + error.args[1]) from None
    os.set_blocking(device, True)
    return device


def _set_odd_speed(device: int, baud: int) -> None:
    """A baud rate without a constant of its own, such as 250000, by Linux's termios2."""
    import array
    import fcntl

    words = array.array("i", [0] * 64)
    fcntl.ioctl(device, 0x802C542A, words)
    words[2] = (words[2] & ~0o10017) | 0o10000  # CBAUD, BOTHER
    words[9] = words[10] = baud
    fcntl.ioctl(device, 0x402C542B, words)


def serve_device(request: dict[str, Any]) -> None:
    """Pass bytes between a serial port and the reader until one of them is gone."""
    import signal

    device = open_device(request["path"], request["baud"], request["reset"])
    os.write(1, MARK + b"%d\n" % DEVICE)
    rest = b""
    signal.alarm(MAX_SILENCE)  # ends this program, also while a write waits
    with contextlib.suppress(OSError):  # the board, or the reader, is gone
        while True:
            ready = select.select([0, device], [], [])[0]
            if device in ready:
                data = os.read(device, 4096)
                if not data:
                    return
                os.write(1, data)
            if 0 in ready:
                data = os.read(0, 4096)
                if not data:
                    return
                signal.alarm(MAX_SILENCE)
                *lines, rest = (rest + data).split(b"\n")
                os.write(device, b"".join(bytes.fromhex(line.decode("ascii")) for line in lines))


def serve_file(request: dict[str, Any]) -> None:
    """Send the lines of a file, and those that are added, until the reader is gone or the file was replaced."""
    file = GrowingFile(request["path"], request["position"], bytes.fromhex(request["before"]))
    os.write(1, MARK + b"%d\n" % file.position)
    while True:
        lines = file.read()
        if lines:
            sys.stdout.buffer.write(lines)
            sys.stdout.buffer.flush()
        elif select.select([0], [], [], _POLL)[0] and not os.read(0, 4096):
            return


def main() -> None:
    """Do what the first line of standard input asks for."""
    line = b""
    while not line.endswith(b"\n"):
        piece = os.read(0, 1)
        if not piece:
            return
        line += piece
    request = json.loads(line.decode("ascii"))
    path = request["path"]
    request["path"] = os.path.expanduser(path) if path.startswith("~/") else path
    try:
        is_device = stat.S_ISCHR(os.stat(request["path"]).st_mode)
        (serve_device if is_device else serve_file)(request)
    except Replaced:
        pass
    except OSError as error:
        sys.exit(f"{path}: {error.strerror}")


if __name__ == "__main__":
    main()
