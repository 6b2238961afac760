"""Key press on the slider of q or momentum -> changed chart drawn, in a real Chromium, for records of some lengths.

The lengths take turns (a fresh page each, ten presses a turn), and on each page the two sliders do, so that a noisy
machine hurts all of them. The momentum moves around some ten samples, where each press filters anew with momentum.
A press counts as drawn at the end of the first draw whose filtered line has other numbers than before, and as shown
when the browser begins the frame after next, for which it must be done with this one. The clock starts at the time
stamp of the key event itself.

    python benchmarks/slider_latency.py [--json] [--presses 30] [--samples 4000,100000,1000000] [--map]
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from dashboard_page import (
    FILTERED,
    SIGNAL_CHART,
    Program,
    chromium,
    dashboard_page,
    map_open,
    slider,
    text_box,
    wait_until_quiet,
)
from playwright.sync_api import Browser, Locator, Page

WHAT = ("drawn", "shown")
TURNS = 3
WARM_UP = 3
"""First presses of each page that do not count: the browser still compiles what it runs."""
PAUSE = 120
"""Milliseconds between two presses: viser holds back what comes within 50 ms of the last."""
MOMENTUM = "12"
"""Samples around which the momentum moves."""
SLIDERS = ("q", "momentum")
WITH_MAP = "q, map open"

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


def press_times(browser: Browser, url: str, presses: int, with_map: bool) -> dict[str, list[Press]]:
    """Key presses on the sliders of a fresh page, by the name of the slider."""
    with dashboard_page(browser, url) as page:
        page.evaluate(WATCH)
        times = {"q": presses_on(page, slider(page, "q"), presses)}
        if with_map:
            with map_open(page):
                times[WITH_MAP] = presses_on(page, slider(page, "q"), presses)
        text_box(page, "momentum").fill(MOMENTUM)
        wait_until_quiet(page, 1500)
        times["momentum"] = presses_on(page, slider(page, "momentum"), presses)
    return times


def presses_on(page: Page, thumb: Locator, presses: int) -> list[Press]:
    """Key presses on one slider, those of the warm-up left out."""
    thumb.focus()
    times = [one_press(page, "ArrowRight" if i % 2 else "ArrowLeft") for i in range(WARM_UP + presses)]
    return times[WARM_UP:]


def one_press(page: Page, key: str) -> Press:
    page.evaluate("() => window.__arm()")
    page.keyboard.press(key)
    page.wait_for_function("() => window.__shown !== null")
    drawn, shown = page.evaluate("() => [window.__drawn, window.__shown].map(time => time - window.__pressed)")
    page.wait_for_timeout(PAUSE)
    return Press(drawn, shown)


def measure(samples: list[int], presses: int, with_map: bool) -> list[dict[str, Any]]:
    """One row for each slider and number of samples, beside q at the first number, and q at its own."""
    names = (*SLIDERS, WITH_MAP) if with_map else SLIDERS
    taken: dict[tuple[str, int], list[Press]] = {(name, n): [] for n in samples for name in names}
    with ExitStack() as stack:
        browser = stack.enter_context(chromium())
        programs = {
            n: stack.enter_context(Program(f"synthetic:random_walk?n={n}&sigma=0.5&seed=1")) for n in samples
        }
        # a new browser's first page is slower than all others
        press_times(browser, programs[samples[0]].url, 0, with_map)
        left = presses
        for turn in range(TURNS):
            share = math.ceil(left / (TURNS - turn))
            left -= share
            for n in samples if turn % 2 == 0 else samples[::-1]:
                for name, times in press_times(browser, programs[n].url, share, with_map).items():
                    taken[name, n] += times
    rows = {key: summary(*key, times) for key, times in taken.items()}
    first = rows["q", samples[0]]
    for (_, n), row in rows.items():
        for what in WHAT:
            median = f"median_{what}_ms"
            row[f"ratio_{what}"] = row[median] / first[median]
            row[f"over_q_{what}"] = row[median] / rows["q", n][median]
    return list(rows.values())


def summary(name: str, n: int, times: list[Press]) -> dict[str, Any]:
    """Medians and 95th percentiles, ms."""
    row: dict[str, Any] = {"slider": name, "samples": n, "presses": len(times)}
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
    parser.add_argument("--map", action="store_true", help="the slider of q also while the map is open")
    options = parser.parse_args()
    rows = measure([int(part) for part in options.samples.split(",")], options.presses, options.map)
    if options.json:
        print(json.dumps(rows, indent=1))
        return
    heads = (f"{what} ms: median  p95   ratio  over q" for what in WHAT)
    print(f"{'slider':>11}  {'samples':>10}  {'presses':>7}", *heads, sep="   ")
    for row in rows:
        parts = (
            f"{row[f'median_{what}_ms']:>16.1f} {row[f'p95_{what}_ms']:>5.0f} {row[f'ratio_{what}']:>5.2f} ×"
            f" {row[f'over_q_{what}']:>5.2f} ×"
            for what in WHAT
        )
        print(f"{row['slider']:>11}  {row['samples']:>10,}  {row['presses']:>7}", *parts, sep="   ")


if __name__ == "__main__":
    main()
