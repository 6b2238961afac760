"""The q slider dragged back and forth at 30 steps a second, beside bare viser with the same two lines, in turns.

Each drag moves the thumb for some seconds over most of its track and releases it at a random place. Measured are
the number of pictures with other numbers than the one before, and the time from release to the first picture that
belongs to the last value, in which every point drawn is that of the filter on all samples, and to the last picture.
Half a second later the slider of Kalscope must be where it was released, the text box must hold its q, and the line
must be that of `kalman_filter`, to the last bit. Exit status 1 otherwise, and where a target of the last lines is
missed.

The page itself sends the steps, as mouse events: a driver outside of it cannot keep 30 a second on a slow machine.

    python benchmarks/drag.py [--json] [--drags 30] [--seconds 3] [--samples 100000]
"""

from __future__ import annotations

import argparse
import json
import math
import random
import statistics
import sys
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from itertools import accumulate
from typing import Any

import numpy as np
from dashboard_page import FILTERED, SIGNAL_CHART, Program, chromium, slider, text_box
from machine import Load
from numpy.typing import NDArray
from peer_servers import PEERS, SIGMA
from playwright.sync_api import Browser, Page
from press_clock import TURNS, UPLOT, page_of, rotated, summary
from targets import Target

from kalscope import FilterParams, denoise, kalman_filter
from kalscope.catalogue import open_source
from kalscope.estimation.request import starting_params
from kalscope_app.engine.filter_runs import choose_samples
from kalscope_app.views.charts import scale_for

Line = NDArray[np.float64]

STEPS_PER_S = 30
REST_MS = 1200
"""Milliseconds after release in which the last picture may come and must stay."""
TRACK = (0.15, 0.85)
"""Part of the slider's track that is swept; at the ends values would repeat."""
MIN_PICTURES, MAX_RIGHT_MS, MAX_REST_MS = 15.0, 100.0, 300.0
"""The targets: changed pictures a second, release to the right picture, and to all of its points."""

DRAG = f"""([thumb, track, places, step, rest]) => new Promise((done) => {{
    const chart = {SIGNAL_CHART}, numbers = () => {FILTERED};
    const box = track.getBoundingClientRect(), y = box.top + box.height / 2, draws = [];
    const print = () => numbers().reduce((hash, value, i) => hash + (value || 0) * (1 + i % 7), numbers().length);
    const send = (target, kind, place) => target.dispatchEvent(new MouseEvent(kind, {{bubbles: true,
        cancelable: true, view: window, buttons: 1, clientX: box.left + place * box.width, clientY: y}}));
    let before = print(), released = null, i = 0;
    const note = () => {{
        const now = print();
        if (now === before) return;
        before = now;
        draws.push({{t: performance.now(), line: released && [Array.from(chart.data[0]), Array.from(numbers())]}});
    }};
    (chart.hooks.draw = chart.hooks.draw ?? []).push(note);
    const began = performance.now();
    send(thumb, 'mousedown', places[0]);
    const timer = setInterval(() => {{
        if (++i < places.length) return send(document, 'mousemove', places[i]);
        clearInterval(timer);
        released = performance.now();
        draws.push({{t: released, line: [Array.from(chart.data[0]), Array.from(numbers())]}});
        send(document, 'mouseup', places.at(-1));
        setTimeout(() => {{
            chart.hooks.draw.splice(chart.hooks.draw.indexOf(note), 1);
            const after = draws.filter(one => one.line), during = draws.length - after.length;
            done({{during, seconds: (released - began) / 1000, left_at: +thumb.ariaValueNow,
                after: after.map(one => [one.t - released, ...one.line]),
                end: [Array.from(chart.data[0]), Array.from(numbers())]}});
        }}, rest);
    }}, step);
}})"""


@dataclass(frozen=True)
class Drag:
    """One drag and what it led to."""

    pictures_per_s: float
    """Changed pictures a second until release."""
    right_ms: float
    """From release to the first picture of the last value, ms; inf if none came."""
    rest_ms: float
    """From release to the last picture, ms."""
    left_at: float
    """log10 q on the slider at release."""
    why: str
    """What was wrong at the end, "" if nothing."""


class Drawn:
    """What must be drawn: the filter on all samples, at the samples drawn; here that of `peer_servers.py`."""

    def __init__(self, source: str) -> None:
        self.recording = open_source(source)
        self.z = self.recording.channel(self.recording.names[0])
        self.shown = choose_samples(self.recording, self.recording.names[0], None)

    def line(self, left_at: float) -> Line:
        """All samples filtered, in the unit of the axis, for log10 q of the slider."""
        return denoise(self.z, FilterParams(10.0**left_at, SIGMA**2))

    def fault(self, _page: Page, _left_at: float) -> str:
        """The first widget that does not belong to the value at release; "" if all do."""
        return ""


class DrawnByKalscope(Drawn):
    """The same on the dashboard, whose slider gives three digits of q."""

    def line(self, left_at: float) -> Line:
        """All samples filtered, in the unit of the axis."""
        params = FilterParams(q=float(f"{10.0**left_at:.2e}"), r=starting_params(self.z).r)
        return kalman_filter(self.z, params).x * scale_for(self.shown.raw, self.recording.units[0]).factor

    def fault(self, page: Page, left_at: float) -> str:
        """Slider or text box."""
        if float(text_box(page, "process noise q").input_value()) != float(f"{10.0**left_at:.2e}"):
            return f"the text box does not hold that of log₁₀ q = {left_at:g}"
        now = float(slider(page, "q").get_attribute("aria-valuenow") or "nan")
        return "" if now == left_at else f"the slider went from {left_at:g} to {now:g}"


