"""Kill a recorder at random moments, again and again: what is lost, and is any value wrong?

    .venv/bin/python benchmarks/kill_recorder.py --kills 200 [--rate 1000] [--json]

A thread streams numbered lines `number,half of it` through a pseudo-terminal into `kalscope record`, which gets
SIGKILL at a random moment. What it had read and not yet written is lost: the number of the first line that it left
unread, less the last that is in the file. Beside it is how long the machine kept the recorder waiting for a
processor in its last half second: the longest wait of one of its threads, or of a process that only sleeps. Exit
status 1 where more than 0.25 s of lines plus that wait is lost, a row is missing or repeated, or a value is wrong.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import tty
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

from starved import Probe, waited

from kalscope.sources.reading.recording_file import read_recording

MAX_LOST_S = 0.25
"""The promise: seconds of received lines that a kill may cost."""
LAST_S = 0.5
"""Seconds before the kill in which waits for a processor count."""


@dataclass(frozen=True)
class Kill:
    """What one kill left."""

    rows: int
    """Whole rows in the file."""
    lost: int
    """Lines that were read from the port and are not in the file, a half-read one included."""
    torn: int
    """Bytes of the torn tail."""
    starved: float
    """Seconds for which the recorder got no processor in its last half second, as far as one can tell."""
    wrong: int
    """Rows that do not follow on from the one before, or hold a wrong value."""


class Board:
    """A pseudo-terminal and the thread that streams into it."""

    def __init__(self, rate: float) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.port = os.ttyname(self.slave)
        self._rate, self._end = rate, threading.Event()
        self._thread = threading.Thread(target=self._stream, daemon=True)
        self._thread.start()

    def next_unread(self) -> int:
        """Number of the first whole line that the last reader left."""
        data = b""
        while data.count(b"\n") < 2:
            data += os.read(self.slave, 4096)
        return int(data.split(b"\n")[1].split(b",")[0])

    def close(self) -> None:
        """End the thread and free the pseudo-terminal."""
        self._end.set()
        self._thread.join()
        os.close(self.slave)
        os.close(self.master)

    def _stream(self) -> None:
        begin, sent = time.monotonic(), 0
        while not self._end.wait(0.002):
            due = int((time.monotonic() - begin) * self._rate)
            with suppress(BlockingIOError):  # nothing reads between two runs
                os.write(self.master, b"".join(b"%d,%.1f\n" % (i, i / 2) for i in range(sent, due)))
            sent = due


def kill_once(board: Board, path: Path, wait: float, probe: Probe) -> Kill:
    """One run of the recorder, killed `wait` s after its first rows."""
    argv = [sys.executable, "-m", "kalscope.cli", "record", board.port, "-o", str(path)]
    process = subprocess.Popen(argv, stdout=subprocess.DEVNULL)
    while process.poll() is None and not (path.exists() and rows_of(path)):
        time.sleep(0.01)
    time.sleep(max(wait - LAST_S, 0.0))
    since, before = time.monotonic(), waited(process.pid)
    time.sleep(min(wait, LAST_S))
    if process.poll() is not None:
        raise RuntimeError(f"the recorder must run until it is killed (got status {process.returncode})")
    after = waited(process.pid)
    process.kill()
    process.wait()
    time.sleep(0.05)  # the probe may still sleep
    starved = max([probe.latest_since(since), *(after[task] - before.get(task, 0.0) for task in after)])
    received, torn = board.next_unread(), len(path.read_bytes().rpartition(b"\n")[2])
    rows = rows_of(path)
    wrong = sum(half != number / 2 for number, half in rows)
    wrong += sum(after[0] != before[0] + 1 for before, after in pairwise(rows))
    wrong += abs(len(read_recording(path)) - len(rows))
    return Kill(len(rows), int(received - 1 - rows[-1][0]), torn, starved, wrong)


def rows_of(path: Path) -> list[tuple[float, float]]:
    """(number, half of it) of the whole rows of a recording."""
    lines = path.read_bytes().rpartition(b"\n")[0].decode().split("\n")
    cells = [line.split(",") for line in lines if line and not line.startswith("#")][1:]
    return [(float(number), float(half)) for _, number, half in cells]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--rate", type=float, default=1000.0)
    options = parser.parse_args()
    moments, board = random.Random(1), Board(options.rate)
    with tempfile.TemporaryDirectory() as folder, Probe() as probe:
        kills = [
            kill_once(board, Path(folder) / f"{i}.csv", moments.uniform(0.0, 0.5), probe)
            for i in range(options.kills)
        ]
    board.close()
    lost, wrong = [kill.lost for kill in kills], sum(kill.wrong for kill in kills)
    own = [kill.lost / options.rate - kill.starved for kill in kills]
    good = max(own) <= MAX_LOST_S and wrong == 0
    over = [kill for kill in kills if kill.lost > MAX_LOST_S * options.rate]
    if options.json:
        print(
            json.dumps(
                {
                    "rate": options.rate,
                    "kept": good,
                    "own_most_s": max(own),
                    "load": os.getloadavg()[0],
                    "kills": [asdict(kill) for kill in kills],
                },
                indent=1,
            )
        )
    else:
        print(f"{len(kills)} kills at {options.rate:g} lines/s, {sum(kill.rows for kill in kills)} rows recorded")
        print(
            f"lost lines: median {statistics.median(lost):g}, most {max(lost)} ({max(lost) / options.rate:.3f} s)"
        )
        print(f"more than {MAX_LOST_S:g} s: {len(over)} kills, the recorder's own part at most {max(own):.3f} s")
        for kill in over:
            print(f"  {kill.lost} lines lost; {kill.starved:.3f} s without a processor in the last {LAST_S:g} s")
        starved = sorted(kill.starved for kill in kills)
        print(f"without a processor: median {starved[len(starved) // 2]:.3f} s, most {starved[-1]:.3f} s")
        print(f"load of the machine now: {os.getloadavg()[0]:.1f}")
        print(f"torn tails: {sum(kill.torn > 0 for kill in kills)}; wrong or missing rows: {wrong}")
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
