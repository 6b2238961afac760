"""Key press on the q slider -> changed chart drawn, in a real Chromium, for records of three lengths.

The lengths take turns (a fresh page each, ten presses a turn), so that a noisy machine hurts all of them. A
press counts as drawn at the end of the first draw whose filtered line has other numbers than before, and as shown
when the browser begins the frame after next, for which it must be done with this one. The clock starts at the time
stamp of the key event itself.

    python benchmarks/slider_latency.py [--json] [--presses 30] [--samples 4000,100000,1000000]
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
from contextlib import ExitStack
from dataclasses import dataclass

from dashboard_page import FILTERED, SIGNAL_CHART, Program, chromium, dashboard_page, slider
from playwright.sync_api import Browser, Page

WHAT = ("drawn", "shown")
TURNS = 3
WARM_UP = 3
"""First presses of each page that do not count: the browser still compiles what it runs."""
PAUSE = 120
"""Milliseconds between two presses: viser holds back what comes within 50 ms of the last."""

WATCH = f"""() => {{
    const print = (numbers) => numbers.reduce((hash, value, i) => hash + value * (1 + i % 7), 0);
    window.addEventListener('keydown', (event) => {{ window.__pressed = event.timeStamp }}, true);
    window.__arm = () => {{
        const chart = {SIGNAL_CHART};
        window.__drawn = window.__shown = null;
        window.__before = print({FILTERED});
        if (chart.__watched) return;
        chart.__watched = true;
        (chart.hooks.draw = chart.hooks.draw ?? []).push((chart) => {{
            if (window.__drawn !== null || print({FILTERED}) === window.__before) return;
            window.__drawn = performance.now();
            requestAnimationFrame(() => requestAnimationFrame(() => {{ window.__shown = performance.now() }}));
        }});
    }};
}}"""


@dataclass(frozen=True)
class Press:
    """One key press, ms from it."""

    drawn: float
    """To the end of the draw of the changed chart."""
    shown: float
    """To the frame after next."""


def press_times(browser: Browser, url: str, presses: int) -> list[Press]:
    """Key presses on a fresh page."""
    with dashboard_page(browser, url) as page:
        page.evaluate(WATCH)
        slider(page, "q").focus()
        times = [one_press(page, "ArrowRight" if i % 2 else "ArrowLeft") for i in range(WARM_UP + presses)]
    return times[WARM_UP:]


def one_press(page: Page, key: str) -> Press:
    page.evaluate("() => window.__arm()")
    page.keyboard.press(key)
    page.wait_for_function("() => window.__shown !== null")
    drawn, shown = page.evaluate("() => [window.__drawn, window.__shown].map(time => time - window.__pressed)")
    page.wait_for_timeout(PAUSE)
    return Press(drawn, shown)


def measure(samples: list[int], presses: int) -> list[dict[str, float]]:
    """One row for each number of samples; the first is what the others are held against."""
    taken: dict[int, list[Press]] = {n: [] for n in samples}
    with ExitStack() as stack:
        browser = stack.enter_context(chromium())
        programs = {
            n: stack.enter_context(Program(f"synthetic:random_walk?n={n}&sigma=0.5&seed=1")) for n in samples
        }
        press_times(browser, programs[samples[0]].url, 0)  # a new browser's first page is slower than all others
        left = presses
        for turn in range(TURNS):
            share = math.ceil(left / (TURNS - turn))
            left -= share
            for n in samples if turn % 2 == 0 else samples[::-1]:
                taken[n] += press_times(browser, programs[n].url, share)
    rows = [summary(n, times) for n, times in taken.items()]
    return [
        row | {f"ratio_{what}": row[f"median_{what}_ms"] / rows[0][f"median_{what}_ms"] for what in WHAT}
        for row in rows
    ]


def summary(n: int, times: list[Press]) -> dict[str, float]:
    """Medians and 95th percentiles, ms."""
    row: dict[str, float] = {"samples": n, "presses": len(times)}
    for what in WHAT:
        sorted_times = sorted(getattr(press, what) for press in times)
        row[f"median_{what}_ms"] = statistics.median(sorted_times)
        row[f"p95_{what}_ms"] = sorted_times[math.ceil(0.95 * len(sorted_times)) - 1]
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--presses", type=int, default=30)
    parser.add_argument("--samples", default="4000,100000,1000000", help="the others are held against the first")
    options = parser.parse_args()
    rows = measure([int(part) for part in options.samples.split(",")], options.presses)
    if options.json:
        print(json.dumps(rows, indent=1))
        return
    print(f"{'samples':>10}  {'presses':>7}", *(f"{what} ms: median  p95   ratio" for what in WHAT), sep="   ")
    for row in rows:
        parts = (
            f"{row[f'median_{what}_ms']:>16.1f} {row[f'p95_{what}_ms']:>5.0f} {row[f'ratio_{what}']:>5.2f} ×"
            for what in WHAT
        )
        print(f"{row['samples']:>10,}  {row['presses']:>7}", *parts, sep="   ")


if __name__ == "__main__":
    main()
