"""Lines over TCP, datagrams and messages of a broker at the same time, none of which may be lost.

A second process sends numbered lines to each of the three at an even rate, over loopback; this one takes them in as
the dashboard does. The broker is mosquitto. Exit status 1 where a line is missing, doubled, changed or misplaced.

    python benchmarks/network.py [--json] [--seconds 60] [--rate 1000]
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import socket
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from kalscope.sources.live.source import LiveSource

SUPPORT = Path(__file__).parents[1] / "tests" / "support"
"""Where the tests keep their broker."""
PATIENCE = 30.0
"""Seconds after the last line within which all must have arrived."""


@dataclass(frozen=True)
class Figures:
    """What one source showed."""

    transport: str
    """tcp, udp or mqtt."""
    sent: int
    """Lines that were sent."""
    right: int
    """Samples that arrived, right and in order."""
    dropped: int
    """Lines that were counted as dropped."""


def send(tcp: int, udp: int, mqtt: int, lines: int, rate: float) -> None:
    """Send `lines` numbered lines to each port at `rate` a second; the first to TCP may be half of one."""
    datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with socket.create_server(("127.0.0.1", tcp)) as server:
        connection, _ = server.accept()
    client = paho.Client(CallbackAPIVersion.VERSION2)
    client.connect("127.0.0.1", mqtt)
    client.loop_start()
    connection.sendall(b"half a line\n")
    begin, sent = time.monotonic(), 0
    while sent < lines:
        due = min(int((time.monotonic() - begin) * rate), lines)
        connection.sendall(b"".join(b"%d,%d\n" % (i, -i) for i in range(sent, due)))
        for i in range(sent, due):
            datagrams.sendto(b"a:%d|g\nb:%d|g" % (i, -i), ("127.0.0.1", udp))
            client.publish("numbers", b"%d,%d" % (i, -i))
        sent = due
        time.sleep(0.002)
    time.sleep(PATIENCE / 10)
    client.disconnect()
    client.loop_stop()
    connection.close()


def rows_of(live: LiveSource) -> np.ndarray:
    """All samples that arrived, shape (n, 2); a channel that came alone is a row with a gap."""
    snapshot = live.snapshot()
    return np.empty((0, 2)) if snapshot is None else snapshot.recording.values


def figures(name: str, live: LiveSource, lines: int) -> Figures:
    """How many samples are the very numbers that were sent."""
    status, rows = live.status(), rows_of(live)
    numbers = np.arange(len(rows))
    right = int(np.sum((rows[:, 0] == numbers) & (rows[:, 1] == -numbers))) if len(rows) <= lines else 0
    return Figures(name, lines, right, status.dropped)


def measure(seconds: float, rate: float) -> list[Figures]:
    """Send for so long at so many lines a second."""
    sys.path[:0] = [str(SUPPORT), str(SUPPORT / "simulated_board"), str(SUPPORT / "starting")]
    from broker import broker  # pyright: ignore[reportMissingImports]
    from program import free_port  # pyright: ignore[reportMissingImports]

    lines = int(seconds * rate)
    with ExitStack() as stack:
        running = stack.enter_context(broker(Path(stack.enter_context(tempfile.TemporaryDirectory()))))
        ports = (free_port(), free_port(socket.SOCK_DGRAM), running.port)
        addresses = {
            "tcp": f"tcp://127.0.0.1:{ports[0]}",
            "udp": f"udp://:{ports[1]}",
            "mqtt": f"{running.address}/numbers",
        }
        sources = {name: stack.enter_context(LiveSource(address)) for name, address in addresses.items()}
        sender = multiprocessing.get_context("spawn").Process(target=send, args=(*ports, lines, rate))
        sender.start()
        end = time.monotonic() + seconds + 2 * PATIENCE
        while time.monotonic() < end and any(len(rows_of(live)) < lines for live in sources.values()):
            time.sleep(0.2)
        found = [figures(name, live, lines) for name, live in sources.items()]
        sender.join()
    return found


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=1000.0)
    options = parser.parse_args()
    found = measure(options.seconds, options.rate)
    if options.json:
        print(json.dumps([asdict(one) for one in found]))
    else:
        for one in found:
            print(f"{one.transport:5} {one.right} of {one.sent} lines right, {one.dropped} dropped")
    return int(any(one.right != one.sent for one in found))


if __name__ == "__main__":
    sys.exit(main())
