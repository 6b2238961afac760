"""A live board in a real Chromium: from a byte written to the chart drawn, and how often it is redrawn.

The board's lines have a number, which is read back from the drawn value of the newest one (`numbered_board.py`).
The lag is that of every line: from its writing into the pseudo-terminal to the end of the first draw that shows it
or a later one, by one clock. First with a window of 10 s, then with all once 100,000 samples are there. With
`--slow` the page computes so many times slower, and passes if no line is drawn later than 10 s.

    python benchmarks/live_latency.py [--slow 1] [--seconds 30] [--rate 1000] [--channels 3] [--least 100000]
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from functools import partial
from typing import Any

import numpy as np
from dashboard_page import Program, choose, chromium, dashboard_page
from machine import busy_seconds, children_cpu, cpu_seconds, rss_mb
from numbered_board import NumberedBoard
from playwright.sync_api import Page
from starved import Probe
from watch_draws import DrawWatch

SETTLE = 3.0
"""Seconds after a change of the window that do not count."""
REDRAWS = 15.0
"""The promise: redraws a second."""
SLOW_LAG_S = 10.0
"""Of a slow page: the longest lag."""


def watched(
    page: Page,
    draws: DrawWatch,
    board: NumberedBoard,
    probe: Probe,
    pid: int,
    window: str,
    *,
    seconds: float,
    slow: float,
) -> dict[str, Any]:
    """One row: how the chart keeps up with one window."""
    choose(page, "shows the last", window)
    processor = page.context.new_cdp_session(page)
    processor.send("Emulation.setCPUThrottlingRate", {"rate": slow})
    page.wait_for_timeout(1000.0 * SETTLE)
    draws.take(board)
    begin, cpu, machine, browser = time.monotonic(), cpu_seconds(pid), busy_seconds(), children_cpu(os.getpid())
    page.wait_for_timeout(1000.0 * seconds)
    late = probe.latest_since(begin)
    taken, lasted = draws.take(board), time.monotonic() - begin
    processor.send("Emulation.setCPUThrottlingRate", {"rate": 1.0})
    after = children_cpu(os.getpid())
    return {
        "window": window,
        "samples": board.sent,
        "redraws_per_s": taken.per_second,
        "longest_between_ms": 1000.0 * taken.longest_between,
        "lag_median_ms": 1000.0 * float(np.median(taken.lag)),
        "lag_p95_ms": 1000.0 * float(np.percentile(taken.lag, 95)),
        "lag_longest_ms": 1000.0 * float(taken.lag.max()),
        "program_cpu_percent": 100.0 * (cpu_seconds(pid) - cpu) / lasted,
        "browser_cpu_percent": {
            kind: round(100.0 * (spent - browser.get(kind, 0.0)) / lasted, 1)
            for kind, spent in after.items()
            if kind.startswith("chromium")
        },
        "machine_cpu_percent": 100.0 * (busy_seconds() - machine) / lasted,
        "cores": os.cpu_count(),
        "load": os.getloadavg()[0],
        "probe_late_ms": 1000.0 * late,
        "rss_mb": rss_mb(pid),
    }


def measure(board: NumberedBoard, seconds: float, least: int, slow: float) -> dict[str, Any]:
    """Both windows on one page."""
    with board, Probe() as probe, chromium() as browser, Program(f"serial:{board.port}@115200") as program:
        board.start()
        with dashboard_page(browser, program.url, live=True) as page:
            draws, pid = DrawWatch(page), program.process.pid
            watch = partial(watched, page, draws, board, probe, pid, seconds=seconds, slow=slow)
            rows = [watch("10 s")]
            while board.sent < least:
                page.wait_for_timeout(500)
            rows.append(watch("all"))
        return {
            "rate": board.rate,
            "slow": slow,
            "channels": board.channels,
            "clock_error_ms": 1000.0 * draws.clock_error,
            "longest_write_ms": 1000.0 * board.longest_write,
            "rows": rows,
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seconds", type=float, default=30.0, help="for each window")
    parser.add_argument("--rate", type=float, default=1000.0, help="lines a second")
    parser.add_argument("--channels", type=int, default=3)
    parser.add_argument("--least", type=int, default=100_000, help="samples that are there for the window of all")
    parser.add_argument("--slow", type=float, default=1.0, help="how many times slower the page computes")
    options = parser.parse_args()
    if options.channels < 2:
        parser.error("--channels must be at least 2: the wave and the number")
    longest = options.least / options.rate + 2.0 * options.seconds + 300.0
    board = NumberedBoard(options.rate, options.channels, longest)
    found = measure(board, options.seconds, options.least, options.slow)
    rows = found["rows"]
    if options.json:
        print(json.dumps(found, indent=1))
    else:
        for one in rows:
            print(*(f"{n:20} {v:.4g}" if isinstance(v, float) else f"{n:20} {v}" for n, v in one.items()), sep="\n")
            print()
    if options.slow > 1.0:
        passes = max(one["lag_longest_ms"] for one in rows) <= 1000.0 * SLOW_LAG_S
    else:
        passes = min(one["redraws_per_s"] for one in rows) >= REDRAWS
    sys.exit(0 if passes else 1)


if __name__ == "__main__":
    main()
