"""Half an hour of a live board with everything on: does memory grow, does the chart fall behind, is a line lost?

A board on a pseudo-terminal sends numbered lines to the real program, which records them, with one Chromium page on
which the q slider is moved once a second. The recording is checked to the last digit as it grows. Exit status 1
where a line is lost, where memory grows by more than the samples that are kept (and once a million are kept, which
at 1,000 lines/s takes 21 minutes, at all), or where the lag grows.

    python benchmarks/soak.py [--json] [--minutes 30] [--rate 1000] [--channels 2] [--every 30] [--window "10 s"]
"""

from __future__ import annotations

import json
import os
import re
import statistics
import sys
import time
from dataclasses import asdict, dataclass

import numpy as np
from dashboard_page import (
    Program,
    choose,
    chromium,
    dashboard_page,
    slider,
    text_box,
)
from live_memory import MemoryLook, kept_mb, memory_of, settled_at
from machine import cpu_seconds, rss_mb
from numbered_board import NumberedBoard, RecordedRows, soak_parser
from playwright.sync_api import CDPSession, Page
from starved import Probe
from watch_draws import DrawWatch

RUN_ARRAYS = 5
"""Arrays of the filter's run over the channel on screen: x, p, k, innovation and s."""
MEMORY_MB = 50.0
"""Growth of the program beyond the kept samples that passes, MB: the allocator, and arrays while they move."""
HEAP_MB = 20.0
"""Growth of the page's heap that passes, MB."""
LAG_RATIO = 1.25
"""Lag of the last third to that of the first which passes."""
RECORDING = "soak.csv"
MOVE_EVERY = 1.0
"""Seconds between two moves of the slider."""


@dataclass(frozen=True)
class Look(MemoryLook):
    """What one interval showed; the memory at its end."""

    heap_mb: float
    """The page's JavaScript heap after a collection."""
    lag_ms: float
    """From the writing of a line to the end of the draw that shows it, median."""
    lag_p95_ms: float
    """95 of 100 lines are below this."""
    redraws_per_s: float
    """Draws a second that showed something newer."""
    cpu_percent: float
    """Processor time of the program, % of one core."""
    lost: int
    """Lines wrong or missing in the recording so far."""
    longest_pause_ms: float
    """Longest time since the start for which bytes waited for the reader, from the status on screen."""
    starved_ms: float
    """How late the machine woke a process that only sleeps, at most, in this interval."""
    load: float
    """The machine's load average over the last minute."""


def heap_mb(devtools: CDPSession) -> float:
    """The page's JavaScript heap after a collection, MB."""
    devtools.send("HeapProfiler.collectGarbage")
    metrics = devtools.send("Performance.getMetrics")["metrics"]
    return next(one["value"] for one in metrics if one["name"] == "JSHeapUsedSize") / 1e6


def begin_recording(page: Page) -> None:
    """As a user does it: the Source tab, the folder, the name, the button."""
    page.get_by_role("tab", name="Source", exact=True).click()
    page.get_by_text("Live board").click()
    text_box(page, "record to").fill(RECORDING)
    page.wait_for_timeout(200)  # viser holds back what comes within 50 ms of the last
    page.get_by_role("button", name="Record", exact=True).click()
    page.get_by_role("button", name="Stop recording", exact=True).wait_for()


def longest_pause_ms(page: Page) -> float:
    """The longest read latency that the Source tab shows, in ms; the page is left on the Tune tab."""
    page.get_by_role("tab", name="Source", exact=True).click()
    item = page.locator("li", has_text="max. read latency")
    item.wait_for()
    text = item.inner_text()
    page.get_by_role("tab", name="Tune", exact=True).click()
    slider(page, "q").wait_for()
    return pause_in(text)


def pause_in(status: str) -> float:
    """The longest read latency that the text of the status states, in ms.

    Raises:
        ValueError: it states none.
    """
    found = re.search(r"max. read latency: ([\d.,]+) (µs|ms|s)\s*$", status, re.MULTILINE)
    if found is None:
        raise ValueError(f"the status must state the max. read latency (got {status!r})")
    return float(found[1].replace(",", "")) * {"µs": 1e-3, "ms": 1.0, "s": 1e3}[found[2]]


