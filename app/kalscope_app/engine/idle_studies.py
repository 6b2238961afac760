"""Idle-time computations: checks, map, spectra.

A study is a pure function of the State and a view that draws its answer. Studies run in the order given, on their
own thread; a newer state ends the round after the study that is running, so that the last state is always studied
and no old one is shown.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from kalscope_app.session.state import State

IDLE_DELAY = 0.2
"""Seconds without a new state after which the studies are computed."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Study:
    """One idle-time computation."""

    compute: Callable[[State], Any]
    """State -> answer; pure, any time it takes."""
    show: Callable[[Any], None]
    """Draws the answer; runs on the studies' thread."""


class Studies:
    """Computes every study of the latest state once it has stopped changing, so that no frame waits for them."""

    def __init__(self, studies: Sequence[Study], tell: Callable[[str | Exception], None]) -> None:
        """Args: what to compute, in this order; notifies the user of a failure."""
        self._studies = tuple(studies)
        self._tell = tell
        self._state: State | None = None
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
            if self._news.wait(timeout=IDLE_DELAY):
                continue
            if self._state is not None:
                self._round(self._state)

    def _round(self, state: State) -> None:
        for study in self._studies:
            if state is not self._state:
                return
            self._one(study, state)

    def _one(self, study: Study, state: State) -> None:
        try:
            answer = study.compute(state)
            if state is self._state:
                study.show(answer)
        except Exception as error:  # the thread must outlive any single state
            log.exception("A study failed")
            self._tell(error)
