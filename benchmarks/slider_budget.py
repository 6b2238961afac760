"""Where each millisecond of a move of the q slider goes, beside bare viser with the same two lines.

Both programs run at once in processes of their own and take turns, a fresh page each. The clock is that of the
machine; it starts at the time stamp of the key event. A part lasts from the end of the part above it. Below the
parts is all that a move causes until the next one: messages, bytes and drawing of each chart, frames of the
scene, processor time.

    python benchmarks/slider_budget.py [--json] [--presses 30] [--samples 100000] [--map]
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import defaultdict
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any

from budget_page import Mark, watch_browser
from dashboard_page import Program, chromium
from machine import Load
from press_clock import TURNS, UPLOT, WARM_UP, Taken, Times, in_turns, milliseconds, summary

MAX_AFTER = 2.0
"""Seconds after a press in which what comes belongs to it."""
LEAST_BYTES = 8_000
"""A message as large as this holds a line."""

PARTS = {
    "left": "browser: slider, viser's throttle of 50 ms",
    "arrived": "way to the server",
    "handled": "guard",
    "requested": "viser: decoding and its thread pool",
    "turn": "waiting for the engine's thread",
    "applied": "the request itself",
    "computed": "frame: filter and numbers",
    "chart": "views write, until the filtered line is handed to viser",
    "taken": "viser's queue, until its sender takes the line",
    "sending": "serialisation",
    "received": "way to the browser's worker",
    "handed": "browser: parsing in the worker, viser's pacing, way to the page",
    "set": "browser: React, until uPlot has the line",
    "drawn": "browser: uPlot draws",
    "painted": "browser: until the frame after next",
}
"""The end of each part, and what it is."""
IN_PAGE = ("set", "drawn", "painted")
"""Ends that the page notes for each press; of the others there are marks."""
WHOLE = {"drawn": "key press to changed line drawn", "painted": "key press to painted"}


def parts_of(times: Times, marks: list[Mark]) -> Times:
    """Milliseconds of each part of one press; a part that the program does not have is left out."""
    parts, last = {}, times["pressed"]
    for name in PARTS:
        if name in IN_PAGE:
            end = times[name]
        else:
            least = LEAST_BYTES if name in ("chart", "sending", "received", "handed") else 0
            end = next((t for t, kind, size in marks if kind == name and t >= last and size >= least), None)
        if end is not None and end <= times["painted"]:
            parts[name], last = 1e3 * (end - last), end
    return parts


def follows_of(taken: list[Times], marks: list[Mark], charts: dict[str, str]) -> dict[str, float]:
    """All that a move leads to until the next one of its page, means."""
    sums: dict[str, float] = defaultdict(float)
    for times, following in pairwise(taken):
        end = min(following["pressed"], times["pressed"] + MAX_AFTER)
        for t, kind, size in marks:
            if times["pressed"] <= t < end:
                for name, amount in amounts(kind, size, charts):
                    sums[name] += amount
    return {name: total / max(len(taken) - 1, 1) for name, total in sums.items()}


def amounts(kind: str, size: int, charts: dict[str, str]) -> list[tuple[str, float]]:
    """What one mark adds to the rows below the parts."""
    what, _, uuid = kind.partition(" ")
    chart = charts.get(uuid, "a chart that is not shown")
    if what == "pushed":
        return [(f"messages, {chart}", 1.0), (f"bytes of numbers, {chart}", size)]
    if what == "drew":
        return [(f"draws, {chart}", 1.0), (f"ms of drawing, {chart}", 1e-3 * size)]
    if what == "scene":
        return [("frames of the scene", 1.0), ("ms of the page for the scene", 1e-3 * size)]
    return [("messages without lines", 1.0)] if what == "push" else []


def report(taken: Taken, marks: list[Mark], charts: dict[str, str]) -> dict[str, Any]:
    """All numbers of one program, ms and bytes a move."""
    line = {uuid for uuid, labels in charts.items() if "filtered" in labels.split(", ")}
    known = {f"pushed {uuid}": "chart" for uuid in line} | {f"handed {uuid}": "handed" for uuid in line}
    marks = sorted((*marks, *((t, known[kind], size) for t, kind, size in marks if kind in known)))
    parts = [parts_of(times, marks) for times in taken.times]
    names = [name for name in PARTS if any(name in one for one in parts)]
    moves = len(taken.times) + TURNS * WARM_UP
    return {
        "parts_ms": {name: summary([one[name] for one in parts if name in one]) for name in names},
        **{f"{name}_ms": summary(milliseconds(taken.times, name)) for name in WHOLE},
        "follows": follows_of(taken.times, marks, charts)
        | {f"processor ms, {kind}": 1e3 * spent / moves for kind, spent in sorted(taken.load.own.items())},
        "presses": len(taken.times),
    }


def measure(samples: int, presses: int, *, with_map: bool) -> dict[str, Any]:
    """The numbers of both programs."""
    source = f"synthetic:random_walk?n={samples}&sigma=0.5&seed=1"
    server = Path(__file__).with_name("budget_server.py")
    marks: dict[str, list[Mark]] = {"kalscope": [], "viser": []}
    charts: dict[str, dict[str, str]] = {kind: {} for kind in marks}
    with tempfile.TemporaryDirectory() as folder:
        files = {kind: Path(folder) / kind for kind in marks}
        with ExitStack() as stack:
            browser = stack.enter_context(chromium())
            programs = {
                kind: stack.enter_context(Program(source, (sys.executable, server, kind, file), map_shown=with_map))
                for kind, file in files.items()
            }
            taken = in_turns(
                browser,
                {kind: (program, UPLOT) for kind, program in programs.items()},
                presses,
                lambda kind, page: watch_browser(page, marks[kind], charts[kind]),
            )
        for kind, file in files.items():
            marks[kind] += [(t, name, size) for t, name, size in json.loads(file.read_text("utf-8"))]
    load = sum((one.load for one in taken.values()), Load())
    return {"machine": str(load)} | {kind: report(taken[kind], marks[kind], charts[kind]) for kind in marks}


def table(found: dict[str, Any]) -> str:
    """The table, ms; parts of both side by side, then what a move leads to."""
    ours, bare = found["kalscope"], found["viser"]
    lines = [found["machine"], f"{'ms':<66}  kalscope  p95   bare viser  p95   ratio"]
    rows = {PARTS[name]: (ours["parts_ms"].get(name), bare["parts_ms"].get(name)) for name in PARTS}
    rows |= {words: (ours[f"{name}_ms"], bare[f"{name}_ms"]) for name, words in WHOLE.items()}
    for words, (one, other) in rows.items():
        left, right = (
            f"{'–':>10}{'':>5}" if x is None else f"{x['median']:>10.1f}{x['p95']:>5.0f}" for x in (one, other)
        )
        ratio = f"{one['median'] / other['median']:>6.1f} ×" if one and other and other["median"] else ""
        lines.append(f"{words:<66}{left}   {right}{ratio}")
    lines += ["", f"{'until the next move, means':<66}{'kalscope':>10}{'bare viser':>18}"]
    for name in sorted({*ours["follows"], *bare["follows"]}):
        one, other = (x["follows"].get(name, 0.0) for x in (ours, bare))
        lines.append(f"{name:<66}{one:>10,.1f}{other:>18,.1f}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--presses", type=int, default=30)
    parser.add_argument("--samples", type=int, default=100_000)
    parser.add_argument("--map", action="store_true", help="with the map open")
    options = parser.parse_args()
    found = measure(options.samples, options.presses, with_map=options.map)
    print(json.dumps(found, indent=1) if options.json else table(found))


if __name__ == "__main__":
    main()
