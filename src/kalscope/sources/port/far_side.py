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
"""Bytes of one read of a file."""
MAX_BEFORE = 64
"""Bytes before a position in a file by which the position is recognised."""
_POLL = 0.1


class Replaced(Exception):
    """The file was cut short, or another one has its name: it is to be read again, from its beginning."""


class GrowingFile:
    """Reads a file, and what is added to it."""

    def __init__(self, path: str, place: tuple[int, bytes] = (0, b"")) -> None:
        """Open a file.

        Args:
            path: The file.
            place: Where to begin, and the bytes before it, MAX_BEFORE at most: where others are there now, it
                begins at 0.

        Raises:
            OSError: There is no such file, it may not be read, or it is not a regular file.
        """
        if not stat.S_ISREG(os.stat(path).st_mode):  # before it is opened: a FIFO would wait for a writer
            raise OSError(errno.EINVAL, "must be a file or a serial port")
        self._path, self._file = path, open(path, "rb", buffering=0)  # noqa: SIM115
        position, before = place
        self._file.seek(max(position - len(before), 0))
        is_same = bool(before) and self._file.read(len(before)) == before
        self.place = place if is_same else (self._file.seek(0), b"")

    def read(self) -> bytes:
        """The next bytes, PIECE at most; b"" where there are none yet.

        Raises:
            Replaced: What follows is in another file.
            OSError: It cannot be read from the disk.
        """
        data = self._file.read(PIECE)
        if not data and self._is_replaced():
            raise Replaced("it was replaced or cut short, and is read from its beginning")
        self.place = moved(self.place, data)
        return data

    def _is_replaced(self) -> bool:
        here = os.fstat(self._file.fileno())
        try:
            there = os.stat(self._path)
        except OSError:  # renamed: it may still be written until the next one exists
            there = here
        return here.st_size < self.place[0] or not os.path.samestat(there, here)

    def close(self) -> None:
        """Close the file; may be called twice."""
        self._file.close()


def moved(place: tuple[int, bytes], data: bytes) -> tuple[int, bytes]:
    """The place after these bytes."""
    return place[0] + len(data), (place[1] + data)[-MAX_BEFORE:]


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
    """Send a file, and what is added to it, until the reader is gone or the file was replaced."""
    file = GrowingFile(request["path"], (request["position"], bytes.fromhex(request["before"])))
    os.write(1, MARK + b"%d\n" % file.place[0])
    while True:
        data = file.read()
        if data:
            sys.stdout.buffer.write(data)
            sys.stdout.buffer.flush()
        elif select.select([0], [], [], _POLL)[0] and not os.read(0, 4096):
            return


def main() -> None:
    """Do what the first line of standard input asks for."""
    with open(0, "rb", buffering=0, closefd=False) as requests:  # unbuffered: what follows is for `serve_device`
        request = json.loads(requests.readline())
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
