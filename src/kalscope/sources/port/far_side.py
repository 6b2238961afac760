"""Follows a file that grows; on the other machine of an ssh:// address it opens a serial port, too.

`ssh.py` sends this text to a Python that the machine has: it imports nothing of Kalscope and keeps to Python 3.7.
Standard input is a line of JSON that names what to open; then what is to be sent to the board, with a zero byte
now and then that shows that the reader is there. Standard output is MARK, the position in the file, or DEVICE, on a
line, and then the bytes as they arrive. Standard error says why nothing was opened.

Python rather than stty and cat: it locks the port, knows its place in a file, and ends when nothing was received
for MAX_SILENCE. A cat would hold the port after the network has gone, and take half of the bytes from the next
reader.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import select
import stat
import sys

MARK = b"\0kalscope "
"""Precedes the first answer: what a login shell prints before it is skipped."""
DEVICE = -1
"""The answer for a serial port, in place of a position."""
MAX_SILENCE = 15
"""Seconds without a byte on standard input after which a port is given up."""
PIECE = 8_192
"""Bytes of one read of a file."""
MAX_BEFORE = 64
"""Bytes before a position in a file by which the position is recognised."""


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
            OSError: It was replaced or cut short, or cannot be read from the disk.
        """
        data = self._file.read(PIECE)
        if not data and self._is_replaced():
            raise OSError("it was replaced or cut short, and is read from its beginning")
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
    """A serial port of Linux or macOS: raw, 8N1, locked as pyserial locks one.

    Raises:
        OSError: It cannot be opened.
    """
    import fcntl
    import subprocess
    import termios

    device = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        fcntl.flock(device, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise OSError(errno.EBUSY, "is in use by another program") from None
    settings = ["raw", "-echo", "-cstopb", "-crtscts", "clocal", "cread", str(baud)]
    option = "-F" if sys.platform == "linux" else "-f"  # of macOS
    try:
        subprocess.run(["stty", option, path, *settings], stderr=subprocess.PIPE, check=True)
    except subprocess.CalledProcessError as error:
        raise OSError(errno.ENOTTY, "must be a serial port: " + error.stderr.decode().split("\n")[0]) from None
    if not reset:
        low = (termios.TIOCM_DTR | termios.TIOCM_RTS).to_bytes(4, sys.byteorder)
        with contextlib.suppress(OSError):  # a pseudo-terminal has no such lines
            fcntl.ioctl(device, termios.TIOCMBIC, low)
    termios.tcflush(device, termios.TCIFLUSH)
    os.set_blocking(device, True)
    return device


def serve(device: int, file: GrowingFile | None) -> None:
    """Pass bytes between a serial port, or a file, and the reader until one of them is gone."""
    import signal

    os.write(1, MARK + b"%d\n" % (DEVICE if file is None else file.place[0]))
    inputs, data = [0, device] if file is None else [0], b""
    signal.alarm(MAX_SILENCE)  # ends this program, also while a write waits
    while True:
        ready = select.select(inputs, [], [], 0 if data else 0.1)[0]
        if 0 in ready:
            sent = os.read(0, 4096)
            if not sent:
                return
            signal.alarm(MAX_SILENCE)
            if file is None:
                os.write(device, sent.replace(b"\0", b""))
        data = file.read() if file else os.read(device, PIECE) if device in ready else b""
        if device in ready and not data:
            return
        os.write(1, data)


def main() -> None:
    """Do what the first line of standard input asks for."""
    with open(0, "rb", buffering=0, closefd=False) as requests:  # unbuffered: what follows is for the board
        request = json.loads(requests.readline())
    path, device, file = os.path.expanduser(request["path"]), DEVICE, None
    try:
        if stat.S_ISCHR(os.stat(path).st_mode):
            device = open_device(path, request["baud"], request["reset"])
        else:
            file = GrowingFile(path, (request["position"], bytes.fromhex(request["before"])))
    except OSError as error:
        sys.exit(f"{request['path']}: {error.strerror}")
    with contextlib.suppress(OSError):  # the board, the reader, or the file is gone
        serve(device, file)


if __name__ == "__main__":
    main()
