"""What runs on the other machine of an ssh:// address: it opens a serial port or follows a file there.

`ssh.py` sends this text, and that of `growing_file.py` before it, to a Python that the machine has: it
imports nothing else of Kalscope and keeps to Python 3.7. Standard input is lines: one of JSON that names what to
open; then one for each piece to send to the board, in hexadecimal digits, and an empty one now and then, to show
that the reader is there. Standard output is MARK, a line of JSON that reports what was opened or why nothing was,
and then the bytes as they arrive.

Python rather than stty and cat: it sets 250000 baud, locks the port, knows its place in a file, and gives a port up
when nothing was received for MAX_SILENCE. A cat would hold it after the network has gone, and take half of the
bytes from the next reader.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import stat
import sys
import time
from typing import Any

from kalscope.sources.port.growing_file import GrowingFile, Replaced, Unusable

MARK = b"\0kalscope "
"""Precedes the first answer: what a login shell prints before it is skipped."""
MAX_SILENCE = 15.0
"""Seconds without a line on standard input after which a port is given up."""
_MAX_UNSENT = 4 << 20
_MAX_LINE = 1 << 16
_POLL = 0.1
_SENT_AT_ONCE = 1 << 16


class Pipes:
    """Standard input and output, neither of which ever waits."""

    def __init__(self) -> None:
        self.unsent = bytearray()
        self._rest = b""
        self._received_at = time.monotonic()
        os.set_blocking(1, False)

    @property
    def silence(self) -> float:
        """Seconds since a line came."""
        return time.monotonic() - self._received_at

    def first_line(self) -> bytes:
        """The first line of standard input."""
        line = b""
        while not line.endswith(b"\n") and len(line) < _MAX_LINE:
            piece = os.read(0, 1)
            if not piece:
                raise EOFError
            line += piece
        return line

    def wait(self, port: int | None, timeout: float) -> tuple[bool, list[bytes]]:
        """Wait for something to do, and send what can be sent.

        Args:
            port: A file descriptor that is waited for, too; None for none.
            timeout: Seconds to wait at most.

        Returns:
            Whether the port has bytes, and the pieces to send to the board.

        Raises:
            EOFError: the reader is gone.
        """
        reads = [0] if port is None else [0, port]
        ready, writable, _ = select.select(reads, [1] if self.unsent else [], [], timeout)
        if writable:
            del self.unsent[: os.write(1, bytes(self.unsent[:_SENT_AT_ONCE]))]
        return port in ready, self._pieces() if 0 in ready else []

    def _pieces(self) -> list[bytes]:
        data = os.read(0, 4096)
        if not data:
            raise EOFError
        self._received_at = time.monotonic()
        *lines, self._rest = (self._rest + data).split(b"\n")
        return [bytes.fromhex(line.decode("ascii")) for line in lines if line]

    def answer(self, **fields: Any) -> None:
        """Report what was opened, or why nothing was."""
        self.unsent += MARK + json.dumps(fields).encode("ascii") + b"\n"

    def finish(self) -> None:
        """Send what is left, if the reader takes it."""
        end = time.monotonic() + 2.0
        while self.unsent and time.monotonic() < end:
            self.wait(None, _POLL)


def open_device(path: str, baud: int, reset: bool) -> int:
    """A serial port: raw, 8N1, locked as pyserial locks one.

    Raises:
        Unusable: as for a file, "busy", "no port", or another text.
    """
    import errno
    import fcntl
    import termios
    import tty

    try:
        device = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as error:
        words = {errno.EACCES: "denied", errno.EBUSY: "busy"}
        raise Unusable(words.get(error.errno or 0, str(error))) from None
    try:
        fcntl.flock(device, fcntl.LOCK_EX | fcntl.LOCK_NB)
        tty.setraw(device)
        settings = termios.tcgetattr(device)
        settings[2] = (settings[2] & ~(termios.CSTOPB | termios.CRTSCTS)) | termios.CLOCAL | termios.CREAD
        speed = getattr(termios, "B%d" % baud, None)  # noqa: UP031
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
        os.close(device)
        raise Unusable("busy") from None
    except (OSError, termios.error) as error:
        os.close(device)
        number = error.args[0] if error.args else 0
        raise Unusable("no port" if number == errno.ENOTTY else str(error)) from None
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


def serve_device(pipes: Pipes, request: dict[str, Any]) -> None:
    """Pass bytes between a serial port and the reader until one of them is gone."""
    device = open_device(request["path"], request["baud"], request["reset"])
    pipes.answer(kind="device")
    while pipes.silence < MAX_SILENCE and len(pipes.unsent) < _MAX_UNSENT:
        has_bytes, pieces = pipes.wait(device, 1.0)
        if has_bytes:
            try:
                data = os.read(device, 4096)
            except OSError:
                data = b""
            if not data:
                break
            pipes.unsent += data
        for piece in pieces:
            _send(device, piece)
    pipes.finish()


def _send(device: int, piece: bytes) -> None:
    """Send all of it, or what the board takes within a second."""
    end = time.monotonic() + 1.0
    while piece and time.monotonic() < end:
        if select.select([], [device], [], _POLL)[1]:
            piece = piece[os.write(device, piece) :]


def serve_file(pipes: Pipes, request: dict[str, Any]) -> None:
    """Send the lines of a file, and those that are added, until the reader is gone or the file was replaced."""
    position, before = request["position"], bytes.fromhex(request["before"])
    file = GrowingFile(request["path"], position, before)
    pipes.answer(kind="file", position=file.position)
    try:
        while True:
            pipes.wait(None, _POLL)
            while len(pipes.unsent) < _SENT_AT_ONCE:
                lines = file.read()
                if not lines:
                    break
                pipes.unsent += lines
    except Replaced:
        pipes.finish()


def main() -> None:
    """Do what the first line of standard input asks for."""
    pipes = Pipes()
    try:
        request = json.loads(pipes.first_line().decode("ascii"))
        home = request["path"].startswith("~/")
        request["path"] = os.path.expanduser(request["path"]) if home else request["path"]
        try:
            is_device = stat.S_ISCHR(os.stat(request["path"]).st_mode)
            (serve_device if is_device else serve_file)(pipes, request)
        except FileNotFoundError:
            pipes.answer(error="missing")
        except PermissionError:
            pipes.answer(error="denied")
        except Unusable as error:
            pipes.answer(error=str(error))
        pipes.finish()
    except (EOFError, BrokenPipeError):
        pass


if __name__ == "__main__":
    main()
