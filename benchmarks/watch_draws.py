"""What the live benchmarks share: when the signal chart was drawn in Chromium, and the newest line in it."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from dashboard_page import SIGNAL_CHART
from numbered_board import NumberedBoard, number_of
from numpy.typing import NDArray
from playwright.sync_api import Page

WATCH = f"""() => {{
    window.__draws = [];
    const arm = () => {{
        const chart = {SIGNAL_CHART};
        if (!chart || chart.__watched) return;
        chart.__watched = true;
        const raw = chart.series.findIndex(series => ['raw', 'raw max'].includes(series.label));
        (chart.hooks.draw = chart.hooks.draw ?? []).push((chart) => {{
            window.__draws.push([performance.now(), chart.data[raw].at(-1)]);
        }});
    }};
    setInterval(arm, 50);  // a chart that viser rebuilds has no hook yet
}}"""
LOOKS_AT_CLOCK = 50


@dataclass(frozen=True)
class Draws:
    """The draws of some seconds."""

    redraws: int
    """Draws that showed a newer line than the one before."""
    seconds: float
    """From the first to the last of them."""
    lag: NDArray[np.float64]
    """From the writing of each line to the end of the first draw that shows it or a later one, s."""
    longest_between: float
    """Longest time between two of them, s."""

    @property
    def per_second(self) -> float:
        """Redraws a second."""
        return (self.redraws - 1) / self.seconds if self.seconds > 0.0 else 0.0


class DrawWatch:
    """Notes every draw on a page, in the time of this process, which also stamps the board's lines."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self.clock_error, self._offset = min(self._compare_clocks() for _ in range(LOOKS_AT_CLOCK))
        page.evaluate(WATCH)

    def _compare_clocks(self) -> tuple[float, float]:
        before = time.monotonic()
        browser = self._page.evaluate("() => performance.now()") / 1000.0
        after = time.monotonic()
        return (after - before) / 2.0, (before + after) / 2.0 - browser

    def take(self, board: NumberedBoard) -> Draws:
        """The draws since the last call."""
        taken = self._page.evaluate("() => window.__draws.splice(0)")
        table = np.array(taken, dtype=float).reshape(-1, 2)
        sent, written = board.sent, board.written()
        newest = number_of(table[:, 1], sent)
        news = np.flatnonzero(np.diff(newest, prepend=-1) > 0) if len(newest) else np.array([], dtype=int)
        moments, newest = table[news, 0] / 1000.0 + self._offset, newest[news]
        if len(newest) < 2:
            return Draws(len(newest), 0.0, np.array([np.nan]), np.nan)
        lines = np.arange(newest[0] + 1, newest[-1] + 1)
        lag = moments[np.searchsorted(newest, lines)] - written[lines]
        return Draws(len(newest), float(moments[-1] - moments[0]), lag, float(np.diff(moments).max()))
