"""A board on the network that sends lines at a steady rate."""

from __future__ import annotations

import contextlib
import random
import socket
import threading
from collections.abc import Callable, Iterable, Iterator
from itertools import islice

MAX_LINES = 20_000
"""Lines that it sends at most."""


def noisy_walk() -> Iterator[str]:
    """Noise around a random walk."""
    rng, level = random.Random(1), 0.0
    while True:
        level += rng.gauss(0.0, 0.3)
        yield f"{level + rng.gauss(0.0, 5.0):.3f}\n"


@contextlib.contextmanager
def line_sender(rate: float = 100.0, lines: Callable[[], Iterable[str | bytes]] = noisy_walk) -> Iterator[str]:
    """The address, such as socket://127.0.0.1:4001, of a board that sends `rate` lines a second to each reader."""
    stopped = threading.Event()

    def send(connection: socket.socket) -> None:
        with contextlib.suppress(OSError), connection:  # the dashboard has closed it
            connection.settimeout(10.0)  # or has stopped reading
            for line in islice(lines(), MAX_LINES):
                connection.sendall(line.encode() if isinstance(line, str) else line)
                if stopped.wait(1.0 / rate):
                    return

    with socket.create_server(("127.0.0.1", 0)) as listening:

        def accept() -> None:
            with contextlib.suppress(OSError):  # the block has ended
                while True:
                    connection, _ = listening.accept()
                    threading.Thread(target=send, args=(connection,), daemon=True).start()

        threading.Thread(target=accept, daemon=True).start()
        yield f"socket://127.0.0.1:{listening.getsockname()[1]}"
        stopped.set()
