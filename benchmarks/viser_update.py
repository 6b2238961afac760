"""What the cases of `viser_cases.py` share: a stock viser server with charts, and the clock of an update."""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout

import numpy as np
import viser
from playwright.sync_api import Page
from press_clock import Times, watch
from viser.uplot import Scale, Series

POINTS = 4000
"""Points of a chart where a case does not say otherwise."""
PAUSE_S = 0.25
"""Between two updates: each begins from rest."""
RNG = np.random.default_rng(1)

Chart = viser.GuiUplotHandle


@contextmanager
def viser_server() -> Iterator[viser.ViserServer]:
    """A stock server that listens to this machine alone."""
    with redirect_stdout(sys.stderr):  # what it says is no part of a table
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    with redirect_stdout(sys.stderr):
        server.stop()


def add_chart(server: viser.ViserServer, points: int = POINTS, label: str = "filtered") -> Chart:
    """A chart of time, a raw line and a line with a label."""
    return server.gui.add_uplot(
        lines(points),
        (Series(label="time"), Series(label="raw", stroke="gray"), Series(label=label, stroke="red")),
        scales={"x": Scale(time=False)},
        padding=(8, 24, 0, 0),
        height=300,
    )


def lines(points: int) -> tuple[np.ndarray[tuple[int], np.dtype[np.float64]], ...]:
    """Time, and two lines of random numbers."""
    return np.arange(points) / 100.0, RNG.normal(size=points), RNG.normal(size=points)


def timed(page: Page, act: Callable[[int], None], updates: int) -> list[Times]:
    """Seconds since 1970 of each update: began, set, drawn, painted."""
    watch(page)
    taken: list[Times] = []
    for i in range(updates + 3):
        page.evaluate("() => window.__arm()")
        page.wait_for_timeout(1000.0 * PAUSE_S)
        began = time.time()
        act(i)
        page.wait_for_function("() => window.__times.painted")
        taken.append({"began": began, **page.evaluate("() => window.__times")})
    return taken[3:]


def ms(taken: list[Times], end: str, begin: str = "began") -> float:
    """Median from one moment to another."""
    return 1e3 * statistics.median(one[end] - one[begin] for one in taken)
