"""The clock of all slider benchmarks: key press on a slider -> changed line drawn -> painted, in a real Chromium.

It starts at the time stamp of the key event. "Drawn" is the end of the first draw whose filtered line has other
numbers than before (uPlot's draw hook, plotly's afterplot), "painted" the start of the frame after next, for which
the browser must be done with this one.
"""

from __future__ import annotations

import math
import random
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from dashboard_page import FILTERED, SIGNAL_CHART, Program, dashboard_page, slider
from machine import Load, cpu_seconds
from playwright.sync_api import Browser, Page

TURNS, WARM_UP = 3, 3
"""Turns of each program; first presses of a page that do not count: the browser still compiles what it runs."""
PAUSES_MS = (120, 500)
"""Between two presses, at random: viser holds back what comes within 50 ms, and a hand also waits for the rest."""
IDLE_SHARE, MAX_SETTLE = 0.1, 60.0
"""A program that uses less of a core for a second has ended what it does after opening; most seconds to wait."""

UPLOT = f"""{{find: () => {SIGNAL_CHART}, numbers: (chart) => {FILTERED}, watch: (chart, set, drawn) => {{
    (chart.hooks.setData = chart.hooks.setData ?? []).push(set);
    (chart.hooks.draw = chart.hooks.draw ?? []).push(drawn); }}}}"""
PLOTLY = """{find: () => document.querySelector('.js-plotly-plot'),
    numbers: (graph) => graph._fullData.find(trace => trace.name === 'filtered').y,
    watch: (graph, set, drawn) => graph.on('plotly_afterplot', () => { set(); drawn(); })}"""
"""JavaScript: how to find the chart, the numbers of its filtered line, and where it tells of both moments."""

WATCH = """() => {
    if (window.__arm) return;
    const kind = KIND, epoch = (time) => (performance.timeOrigin + time) / 1000;
    const print = (chart) => Array.from(kind.numbers(chart))
        .reduce((hash, value, i) => hash + (Number.isFinite(value) ? value : 0) * (1 + i % 7), 0);
    let before = null, times = null;
    window.addEventListener('keydown', (event) => { if (times) times.pressed = epoch(event.timeStamp) }, true);
    window.__arm = () => {
        const chart = kind.find();  // viser may have built it again
        before = print(chart);
        times = window.__times = {};
        if (chart.__watched) return;
        chart.__watched = true;
        kind.watch(chart, () => {
            if (times && !times.set && print(chart) !== before) times.set = epoch(performance.now());
        }, () => {
            if (!times?.set || times.drawn) return;
            const now = times;
            now.drawn = epoch(performance.now());
            requestAnimationFrame(() => requestAnimationFrame(() => { now.painted = epoch(performance.now()) }));
        });
    };
}"""

Times = dict[str, float]
"""Moments of one press, seconds since 1970: pressed, set, drawn, painted."""


class Taken(NamedTuple):
    """The presses of one program."""

    times: list[Times]
    load: Load
    """How busy the machine was meanwhile."""


def watch(page: Page, chart: str = UPLOT) -> None:
    """Make a page ready for `press`."""
    page.evaluate(WATCH.replace("KIND", chart))


def press(page: Page, key: str, pause_ms: float) -> Times:
    """One key press on the focused slider, and the pause after it."""
    page.evaluate("() => window.__arm()")
    page.keyboard.press(key)
    page.wait_for_function("() => window.__times.painted")
    times: Times = page.evaluate("() => window.__times")
    page.wait_for_timeout(pause_ms)
    return times


def press_often(page: Page, count: int, rng: random.Random) -> list[Times]:
    """Presses back and forth on the focused slider, those of the warm-up left out."""
    keys = ("ArrowLeft", "ArrowRight")
    times = [press(page, keys[i % 2], rng.uniform(*PAUSES_MS)) for i in range(WARM_UP + count)]
    return times[WARM_UP:]


@contextmanager
def page_of(browser: Browser, program: Program, chart: str) -> Iterator[Page]:
    """A fresh page of a program with its q slider focused, once the program rests."""
    if chart == UPLOT:
        with dashboard_page(browser, program.url) as page:
            settle(page, program.process.pid)
            slider(page, "q").focus()
            yield page
        return
    context = browser.new_context(viewport={"width": 1600, "height": 900})
    try:
        page = context.new_page()
        page.goto(program.url)
        page.wait_for_function(f"() => ({chart}).find()?._fullData")
        settle(page, program.process.pid)
        page.get_by_role("slider").focus()
        yield page
    finally:
        context.close()


def settle(page: Page, pid: int) -> None:
    """Wait until a program rests: the studies of a long record last for seconds."""
    end = time.monotonic() + MAX_SETTLE
    while time.monotonic() < end:
        before = cpu_seconds(pid)
        page.wait_for_timeout(1000)
        if cpu_seconds(pid) - before < IDLE_SHARE:
            return


def in_turns(
    browser: Browser,
    programs: Mapping[str, tuple[Program, str]],
    count: int,
    ready: Callable[[str, Page], Callable[[], object]] = lambda *_: lambda: None,
) -> dict[str, Taken]:
    """The presses of each program, which take turns, a fresh page each.

    Args:
        browser: where all are shown.
        programs: name to program and the kind of its chart.
        count: presses of each, at least.
        ready: called with the name and each page before its presses; what it returns is called after them.
    """
    taken = {name: Taken([], Load()) for name in programs}
    for turn in range(TURNS):
        for name in rotated(list(programs), turn):
            program, chart = programs[name]
            with page_of(browser, program, chart) as page:
                watch(page, chart)
                done = ready(name, page)
                with taken[name].load.stretch():
                    taken[name].times.extend(press_often(page, math.ceil(count / TURNS), random.Random(turn)))
                done()
    return taken


def rotated(names: Sequence[str], turn: int) -> Sequence[str]:
    """Each program begins once."""
    shift = turn % len(names)
    return [*names[shift:], *names[:shift]]


def milliseconds(taken: Sequence[Times], end: str) -> list[float]:
    """From each press to one of its moments."""
    return [1e3 * (times[end] - times["pressed"]) for times in taken]


def summary(values: Sequence[float]) -> dict[str, Any]:
    """Median and 95th percentile."""
    return {"median": statistics.median(values), "p95": p95(values)}


def p95(values: Sequence[float]) -> float:
    """The smallest of the values that 95 % do not exceed."""
    return sorted(values)[math.ceil(0.95 * len(values)) - 1]
