"""Key press on the slider of q or momentum -> changed line drawn, in a real Chromium, for records of some lengths.

The lengths take turns (a fresh page each, ten presses a turn), and on each page the two sliders do, so that a noisy
machine affects all of them alike. The momentum moves around some ten samples, where each press filters the record
again. The clock is that of `press_clock.py`.

    python benchmarks/slider_latency.py [--json] [--presses 30] [--samples 4000,100000,1000000] [--map]
"""

from __future__ import annotations

import argparse
import json
import math
import random
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from dashboard_page import Program, chromium, dashboard_page, map_open, slider, text_box, wait_until_quiet
from playwright.sync_api import Browser, Locator, Page
from press_clock import TURNS, Times, milliseconds, press_often, summary, watch

WHAT = ("drawn", "painted")
MOMENTUM = "12"
"""Samples around which the momentum moves."""
SLIDERS = ("q", "momentum")
WITH_MAP = "q, map open"


def press_times(browser: Browser, url: str, presses: int, with_map: bool) -> dict[str, list[Times]]:
    """Key presses on the sliders of a fresh page, by the name of the slider."""
    with dashboard_page(browser, url) as page:
        watch(page)
        times = {"q": presses_on(page, slider(page, "q"), presses)}
        if with_map:
            with map_open(page):
                times[WITH_MAP] = presses_on(page, slider(page, "q"), presses)
        with momentum_on(page):
            times["momentum"] = presses_on(page, slider(page, "momentum"), presses)
    return times


@contextmanager
def momentum_on(page: Page) -> Iterator[None]:
    """The filter with momentum; without it after it, because the next page shows the same session."""
    if text_box(page, "momentum").count() == 0:
        page.get_by_text("Start and outliers", exact=True).click()
        page.get_by_role("button", name="Add momentum").click()
    for value in (MOMENTUM, "off"):
        text_box(page, "momentum").fill(value)
        text_box(page, "momentum").press("Enter")
        wait_until_quiet(page, 1500)
        if value == MOMENTUM:
            yield


def presses_on(page: Page, thumb: Locator, count: int) -> list[Times]:
    """Key presses on one slider, those of the warm-up left out."""
    thumb.focus()
    return press_often(page, count, random.Random(1))


def measure(samples: list[int], presses: int, with_map: bool) -> list[dict[str, Any]]:
    """One row for each slider and number of samples, beside q at the first number, and q at its own."""
    names = (*SLIDERS, WITH_MAP) if with_map else SLIDERS
    taken: dict[tuple[str, int], list[Times]] = {(name, n): [] for n in samples for name in names}
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
    rows = {key: row_of(*key, times) for key, times in taken.items()}
    first = rows["q", samples[0]]
    for (_, n), row in rows.items():
        for what in WHAT:
            median = f"median_{what}_ms"
            row[f"ratio_{what}"] = row[median] / first[median]
            row[f"over_q_{what}"] = row[median] / rows["q", n][median]
    return list(rows.values())


def row_of(name: str, n: int, times: list[Times]) -> dict[str, Any]:
    """Medians and 95th percentiles, ms."""
    row: dict[str, Any] = {"slider": name, "samples": n, "presses": len(times)}
    for what in WHAT:
        row |= {f"{how}_{what}_ms": value for how, value in summary(milliseconds(times, what)).items()}
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
