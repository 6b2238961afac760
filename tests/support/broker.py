"""A mosquitto of the test's own, on loopback, with a password or TLS where asked for; killed and started again."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from program import free_port
from required import not_here
from waiting import wait_until

USER, PASSWORD = "ada", "correct horse"


class Broker:
    """A broker that can be killed and started again at the same port."""

    def __init__(self, folder: Path, *lines: str) -> None:
        """Start; `folder` is for its files, `lines` go into its configuration."""
        found = shutil.which("mosquitto", path=os.environ.get("PATH", "") + ":/usr/sbin")
        self._program = found or not_here("mosquitto is not installed")
        self.port = free_port()
        self._config = folder / "mosquitto.conf"
        own = [f"listener {self.port} 127.0.0.1", f"user {os.environ.get('USER', 'root')}", "log_dest none"]
        lines = lines or ("allow_anonymous true",)
        self._config.write_text("\n".join([*own, *lines]) + "\n")
        self._process: subprocess.Popen[bytes] | None = None
        self.start()

    @property
    def address(self) -> str:
        """mqtt://127.0.0.1:PORT."""
        return f"mqtt://127.0.0.1:{self.port}"

    def start(self) -> None:
        """Start, and wait until it listens."""
        self._process = subprocess.Popen([self._program, "-c", self._config], stderr=subprocess.DEVNULL)
        wait_until(self._listens, "the broker to listen")

    def _listens(self) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def kill(self) -> None:
        """End it without a word to its clients."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()


@contextmanager
def broker(folder: Path, *lines: str) -> Iterator[Broker]:
    """A broker for the time of a block."""
    running = Broker(folder, *lines)
    try:
        yield running
    finally:
        running.kill()


@contextmanager
def publisher(broker: Broker, user: str = "", password: str = "") -> Iterator[Any]:
    """A client that is connected, with a thread of its own for the time of the block."""
    import paho.mqtt.client as paho

    client = paho.Client(paho.CallbackAPIVersion.VERSION2)
    if user:
        client.username_pw_set(user, password)
    client.max_inflight_messages_set(1000)
    client.connect("127.0.0.1", broker.port)
    client.loop_start()
    try:
        wait_until(client.is_connected, "the publisher to be connected")
        yield client
    finally:
        client.disconnect()
        client.loop_stop()
