"""Where each millisecond of a move of the q slider goes, beside bare viser with the same two lines.

Both programs run at once in processes of their own and take turns, a fresh page each. The clock is that of the
machine; it starts at the time stamp of the key event. A part lasts from the end of the part above it; medians.

    python benchmarks/slider_budget.py [--json] [--presses 30] [--samples 100000]
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
import tempfile
from collections import defaultdict
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from dashboard_page import FILTERED, SIGNAL_CHART, Program, chromium, dashboard_page, slider
from playwright.sync_api import Browser, Page

TURNS, WARM_UP, PAUSE = 3, 3, 120
"""Turns of each program; first presses of a page that do not count; milliseconds between two presses."""
LEAST_BYTES = 16_000
"""A message as large as this holds a line."""
SETTLE = 2500
"""Milliseconds after opening a page in which the studies of a short record end."""

PARTS = {
    "arrived": "browser: slider, viser's throttle of 50 ms, way to the server",
    "handled": "guard",
    "requested": "viser: decoding and its thread pool",
    "turn": "waiting for the engine's thread (at least 40 ms between two frames)",
    "applied": "the request itself",
    "computed": "frame: filter and numbers",
    "taken": "views write, until viser's sender takes the batch",
    "packed": "serialisation",
    "sent": "handing to the socket",
    "set": "browser: way, parsing, until uPlot has the line",
    "drawn": "browser: uPlot draws",
    "painted": "browser: until the frame after next",
}
"""The end of each part, and what it is."""
SERVER_PARTS = ("arrived", "handled", "requested", "turn", "applied", "computed", "taken", "packed", "sent")

WATCH = f"""() => {{
    const chart = {SIGNAL_CHART};
    const print = () => {FILTERED}.reduce((hash, value, i) => hash + value * (1 + i % 7), 0);
    const epoch = (time) => (performance.timeOrigin + time) / 1000;
    let before = print(), times = null;
    window.addEventListener('keydown', (event) => {{ times.pressed = epoch(event.timeStamp) }}, true);
    window.__arm = () => {{ before = print(); times = window.__times = {{}} }};
    (chart.hooks.setData = chart.hooks.setData ?? []).push(() => {{
        if (times && !times.set && print() !== before) times.set = epoch(performance.now());
    }});
    (chart.hooks.draw = chart.hooks.draw ?? []).push(() => {{
        if (!times?.set || times.drawn) return;
        const now = times;
        now.drawn = epoch(performance.now());
        requestAnimationFrame(() => requestAnimationFrame(() => {{ now.painted = epoch(performance.now()) }}));
    }});
}}"""

CHARTS = """() => Object.fromEntries(Object.entries(window.__viserTestpoints.uplots).map(([uuid, {chart}]) =>
    [uuid, chart.series.slice(1).map(series => series.label).join(', ')]))"""

Times = dict[str, float]


def press(page: Page, key: str) -> Times:
    """One key press on the focused slider; seconds since 1970."""
    page.evaluate("() => window.__arm()")
    page.keyboard.press(key)
    page.wait_for_function("() => window.__times.painted")
    times: Times = page.evaluate("() => window.__times")
    page.wait_for_timeout(PAUSE)
    return times


def press_times(browser: Browser, url: str, presses: int) -> tuple[list[Times], dict[str, str]]:
    """Presses on a fresh page, and what its charts are."""
    with dashboard_page(browser, url) as page:
        page.wait_for_timeout(SETTLE)
        page.evaluate(WATCH)
        slider(page, "q").focus()
        times = [press(page, "ArrowRight" if i % 2 else "ArrowLeft") for i in range(WARM_UP + presses)]
        return times[WARM_UP:], page.evaluate(CHARTS)


def parts_of(times: Times, marks: list[tuple[float, str, int]]) -> Times:
    """Milliseconds of each part of one press; a part that the program does not have is left out."""
    ends, last = dict(times), times["pressed"]
    for name in SERVER_PARTS:
        least = LEAST_BYTES if name == "sent" else 0
        found = next((t for t, kind, size in marks if kind == name and t >= last and size >= least), None)
        if found is not None and found <= times["drawn"]:
            ends[name] = last = found
    parts, last = {}, times["pressed"]
    for name in PARTS:
        if name in ends:
            parts[name], last = 1e3 * (ends[name] - last), ends[name]
    return parts


def sizes_of(times: Times, marks: list[tuple[float, str, int]], charts: dict[str, str]) -> dict[str, int]:
    """Bytes of the numbers of each chart that was sent for one press until it was painted."""
    sizes: dict[str, int] = defaultdict(int)
    for t, kind, size in marks:
        if times["pressed"] <= t <= times["painted"] and kind.startswith("chart "):
            sizes[charts.get(kind.removeprefix("chart "), "another chart")] += size
    return sizes


def measure(samples: int, presses: int) -> dict[str, Any]:
    """Medians for each program: its parts, the whole, and the bytes of its charts."""
    source, server = (
        f"synthetic:random_walk?n={samples}&sigma=0.5&seed=1",
        Path(__file__).with_name("budget_server.py"),
    )
    taken: dict[str, list[Times]] = {"kalscope": [], "bare": []}
    charts: dict[str, dict[str, str]] = {"kalscope": {}, "bare": {}}
    with tempfile.TemporaryDirectory() as folder:
        files = {kind: Path(folder) / kind for kind in taken}
        with ExitStack() as stack:
            browser = stack.enter_context(chromium())
            programs = {
                kind: stack.enter_context(Program(source, (sys.executable, server, kind, file)))
                for kind, file in files.items()
            }
            for turn in range(TURNS):
                for kind in taken if turn % 2 else reversed(taken):
                    times, seen = press_times(browser, programs[kind].url, math.ceil(presses / TURNS))
                    taken[kind] += times
                    charts[kind] |= seen
        marks = {kind: [tuple(one) for one in json.loads(file.read_text("utf-8"))] for kind, file in files.items()}
    return {kind: summary(taken[kind], marks[kind], charts[kind]) for kind in taken}


def summary(taken: list[Times], marks: list[Any], charts: dict[str, str]) -> dict[str, Any]:
    """Medians, ms and bytes."""
    parts = [parts_of(times, marks) for times in taken]
    sizes = [sizes_of(times, marks, charts) for times in taken]
    return {
        "parts_ms": {
            name: statistics.median(one[name] for one in parts if name in one)
            for name in PARTS
            if any(name in one for one in parts)
        },
        "drawn_ms": statistics.median(1e3 * (times["drawn"] - times["pressed"]) for times in taken),
        "painted_ms": statistics.median(1e3 * (times["painted"] - times["pressed"]) for times in taken),
        "bytes": {
            name: statistics.median(one.get(name, 0) for one in sizes) for name in sorted({*charts.values()})
        },
        "presses": len(taken),
    }


def table(found: dict[str, Any]) -> str:
    """The table, ms; parts of both side by side, then what each chart sends."""
    ours, bare = found["kalscope"], found["bare"]
    lines = [f"{'':<70} kalscope     bare   ratio"]
    rows = {PARTS[name]: (ours["parts_ms"].get(name), bare["parts_ms"].get(name)) for name in PARTS}
    rows["key press to changed line drawn"] = ours["drawn_ms"], bare["drawn_ms"]
    rows["key press to painted"] = ours["painted_ms"], bare["painted_ms"]
    for name, pair in rows.items():
        cells = "".join(f"{'–' if value is None else f'{value:.1f}':>9}" for value in pair)
        ratio = "" if None in pair or not pair[1] else f"{pair[0] / pair[1]:>6.1f} ×"
        lines.append(f"{name:<70}{cells}{ratio}")
    for kind, one in found.items():
        lines += ["", f"{kind}: bytes of numbers sent a move"]
        lines += [f"  {size:>9,.0f}  {name}" for name, size in one["bytes"].items()]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--presses", type=int, default=30)
    parser.add_argument("--samples", type=int, default=100_000)
    options = parser.parse_args()
    found = measure(options.samples, options.presses)
    print(json.dumps(found, indent=1) if options.json else table(found))


if __name__ == "__main__":
    main()
