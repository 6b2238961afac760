"""A live source at full speed: lines of numbers over a pseudo-terminal, none of which may be lost.

A second process sends numbered lines, paced by its clock; this one takes them in as the dashboard does and looks at
a snapshot 20 times a second. Exit status 1 where a line is missing, doubled or changed.

    python benchmarks/live.py [--json] [--quick] [--seconds 60] [--rate 10000] [--channels 3]
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import multiprocessing.connection
import os
import resource
import sys
import threading
import time
from dataclasses import asdict, dataclass

import numpy as np

from kalscope.sources.live.source import LiveSource
from kalscope.sources.port.reader import BytesReceived

TICK = 0.001
"""Seconds between two writes of the board, as a USB chip hands over."""
LOOKS = 20.0
"""Snapshots a second."""
QUICK_SECONDS = 5.0


@dataclass(frozen=True)
class Figures:
    """What one run showed."""

    seconds: float
    """Length of the stream, s."""
    sent: int
    """Lines that the board sent."""
    kept: int
    """Samples that arrived, right and in order."""
    lost: int
    """Lines that did not; 0 is the promise."""
    cpu_percent: float
    """Processor time of this process, % of one core."""
    rss_mb_start: float
    """Resident memory when the first sample had come, MB."""
    rss_mb_end: float
    """The same at the end."""
    longest_gap_ms: float
    """Longest time between two reads of this stream, which never pauses, ms; the board's own delays are in it."""
    latency_median_ms: float
    """From the moment a line was sent to a snapshot that holds it, had one looked all the time, ms."""
    latency_p95_ms: float
    """95 of 100 are below this, ms."""
    snapshot_us: float
    """Time that one snapshot takes, median, µs."""


def board(
    master: int, rate: float, seconds: float, channels: int, pipe: multiprocessing.connection.Connection
) -> None:
    """Send `rate * seconds` lines: number, moment of sending in µs, and sums that tell a changed digit."""
    os.set_blocking(master, True)
    os.write(master, b"# numbered lines\n" + b",".join(b"c%d" % j for j in range(channels)) + b"\n")
    start, sent, total = time.monotonic(), 0, round(rate * seconds)
    while sent < total:
        now = time.monotonic()
        due = min(int((now - start) * rate) + 1, total)
        stamp = int(now * 1e6)
        lines = [",".join(map(str, values(number, stamp, channels))) for number in range(sent, due)]
        if lines:
            data = ("\n".join(lines) + "\n").encode()
            while data:
                data = data[os.write(master, data) :]
            sent = due
        time.sleep(TICK)
    pipe.send(sent)
    pipe.recv()


def values(number: int, stamp: int, channels: int) -> list[int]:
    """The numbers of one line."""
    return [number, stamp, *(number * j + stamp for j in range(2, channels))][:channels]


def measure(seconds: float, rate: float, channels: int, prefix: str = "") -> Figures:
    """One run; `prefix` is what stands before the terminal in the address."""
    import tty

    master, slave = os.openpty()
    tty.setraw(slave)
    own, other = multiprocessing.Pipe()
    latencies: list[float] = []
    looks: list[float] = []
    done = threading.Event()
    with LiveSource(prefix + os.ttyname(slave), keep=max(1_000_000, round(rate * seconds))) as live:
        while live.status().word != "connected":
            time.sleep(0.01)
        gaps = _watch_reads(live)
        process = multiprocessing.Process(target=board, args=(master, rate, seconds, channels, other))
        cpu = time.process_time()
        process.start()
        watcher = threading.Thread(target=_watch_latency, args=(live, latencies, done))
        watcher.start()
        rss = 0.0
        while not own.poll(1.0 / LOOKS):
            begin = time.perf_counter()
            snapshot = live.snapshot()
            looks.append(time.perf_counter() - begin)
            if snapshot is not None and not rss:
                rss = _rss()
        sent = own.recv()
        end = time.monotonic() + 10.0
        while live.status().accepted < sent and time.monotonic() < end:
            time.sleep(0.01)
        time.sleep(0.2)
        cpu = time.process_time() - cpu
        done.set()
        watcher.join()
        snapshot, status = live.snapshot(), live.status()
        own.send("done")
        process.join()
    os.close(slave)
    os.close(master)
    right = _right(snapshot.recording.values, channels) if snapshot else 0
    wrong = status.accepted != sent or status.rejected
    return Figures(
        seconds=seconds,
        sent=sent,
        kept=right,
        lost=max(sent - right, int(bool(wrong))),
        cpu_percent=100.0 * cpu / seconds,
        rss_mb_start=rss,
        rss_mb_end=_rss(),
        longest_gap_ms=1000.0 * max(gaps, default=0.0),
        latency_median_ms=1000.0 * float(np.median(latencies)),
        latency_p95_ms=1000.0 * float(np.percentile(latencies, 95)),
        snapshot_us=1e6 * float(np.median(looks)),
    )


def _watch_reads(live: LiveSource) -> list[float]:
    """The times between the reads, noted as the reader hands over."""
    gaps: list[float] = []
    take = live._take

    def note(received: BytesReceived) -> None:
        gaps.append(received.end - received.begin)
        take(received)

    live._take = note
    return gaps


def _watch_latency(live: LiveSource, latencies: list[float], done: threading.Event) -> None:
    """Look often; how old is the newest sample when it is first seen?"""
    seen = 0
    while not done.wait(0.002):
        snapshot = live.snapshot()
        if snapshot is not None and snapshot.version != seen:
            seen = snapshot.version
            latencies.append(time.monotonic() - float(snapshot.recording.values[-1, 1]) / 1e6)


def _right(table: np.ndarray, channels: int) -> int:
    """Rows with the number and the sums that they must have."""
    number, stamp = table[:, 0], table[:, 1]
    good = number == np.arange(len(table))
    for j in range(2, channels):
        good &= table[:, j] == number * j + stamp
    return int(np.count_nonzero(good))


def _rss() -> float:
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * resource.getpagesize() / 1e6
    except OSError:  # macOS
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_SECONDS:g} s")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=10_000.0)
    parser.add_argument("--channels", type=int, default=3)
    options = parser.parse_args()
    if options.channels < 2:
        parser.error("--channels must be at least 2: number and moment of sending")
    figures = measure(QUICK_SECONDS if options.quick else options.seconds, options.rate, options.channels)
    if options.json:
        print(json.dumps(asdict(figures), indent=1))
    else:
        for name, value in asdict(figures).items():
            print(f"{name:20} {value:.4g}" if isinstance(value, float) else f"{name:20} {value}")
    sys.exit(1 if figures.lost else 0)


if __name__ == "__main__":
    main()
