"""What an idle page costs, beside bare viser with the same two lines and a slider.

Processor time of all processes of the browser, and of the server, while nothing moves. The cases take turns, each
on a fresh page: the map closed, the map open, three tabs at once, and a board that has stopped sending.

    python benchmarks/idle.py [--json] [--rounds 2] [--seconds 20] [--samples 100000]
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from dashboard_page import Program, chromium, dashboard_page
from machine import children_cpu, cpu_seconds
from numbered_board import NumberedBoard
from peer_servers import PEERS
from playwright.sync_api import Browser

SETTLE = 6.0
"""Seconds after the first picture that do not count."""
TABS = 3
BROWSER_LIMIT = 1.2
"""The promise: at most so many times what bare viser costs in the browser."""
SERVER_LIMIT = 0.5
"""The promise: percent of a core that the server uses at most."""
BARE = {"bare viser": 1, f"bare viser, {TABS} tabs": TABS}
LIVE_SECONDS, LIVE_RATE = 3.0, 1000.0


@dataclass(frozen=True)
class Case:
    """One thing that is left alone."""

    name: str
    program: Program
    tabs: int = 1
    live: bool = False

    @property
    def beside(self) -> str:
        """The case of bare viser that it is held against."""
        return next(name for name, tabs in BARE.items() if tabs == self.tabs)


def browser_seconds() -> float:
    """Processor time of all processes of the browser so far, s."""
    return sum(spent for kind, spent in children_cpu(os.getpid()).items() if kind.startswith("chromium"))


def left_alone(browser: Browser, case: Case, seconds: float) -> tuple[float, float]:
    """Percent of a core that browser and server use."""
    with ExitStack() as stack:
        tabs = (dashboard_page(browser, case.program.url, live=case.live) for _ in range(case.tabs))
        page, *_ = [stack.enter_context(tab) for tab in tabs]
        page.wait_for_timeout(1000.0 * SETTLE)
        pid = case.program.process.pid
        begin, browsers, server = time.monotonic(), browser_seconds(), cpu_seconds(pid)
        page.wait_for_timeout(1000.0 * seconds)
        lasted = time.monotonic() - begin
        return 100.0 * (browser_seconds() - browsers) / lasted, 100.0 * (cpu_seconds(pid) - server) / lasted


def open_map(browser: Browser, program: Program) -> None:
    """Open the map; the server remembers it for every page."""
    with dashboard_page(browser, program.url) as page:
        page.get_by_role("button", name="Map", exact=True).click()
        page.get_by_role("button", name="Hide map").wait_for()


def measure(rounds: int, seconds: float, samples: int) -> dict[str, dict[str, Any]]:
    """Medians of all cases."""
    source = f"synthetic:random_walk?n={samples}&sigma=0.5&seed=1"
    board = NumberedBoard(LIVE_RATE, 2, 60.0)
    with ExitStack() as stack:
        stack.enter_context(board)
        browser = stack.enter_context(chromium())
        bare = stack.enter_context(Program(source, (sys.executable, PEERS, "viser")))
        closed, opened = (stack.enter_context(Program(source)) for _ in range(2))
        live = stack.enter_context(Program(f"serial:{board.port}@115200"))
        open_map(browser, opened)
        board.start()
        time.sleep(LIVE_SECONDS)
        board.stop()
        cases = [
            *(Case(name, bare, tabs) for name, tabs in BARE.items()),
            Case("map closed", closed),
            Case("map open", opened),
            Case(f"map open, {TABS} tabs", opened, TABS),
            Case("board that stopped sending", live, live=True),
        ]
        taken: dict[str, list[tuple[float, float]]] = {case.name: [] for case in cases}
        for turn in range(rounds):
            for case in cases if turn % 2 else reversed(cases):
                taken[case.name].append(left_alone(browser, case, seconds))
    medians = {name: [statistics.median(part) for part in zip(*rows, strict=True)] for name, rows in taken.items()}
    return {
        case.name: {
            "browser_percent": medians[case.name][0],
            "server_percent": medians[case.name][1],
            "ratio": medians[case.name][0] / medians[case.beside][0],
            "rounds": taken[case.name],
        }
        for case in cases
    }


def kept(found: dict[str, dict[str, Any]]) -> bool:
    """Whether every case of Kalscope meets its target."""
    ours = [one for name, one in found.items() if name not in BARE]
    return all(one["ratio"] <= BROWSER_LIMIT and one["server_percent"] <= SERVER_LIMIT for one in ours)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--samples", type=int, default=100_000)
    options = parser.parse_args()
    found = measure(options.rounds, options.seconds, options.samples)
    if options.json:
        print(json.dumps(found, indent=1))
    else:
        print(f"{'percent of a core':<28} browser   server   browser : bare viser")
        for name, one in found.items():
            cells = f"{one['browser_percent']:>8.1f} {one['server_percent']:>8.2f}"
            print(f"{name:<28}{cells} {one['ratio']:>12.2f} ×")
    sys.exit(0 if kept(found) else 1)


if __name__ == "__main__":
    main()
