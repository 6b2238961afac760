"""What a pipe, a producer or a board may send without end."""

from __future__ import annotations

import gzip
import random
import socket
import threading
import time
from contextlib import suppress

PIECE = 1 << 16
LINES = b"".join(b"%d,%.1f\n" % (number, number / 2) for number in range(10_000))
FLOODS = {
    "lines": LINES,
    "a line without end": b"7" * PIECE,
    "zeros": bytes(PIECE),
    "noise": random.Random(1).randbytes(PIECE),
    "a gzip bomb": gzip.compress(bytes(100 * PIECE)),
    "nothing": b"",
}
"""One piece of each; it is sent again and again."""


class Flood:
    """A socket on which one client gets a piece again and again, as fast as it takes it, or at a rate."""

    def __init__(self, piece: bytes, *, rate: float | None = None) -> None:
        """Args: the piece; bytes a second, None = as fast as it is taken."""
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._piece, self._rate = piece, rate
        self.sent = 0
        """Bytes sent."""
        self._begin = 0.0
        self._pause, self._end = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    @property
    def lines(self) -> int:
        """Lines sent: those of whole pieces while it is paused."""
        return self.sent // max(len(self._piece), 1) * self._piece.count(b"\n")

    def pause(self) -> None:
        """Send no further piece."""
        self._pause.set()

    def resume(self) -> None:
        """Send again, at the rate from now on."""
        self.sent, self._begin = 0, time.monotonic()
        self._pause.clear()

    def __enter__(self) -> Flood:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join()

    def _run(self) -> None:
        with suppress(OSError), self._listener.accept()[0] as client:
            client.settimeout(0.1)
            self._begin = time.monotonic()
            while self._piece and not self._end.is_set():
                due = self._rate is None or self.sent <= self._rate * (time.monotonic() - self._begin)
                if due and not self._pause.is_set():
                    self._send(client)
                else:
                    self._end.wait(0.002)
            self._end.wait()

    def _send(self, client: socket.socket) -> None:
        """Send one piece whole, unless the end comes first."""
        rest = memoryview(self._piece)
        while rest and not self._end.is_set():
            with suppress(TimeoutError):
                count = client.send(rest)
                self.sent += count
                rest = rest[count:]
