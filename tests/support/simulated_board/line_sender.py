"""A board on the network that sends one number a line, at a steady rate."""

from __future__ import annotations

import contextlib
import random
import socket
import threading
from collections.abc import Iterator

MAX_LINES = 20_000
"""Lines that it sends at most."""


@contextlib.contextmanager
def line_sender(rate: float = 100.0) -> Iterator[str]:
    """The address, such as socket://127.0.0.1:4001, of noise around a random walk, `rate` lines a second."""
    stopped = threading.Event()

    def send(connection: socket.socket) -> None:
        rng, level = random.Random(1), 0.0
        with contextlib.suppress(OSError), connection:  # the dashboard has closed it
            for _ in range(MAX_LINES):
                level += rng.gauss(0.0, 0.3)
                connection.sendall(f"{level + rng.gauss(0.0, 5.0):.3f}\n".encode())
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