def drag(page: Page, seconds: float, oracle: Drawn, rng: random.Random) -> Drag:
    """One drag of the q slider."""
    thumb = slider(page, "q")
    track = thumb.locator("xpath=ancestor::*[contains(@class, 'Slider-root')][1]")
    places = path(round(seconds * STEPS_PER_S), rng)
    handles = [thumb.element_handle(), track.element_handle()]
    seen: Any = page.evaluate(DRAG, [*handles, places, 1000.0 / STEPS_PER_S, REST_MS])
    line, (x, y) = oracle.line(seen["left_at"]), np.array(seen["end"], dtype=float)
    why = oracle.fault(page, seen["left_at"])
    if not np.array_equal(y, line[oracle.shown.indices], equal_nan=True):
        why = f"the curve is not that of log₁₀ q = {seen['left_at']:g}"
    scale = x[-1] / oracle.recording.time[-1]
    rights = [
        t
        for t, *points in seen["after"]
        if belongs(np.array(points, dtype=float), line, oracle.recording.time * scale)
    ]
    ends = [t for t, *_ in seen["after"]]
    return Drag(
        seen["during"] / seen["seconds"],
        min(rights, default=math.inf),
        max(ends, default=0.0),
        seen["left_at"],
        why,
    )


def path(steps: int, rng: random.Random) -> list[float]:
    """Places on the track, each a little from the last, turning at random and at the ends."""

    def move(at: tuple[float, float], turns: float) -> tuple[float, float]:
        place, step = at
        step = -step if turns < 0.1 or not TRACK[0] <= place + step <= TRACK[1] else step
        return place + step, step

    start = rng.uniform(*TRACK), 0.02
    return [place for place, _ in accumulate((rng.random() for _ in range(steps)), move, initial=start)]


def belongs(points: NDArray[np.float64], line: Line, time: Line) -> bool:
    """Whether all points of a picture lie on a line; those drawn during a drag may be fewer, and rounded."""
    at = np.clip(np.searchsorted(time, points[0] - 1e-9 * time[-1]), 0, len(line) - 1)
    return bool(np.allclose(points[1], line[at], rtol=1e-9, atol=1e-9 * float(np.nanstd(line)), equal_nan=True))


def measure(drags: int, seconds: float, samples: int) -> tuple[dict[str, list[Drag]], Load]:
    """All drags of both programs, a fresh page for each share of them."""
    source, load, rng = f"synthetic:random_walk?n={samples}&sigma=0.5&seed=1", Load(), random.Random(1)
    oracles = {"kalscope": DrawnByKalscope(source), "bare viser": Drawn(source)}
    found: dict[str, list[Drag]] = {name: [] for name in oracles}
    with ExitStack() as stack:
        browser: Browser = stack.enter_context(chromium())
        programs = {
            "kalscope": stack.enter_context(Program(source)),
            "bare viser": stack.enter_context(Program(source, (sys.executable, PEERS, "viser"))),
        }
        for turn in range(TURNS):
            for name in rotated(list(programs), turn):
                with page_of(browser, programs[name], UPLOT) as page, load.stretch():
                    share = range(turn, drags, TURNS)
                    found[name] += [drag(page, seconds, oracles[name], rng) for _ in share]
    return found, load


def targets(drags: list[Drag]) -> list[Target]:
    """What the project promises of a drag; medians."""
    pictures, right, rest = (
        statistics.median(getattr(one, name) for one in drags) for name in ("pictures_per_s", "right_ms", "rest_ms")
    )
    return [
        Target("every drag ends right", sum(not one.why for one in drags), len(drags), "drags", at_least=True),
        Target("changed pictures a second", pictures, MIN_PICTURES, "a second", at_least=True),
        Target("release to the right picture", right, MAX_RIGHT_MS, "ms"),
        Target("release to the last picture", rest, MAX_REST_MS, "ms"),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--drags", type=int, default=30)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--samples", type=int, default=100_000)
    options = parser.parse_args()
    found, load = measure(options.drags, options.seconds, options.samples)
    verdict = targets(found["kalscope"])
    if options.json:
        drags = {name: [asdict(one) for one in each] for name, each in found.items()}
        print(json.dumps({"machine": load.summary(), "drags": drags, "targets": [asdict(one) for one in verdict]}))
    else:
        print(load)
        print(f"{'':<12}  pictures a second   release to right, ms: median     p95   to last, ms: median     p95")
        for name, drags in found.items():
            right, rest = summary([one.right_ms for one in drags]), summary([one.rest_ms for one in drags])
            rate = statistics.median(one.pictures_per_s for one in drags)
            times = f"{right['median']:>30.0f} {right['p95']:>7.0f} {rest['median']:>21.0f} {rest['p95']:>7.0f}"
            print(f"{name:<12}  {rate:>17.1f}   {times}")
            for number, one in enumerate(drags, 1):
                if one.why:
                    print(f"{name}, drag {number}, let go at {one.left_at:g}: {one.why}")
        print(*verdict, sep="\n")
    sys.exit(0 if all(one.met for one in verdict) else 1)


if __name__ == "__main__":
    main()
