"""One worker thread: it applies the requests, computes one Frame for all views, and what is slower when idle."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from typing import Any

from kalscope.errors import KalscopeError
from kalscope_app.engine.filter_runs import FilterRuns
from kalscope_app.engine.frame import Frame, compute_frame
from kalscope_app.session.changes import studied
from kalscope_app.session.session import Session
from kalscope_app.session.state import State

# Which part of the screen is drawn when: what the user watches at once, the rest as soon as there is time.
#
# If every part were drawn for every step of a slider, the line that the user watches would lag in the browser. So
# some parts may lag behind the newest frame, each for a limited time. Pure: no clock and no thread.


class Part(IntEnum):
    """A part of the screen, in the order in which the parts are drawn."""

    SIGNAL = 0
    """The chart of the signal, with about two points to each pixel."""
    NUMBERS = 1
    """Header, boxes and sliders, the numbers, the goal, the mark in the map; the picture on a phone."""
    CHARTS = 2
    """The charts below that of the signal, and the line above it."""
    OTHER = 3
    """What is in other tabs and in closed folders. viser does not report which tab is open."""
    FULL = 4
    """The chart of the signal with all its points."""


DELAYS: Mapping[Part, tuple[float, float]] = {
    Part.NUMBERS: (0.06, 0.08),
    Part.CHARTS: (0.12, 0.13),
    Part.OTHER: (0.12, 1.0),
    Part.FULL: (0.12, math.inf),
}
"""How long a part may lag behind the newest frame, s: without a newer one (a slider that moves brings one every
0.05 s), and while newer ones keep coming."""


class Schedule:
    """Which parts are behind the newest frame, and when each must be drawn. Times are in s, of one clock."""

    def __init__(self) -> None:
        self._newest, self._behind = -math.inf, dict[Part, float]()

    def begin(self, now: float, *, whole: bool) -> tuple[Part, ...]:
        """A new frame has arrived: which of its parts to draw now; `whole`: none may wait."""
        self._newest = now
        self._behind = {} if whole else {part: self._behind.get(part, now) for part in DELAYS}
        return tuple(Part) if whole else (Part.SIGNAL,)

    def next_due(self) -> float:
        """When the next part is due if no newer frame comes; inf if none is behind."""
        return min(map(self._due, self._behind), default=math.inf)

    def take_due(self, now: float, *, moving: bool) -> tuple[Part, ...]:
        """The parts of the newest frame to draw now, which then are no longer behind.

        Args:
            now: the time.
            moving: whether a newer frame is due too: it takes precedence over parts that may still wait.
        """
        due = tuple(part for part in sorted(self._behind) if now >= self._due(part, moving=moving))
        for part in due:
            del self._behind[part]
        return due

    def _due(self, part: Part, *, moving: bool = False) -> float:
        since, (still, longest) = self._behind[part], DELAYS[part]
        return since + longest if moving else min(self._newest + still, since + longest)


def is_move(before: State, after: State) -> bool:
    """Whether only values of the filter have changed, or a live record has grown; no line and no chart is new."""
    return _what_is_drawn(before) == _what_is_drawn(after)


def _what_is_drawn(state: State) -> tuple[object, ...]:
    momentum = state.uses_parameters and state.tuning.momentum > 0.0
    shown = state.record_key, state.measured, state.board, state.variants, state.view
    return *shown, state.is_standard, state.tuning.chain, momentum, state.note


# Idle-time computations: checks, map, spectra.
#
# A study is a pure function of the State and a view that draws its answer. Studies run in the order given, on their
# own thread; a newer state ends the round after the study that is running, so that the last state is always studied
# and no old one is shown.


IDLE_DELAY = 0.2
"""Seconds without a new state after which the studies are computed, at least; else as long as the longest took.

