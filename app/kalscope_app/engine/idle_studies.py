"""Idle-time computations: checks, map, spectra.

A study is a pure function of the State and a view that draws its answer. Studies run in the order given, on their
own thread; a newer state ends the round after the study that is running, so that the last state is always studied
and no old one is shown.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from kalscope_app.session.state import State

IDLE_DELAY = 0.2
"""Seconds without a new state after which the studies are computed, at least."""

MAX_IDLE_DELAY = 1.0
"""And at most."""


def idle_delay(longest: float) -> float:
    """Seconds without a new state to wait for before a round of studies.

    A study that has begun is not interrupted: on a long record it would slow down the next key press of a user who
    steps through values.

    Args:
        longest: seconds that the longest study of the last round took.
    """
    return min(max(IDLE_DELAY, longest), MAX_IDLE_DELAY)


@dataclass(frozen=True)
class Study:
    """One idle-time computation."""

    compute: Callable[[State], Any]
    """State -> answer; pure, and may take any time."""
    show: Callable[[Any], None]
    """Draws the answer; runs on the studies' thread."""
    fail: Callable[[Exception], object]
    """Called with what `compute` or `show` raised."""


class Studies:
    """Computes every study of the latest state once it has stopped changing, so that no frame waits for them."""

    def __init__(self, studies: Sequence[Study]) -> None:
        """Args: what to compute, in this order."""
        self._studies = tuple(studies)
        self._state: State | None = None
        self._longest = MAX_IDLE_DELAY  # at first: the browser is still loading the page
        self._news = threading.Event()
        threading.Thread(target=self._run, name="kalscope-studies", daemon=True).start()

    def of(self, state: State) -> None:
        """This state is on screen now."""
        if state is not self._state:
            self._state = state
            self._news.set()

    def _run(self) -> None:
        while True:
            self._news.wait()
            self._news.clear()
            if self._news.wait(timeout=idle_delay(self._longest)):
                continue
            if self._state is not None:
                self._round(self._state)

    def _round(self, state: State) -> None:
        took = [0.0]
        for study in self._studies:
            if state is not self._state:
                break
            start = time.monotonic()
            self._one(study, state)
            took.append(time.monotonic() - start)
        else:
            self._longest = 0.0  # a whole round: a shorter record may be open by now
        self._longest = max(self._longest, *took)

    def _one(self, study: Study, state: State) -> None:
        try:
            answer = study.compute(state)
            if state is self._state:
                study.show(answer)
        except Exception as error:  # the thread must outlive any single state
            study.fail(error)
