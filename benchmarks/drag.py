"""The q slider dragged to and fro: after every drag the drawn curve must be that of the last value.

Each drag moves the thumb by the mouse for some seconds over most of its track, lets go at a random place, and is
right when, within five seconds and still half a second later, the slider stands where it was let go, the text box
holds its q, and the drawn filtered line is `kalman_filter` of that q, to the last bit. Exit status 1 otherwise.

    python benchmarks/drag.py [--json] [--drags 30] [--seconds 3] [--samples 100000]
"""

from __future__ import annotations

import argparse
import json
import random
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from dashboard_page import Program, chromium, dashboard_page, filtered_line, slider, text_box
from numpy.typing import NDArray
from playwright.sync_api import Page

from kalscope import FilterParams, kalman_filter, starting_params
from kalscope.catalogue import open_source
from kalscope_app.engine.decimation import choose_samples
from kalscope_app.views.scales import scale_for

Line = Callable[[float], NDArray[np.float64]]

PATIENCE = 5.0
"""Seconds that the right curve may take to come."""
STAYS = 500
"""Milliseconds that it must stay: a late answer to an older value would come by then."""
TRACK = (0.15, 0.85)
"""Part of the slider's track that the mouse sweeps; at the ends values would repeat."""


@dataclass(frozen=True)
class Drag:
    """One drag and what it led to."""

    right: bool
    """Slider, text box and curve all agree with the value at release, and stayed so."""
    settle_ms: float
    """From release to the right curve, ms; the time limit if it never appeared."""
    moves: int
    """Mouse moves of the drag."""
    left_at: float
    """log10 q on the slider at release."""
    why: str
    """What was wrong, "" if nothing."""


def expected_line(source: str) -> Line:
    """What the dashboard must draw for a q: the filter on all samples, at the samples drawn, in the axis' unit."""
    recording = open_source(source)
    z = recording.channel(recording.names[0])
    shown = choose_samples(recording, recording.names[0], None)
    factor = scale_for(shown.raw, recording.units[0]).factor
    r = starting_params(z).r
    return lambda q: kalman_filter(z, FilterParams(q=q, r=r)).x[shown.indices] * factor


def drag(page: Page, seconds: float, expected: Line, rng: random.Random) -> Drag:
    """One drag of the q slider."""
    thumb = slider(page, "q")
    root = thumb.locator("xpath=ancestor::*[contains(@class, 'Slider-root')][1]")
    track, at = root.bounding_box(), thumb.bounding_box()
    if track is None or at is None:
        raise RuntimeError("the q slider must be on screen (got no box)")
    y = at["y"] + at["height"] / 2.0
    page.mouse.move(at["x"] + at["width"] / 2.0, y)
    page.mouse.down()
    moves, end, place = 0, time.monotonic() + seconds, rng.uniform(*TRACK)
    while time.monotonic() < end:
        goal = rng.uniform(*TRACK)
        while abs(goal - place) > 0.02 and time.monotonic() < end:
            place += 0.02 if goal > place else -0.02
            page.mouse.move(track["x"] + place * track["width"], y)
            moves += 1
    page.mouse.up()
    released = time.monotonic()
    left_at = float(thumb.get_attribute("aria-valuenow") or "nan")
    q = float(f"{10.0**left_at:.2e}")  # the slider gives three digits
    line = expected(q)
    why = wait_until_right(page, left_at, q, line, released)
    settled = 1000.0 * (time.monotonic() - released)
    if not why:
        page.wait_for_timeout(STAYS)
        why = what_is_wrong(page, left_at, q, line)
    return Drag(not why, settled, moves, left_at, why)


def wait_until_right(page: Page, left_at: float, q: float, line: NDArray[np.float64], since: float) -> str:
    """Look until nothing is wrong, or patience ends; what was wrong then."""
    while why := what_is_wrong(page, left_at, q, line):
        if time.monotonic() - since > PATIENCE:
            return why
    return ""


def what_is_wrong(page: Page, left_at: float, q: float, line: NDArray[np.float64]) -> str:
    """The first thing on screen that does not belong to q; "" if all does."""
    drawn = np.array(filtered_line(page))
    if drawn.shape != line.shape or not np.array_equal(drawn, line):
        return f"the curve is not that of q = {q:g}"
    if float(text_box(page, "process noise q").input_value()) != q:
        return f"the text box does not hold q = {q:g}"
    now = float(slider(page, "q").get_attribute("aria-valuenow") or "nan")
    return "" if now == left_at else f"the slider went from {left_at:g} to {now:g}"


def measure(drags: int, seconds: float, samples: int) -> list[Drag]:
    """All drags, one page."""
    source = f"synthetic:random_walk?n={samples}&sigma=0.5&seed=1"
    expected, rng = expected_line(source), random.Random(1)
    with Program(source) as program, chromium() as browser, dashboard_page(browser, program.url) as page:
        return [drag(page, seconds, expected, rng) for _ in range(drags)]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--drags", type=int, default=30)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--samples", type=int, default=100_000)
    options = parser.parse_args()
    drags = measure(options.drags, options.seconds, options.samples)
    right = sum(one.right for one in drags)
    settle = [one.settle_ms for one in drags]
    if options.json:
        summary = {"right": right, "drags": len(drags), "samples": options.samples, "seconds": options.seconds}
        print(json.dumps(summary | {"each": [vars(one) for one in drags]}, indent=1))
    else:
        print(f"{right} of {len(drags)} drags of {options.seconds:g} s end on the right curve")
        print(f"release to the right curve: median {statistics.median(settle):.0f} ms, most {max(settle):.0f} ms")
        print(f"mouse moves a drag: median {statistics.median(one.moves for one in drags):.0f}")
        for number, one in enumerate(drags, 1):
            if not one.right:
                print(f"drag {number}, let go at {one.left_at:g}: {one.why}")
    sys.exit(0 if right == len(drags) else 1)


if __name__ == "__main__":
    main()