A study that has begun is not interrupted: on a long record it would slow down the next key press of a user who
steps through values."""

MAX_IDLE_DELAY = 1.0
"""And at most."""


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
            delay = min(max(IDLE_DELAY, self._longest), MAX_IDLE_DELAY)
            if not self._news.wait(timeout=delay) and self._state is not None:
                self._round(self._state)

    def _round(self, state: State) -> None:
        took = [0.0]
        for study in self._studies:
            if state is not self._state:
                took.append(self._longest)  # not a whole round: a longer study may be still to come
                break
            start = time.monotonic()
            try:
                answer = study.compute(state)
                if state is self._state:
                    study.show(answer)
            except Exception as error:  # the thread must outlive any single state
                study.fail(error)
            took.append(time.monotonic() - start)
        self._longest = max(took)


# One worker thread: it applies the requests, computes one Frame for all of them, and passes it to the views.
#
# The latest request wins because requests are cheap and a Frame is computed only after all waiting ones. While a
# control moves, a part of each Frame is shown at once and the rest when there is time (`engine.py`). What is slower
# is left to the studies, which have their own thread.


MIN_INTERVAL = 0.04
"""Seconds between two frames, at least: in a slower browser frames would pile up."""

LIVE_INTERVAL = 0.045
"""Seconds between two frames of a live record: 22 a second."""

STATUS_INTERVAL = 0.5
"""Seconds after which a live record without new samples is drawn if its status has changed, and polled while it is
silent."""

STUDY_INTERVAL = 3.0
"""Seconds between two rounds of idle-time computations for a live record that is not being tuned."""

SETTLING = STUDY_INTERVAL + 1.0
"""Seconds after its newest sample during which it is drawn that often anyway: the last samples are studied, too,
and the range control moves once a second."""


class Engine:
    """Session -> Frame, on its own thread."""

    def __init__(
        self,
        session: Session,
        show: Callable[[Frame, Collection[Part]], None],
        tell: Callable[..., None],
        studies: Studies | None = None,
        fail: Callable[[Exception], None] | None = None,
    ) -> None:
        """Make an engine.

        Args:
            session: whose state is shown.
            show: draws parts of a frame.
            tell: notifies the user of a refused request.
            studies: what to compute while idle.
            fail: called where a frame cannot be computed or drawn; None: `tell`.
        """
        self._session = session
        self._show = show
        self._tell, self._fail = tell, fail or tell
        self._studies = studies
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="kalscope-engine", daemon=True)
        self._runs = FilterRuns()
        self._frame: Frame | None = None
        self._schedule = Schedule()
        self._begun = self._frame_at = self._news_at = self._study_at = -math.inf
        self.first_frame = threading.Event()
        """Set once the first frame is drawn, or has failed: browsers wait for it."""

    def start(self) -> None:
        """Begin with a frame of the state as it is."""
        self._session.wakeup.set()
        self._thread.start()

    def end(self) -> None:
        """Ask the thread to end after its current step."""
        self._stopping.set()
        self._session.wakeup.set()

    def stop(self) -> None:
        """End the thread; returns when it has ended, or after 2 s."""
        self.end()
        self._thread.join(timeout=2.0)

    def _run(self) -> None:
        while not self._stopping.is_set():
            now = time.monotonic()
            moving = self._session.wakeup.is_set() or now >= self._tick()
            if parts := self._schedule.take_due(now, moving=moving):
                self._guarded(partial(self._show_parts, parts))
            elif self._wait_for_frame(now):
                time.sleep(max(0.0, min(MIN_INTERVAL, self._begun + MIN_INTERVAL - time.monotonic())))
                self._session.wakeup.clear()
                self._begun = time.monotonic()
                self._guarded(self._turn)
                self.first_frame.set()

    def _tick(self) -> float:
        """When a live board is polled again without a request, seldom while silent; inf for a finished record."""
        silent = self._begun - self._news_at > SETTLING
        interval = STATUS_INTERVAL if silent else LIVE_INTERVAL
        return math.inf if self._session.board is None else self._begun + interval

    def _wait_for_frame(self, now: float) -> bool:
        """Wait until a new frame is due, or a part of the last one; True for a new frame."""
        until = min(self._tick(), self._schedule.next_due())
        requested = self._session.wakeup.wait(timeout=None if math.isinf(until) else max(0.0, until - now))
        return requested or time.monotonic() >= self._tick()

    def _show_parts(self, parts: Collection[Part]) -> None:
        """Draw parts of the last frame."""
        if self._frame is not None:
            self._show(self._frame, parts)

    def _guarded(self, step: Callable[[], None]) -> None:
        if self._stopping.is_set():
            return
        try:
            step()
        except Exception as error:  # the thread must outlive any single frame
            self._fail(error)

    def _turn(self) -> None:
        state, serial, failures = self._session.apply_requests()
        for failed, error in failures:
            self._tell(str(error) if isinstance(error, KalscopeError) else error, failed=failed)
        if not self._is_news(state, serial):
            return
        asked = self._frame is None or serial != self._frame.serial
        try:
            self._show_frame(state, serial)
        finally:  # also where the frame has failed: what is on screen of the one before is taken away then
            due = state.live is None or asked or self._frame_at - self._study_at > STUDY_INTERVAL
            if self._studies is not None and due:
                self._study_at = self._frame_at
                self._studies.of(studied(state))

    def _is_news(self, state: State, serial: int) -> bool:
        """Whether its frame would differ from the last one; a wake-up for a live record may bring nothing new."""
        last, now = self._frame, time.monotonic()
        if last is None or state is not last.state or serial != last.serial or state.live is None:
            self._news_at = now
            return True
        if now - self._frame_at < STATUS_INTERVAL:
            return False
        return now - self._news_at < SETTLING or self._session.connection() != last.connection

    def _show_frame(self, state: State, serial: int) -> None:
        frame = compute_frame(state, serial, self._runs, self._session.connection())
        last, self._frame, self._frame_at = self._frame, frame, time.monotonic()
        whole = last is None or not is_move(last.state, state)
        self._show_parts(self._schedule.begin(self._frame_at, whole=whole))