def move_until(page: Page, end: float, moved: int) -> int:
    """Move the q slider once a second, ten steps up and ten down; how often it has been moved."""
    thumb = slider(page, "q")
    thumb.focus()
    while (now := time.monotonic()) < end:
        page.keyboard.press("ArrowRight" if moved // 10 % 2 == 0 else "ArrowLeft")
        moved += 1
        page.wait_for_timeout(1000.0 * max(0.0, min(MOVE_EVERY, end - now) - (time.monotonic() - now)))
    return moved


class Watch:
    """Looks at the program, its page and its recording, each time at what has happened since the last."""

    def __init__(self, program: Program, page: Page, board: NumberedBoard, probe: Probe) -> None:
        self._pid, self._page, self._board = program.process.pid, page, board
        self.rows, self.draws = RecordedRows(program.folder / RECORDING), DrawWatch(page)
        self._devtools = page.context.new_cdp_session(page)
        self._devtools.send("Performance.enable")
        self.begin = self.at = time.monotonic()
        self._cpu, self._probe = cpu_seconds(self._pid), probe

    def look(self) -> Look:
        """One line of the table."""
        drawn, now, cpu = self.draws.take(self._board), time.monotonic(), cpu_seconds(self._pid)
        self.rows.look()
        look = Look(
            minute=(now - self.begin) / 60.0,
            rss_mb=rss_mb(self._pid),
            kept_mb=kept_mb(self._board.sent, 1 + self._board.channels + RUN_ARRAYS),
            heap_mb=heap_mb(self._devtools),
            lag_ms=1000.0 * float(np.median(drawn.lag)),
            lag_p95_ms=1000.0 * float(np.percentile(drawn.lag, 95)),
            redraws_per_s=drawn.per_second,
            cpu_percent=100.0 * (cpu - self._cpu) / (now - self.at),
            lost=self.rows.wrong,
            longest_pause_ms=longest_pause_ms(self._page),
            starved_ms=1000.0 * self._probe.latest_since(self.at),
            load=os.getloadavg()[0],
        )
        self._cpu, self.at = cpu, now
        return look


def soak(minutes: float, board: NumberedBoard, every: float, window: str, tell: bool) -> dict[str, object]:
    """One run."""
    looks: list[Look] = []
    with (
        board,
        Probe() as probe,
        chromium() as browser,
        Program(f"serial:{board.port}@115200") as program,
    ):
        board.start()
        with dashboard_page(browser, program.url, live=True) as page:
            begin_recording(page)
            page.get_by_role("tab", name="Tune", exact=True).click()
            choose(page, "shows the last", window)
            watch, moved = Watch(program, page, board, probe), 0
            while watch.at - watch.begin < 60.0 * minutes:
                moved = move_until(page, watch.at + every, moved)
                looks.append(watch.look())
                if tell:
                    print(row(looks[-1]), flush=True)
            sent = board.stop()
            page.wait_for_timeout(1000)
        rows, lost = watch.rows, finish(program, watch.rows, sent)
    return judged(looks) | {
        "minutes": minutes,
        "rate": board.rate,
        "channels": board.channels,
        "window": window,
        "moves": moved,
        "sent": sent,
        "recorded": rows.rows,
        "lost": lost,
        "account": rows.account,
        "clock_error_ms": 1000.0 * watch.draws.clock_error,
        "longest_write_ms": 1000.0 * board.longest_write,
        "looks": [asdict(look) for look in looks],
    }


def finish(program: Program, rows: RecordedRows, sent: int) -> int:
    """End the program, which ends the recording; lines lost or wrong from the first recorded to the last sent."""
    program.process.terminate()
    program.process.wait(timeout=15.0)
    rows.look()
    return rows.wrong + max(sent - rows.first - rows.rows - rows.wrong, 0)


def judged(looks: list[Look]) -> dict[str, object]:
    """What the looks say about memory and lag; on a machine with more to do than cores, lag counts by its load."""
    third = max(len(looks) // 3, 1)
    first, last = (statistics.median(one.lag_ms for one in part) for part in (looks[:third], looks[-third:]))
    calm = [
        statistics.median(one.lag_ms / max(one.load / (os.cpu_count() or 1), 1.0) for one in part)
        for part in (looks[:third], looks[-third:])
    ]
    memory, heap_growth = memory_of(looks), looks[-1].heap_mb - looks[settled_at(looks)].heap_mb
    return {
        **memory,
        "heap_growth_mb": heap_growth,
        "lag_first_third_ms": first,
        "lag_last_third_ms": last,
        "lag_by_load_first_third_ms": calm[0],
        "lag_by_load_last_third_ms": calm[1],
        "memory_flat": memory["unexplained_mb"] <= MEMORY_MB and heap_growth <= HEAP_MB,
        "lag_flat": last <= LAG_RATIO * first or calm[1] <= LAG_RATIO * calm[0],
    }


HEAD = "  min   RSS MB  kept MB  heap MB  lag ms   p95  redraws/s  CPU %  lost  pause ms  starved ms  load"


def row(look: Look) -> str:
    """One line of the table."""
    return (
        f"{look.minute:5.1f} {look.rss_mb:8.0f} {look.kept_mb:8.1f} {look.heap_mb:8.1f} {look.lag_ms:7.0f}"
        f" {look.lag_p95_ms:5.0f} {look.redraws_per_s:10.1f} {look.cpu_percent:6.0f} {look.lost:5}"
        f" {look.longest_pause_ms:9.0f} {look.starved_ms:11.0f} {look.load:5.1f}"
    )


def main() -> None:
    parser = soak_parser(__doc__)
    parser.add_argument("--window", default="10 s", help="what the chart shows, as the dashboard names it")
    options = parser.parse_args()
    if not options.json:
        print(HEAD)
    board = NumberedBoard(options.rate, options.channels, 60.0 * options.minutes + 120.0)
    found = soak(options.minutes, board, options.every, options.window, tell=not options.json)
    good = found["lost"] == 0 and found["memory_flat"] and found["lag_flat"]
    if options.json:
        print(json.dumps(found, indent=1))
    else:
        print(*(f"{name:20} {value}" for name, value in found.items() if name != "looks"), sep="\n")
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
