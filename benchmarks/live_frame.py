"""What one frame of a live board costs the program, with few samples kept and with a million.

The real engine and all views, without a browser: 55 samples of three channels come between two frames, as at 1,000
lines/s, and the frame is made as the program makes it. The lengths take turns. Times are processor time of the
thread, which a busy machine does not lengthen as it does the clock's. What is slower at more samples is shown by
the ratio to the first; the studies are left out (they look at the newest 100,000 samples, on another thread).

    python benchmarks/live_frame.py [--json] [--frames 200] [--samples 10000,100000,1000000] [--profile]
"""

from __future__ import annotations

import argparse
import cProfile
import json
import pstats
import statistics
import sys
import tempfile
import time
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import cast

import numpy as np

from kalscope.recording import Recording
from kalscope.sources.live.samples import SampleStore, Snapshot
from kalscope.sources.live.source import LiveSource, LiveStatus
from kalscope.sources.port.registry import port_of
from kalscope_app.dashboard import Dashboard
from kalscope_app.engine.engine import DELAYS
from kalscope_app.guard.server import guarded_server
from kalscope_app.session.changes import opened_live, set_span

RATE = 1000.0
NAMES = ("wave", "number", "noise")
NEW = 55
"""Samples that come between two frames."""
TURNS = 4
WINDOWS = ("10 s", "all")


class FullFeed:
    """A live source that has kept so many samples already."""

    recorder, spec = None, port_of("serial:/dev/null")

    def __init__(self, samples: int, status: LiveStatus) -> None:
        self._rng, self._status, self._version = np.random.default_rng(1), status, count()
        self._store = SampleStore(len(NAMES), 1_000_000)
        self.come(samples)

    def come(self, samples: int) -> None:
        """More samples."""
        number = np.arange(self._store.end, self._store.end + samples)
        noise = self._rng.normal(size=(2, samples))
        values = np.stack([500.0 + 300.0 * np.sin(number / 700.0) + 20.0 * noise[0], number, noise[1]], axis=1)
        self._store.append((number / RATE).tolist(), values.tolist())

    def snapshot(self) -> Snapshot:
        """As `LiveSource` gives it."""
        time, values = self._store.views()
        recording = Recording(time, NAMES, ("",) * len(NAMES), values, 1.0 / RATE, source="serial:x", title="x")
        return Snapshot(recording, self._store.first, 1, next(self._version))

    def status(self) -> LiveStatus:
        """As of a closed port."""
        return self._status


@dataclass(frozen=True)
class Bench:
    """A dashboard on a feed, its engine not started: the frames are made here."""

    feed: FullFeed
    dashboard: Dashboard

    def frame_ms(self) -> float:
        """One frame with new samples and all parts of the screen, ms of this thread's processor time."""
        self.feed.come(NEW)
        begin = time.thread_time()
        self.dashboard.engine._turn()
        self.dashboard.engine._show_parts(tuple(DELAYS))
        return 1000.0 * (time.thread_time() - begin)


def measure(samples: list[int], frames: int, profile: cProfile.Profile | None) -> list[dict[str, object]]:
    """One row for each window and number of samples."""
    rows: list[dict[str, object]] = []
    status = LiveSource("serial:/dev/null").status()
    for window in WINDOWS:
        taken: dict[int, list[float]] = {n: [] for n in samples}
        with tempfile.TemporaryDirectory() as folder:
            servers = {n: guarded_server("127.0.0.1", 0) for n in samples}
            benches = {n: bench(servers[n].server, n, status, Path(folder), window) for n in samples}
            for _ in range(TURNS):
                for n, one in benches.items():
                    if profile is not None and n == samples[-1]:
                        profile.enable()
                    taken[n] += [one.frame_ms() for _ in range(frames // TURNS)]
                    if profile is not None:
                        profile.disable()
            for one in servers.values():
                one.stop()
        first = statistics.median(taken[samples[0]])
        rows += [
            {
                "window": window,
                "samples": n,
                "median_ms": statistics.median(times),
                "p95_ms": float(np.percentile(times, 95)),
                "ratio": statistics.median(times) / first,
            }
            for n, times in taken.items()
        ]
    return rows


def bench(server, n: int, status: LiveStatus, folder: Path, window: str) -> Bench:
    """A dashboard whose board has sent `n` samples, after its first frames."""
    feed = FullFeed(n, status)
    dashboard = Dashboard(server, opened_live(cast("LiveSource", feed), "x"), folder)
    dashboard.engine._studies = None
    dashboard.session.request(set_span(window))
    one = Bench(feed, dashboard)
    for _ in range(5):
        one.frame_ms()
    return one


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--frames", type=int, default=200, help="frames of each row")
    parser.add_argument("--samples", default="10000,100000,1000000", help="the others are held against the first")
    parser.add_argument("--profile", action="store_true", help="where the time of the last length goes, to stderr")
    options = parser.parse_args()
    profile = cProfile.Profile(time.thread_time) if options.profile else None
    rows = measure([int(part) for part in options.samples.split(",")], options.frames, profile)
    if options.json:
        print(json.dumps(rows, indent=1))
    else:
        print("window     samples   ms CPU a frame: median    p95   ratio")
        for one in rows:
            print(
                f"{one['window']:6} {one['samples']:>11,}   {one['median_ms']:>22.2f} {one['p95_ms']:>6.2f}"
                f" {one['ratio']:>5.2f} ×"
            )
    if profile is not None:
        pstats.Stats(profile, stream=sys.stderr).sort_stats("cumulative").print_stats(60)


if __name__ == "__main__":
    main()
