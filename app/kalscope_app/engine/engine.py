"""One worker thread: it applies the requests, computes one Frame for all of them, and passes it to the views.

The latest request wins because requests are cheap and a Frame is computed only after all waiting ones. While a
control moves, a part of each Frame is shown at once and the rest when there is time (`parts.py`). What is slower is
left to the studies, which have their own thread.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Collection
from functools import partial

from kalscope.errors import KalscopeError
from kalscope_app.engine.cache import Cache
from kalscope_app.engine.decimation import MAX_POINTS, DrawnSamples, choose_samples
from kalscope_app.engine.filter_runs import FilterRuns, VariantCurves
from kalscope_app.engine.frame import Frame, compute_frame
from kalscope_app.engine.idle_studies import Studies
from kalscope_app.engine.parts import Part, Schedule, is_move
from kalscope_app.engine.record_facts import RecordFacts
from kalscope_app.session.changes.live import live_window, studied
from kalscope_app.session.session import Session
from kalscope_app.session.state import State

MIN_INTERVAL = 0.04
"""Seconds between two frames, at least: in a slower browser frames would pile up."""

LIVE_INTERVAL = 0.045
"""Seconds between two frames of a live record: 22 a second."""

SILENT_INTERVAL = 0.2
"""Seconds between two polls of a board that sends nothing: each poll costs time, and nothing is waiting."""

MAX_LIVE_POINTS = 2000
"""Points that a line is drawn with while a board sends, at most: every frame draws all of them again."""

STATUS_INTERVAL = 0.5
"""Seconds after which a live record without new samples is drawn if its status has changed."""

STUDY_INTERVAL = 3.0
"""Seconds between two rounds of idle-time computations for a live record that is not being tuned."""

SETTLING = STUDY_INTERVAL + 1.0
"""Seconds after its newest sample during which it is drawn that often anyway: the last samples are studied, too,
and the range control moves once a second."""


def pause_before_frame(now: float, last: float) -> float:
    """Seconds to wait before the next frame may be sent."""
    return max(0.0, min(MIN_INTERVAL, last + MIN_INTERVAL - now))


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
        self._samples = Cache[DrawnSamples]()
        self._runs, self._facts, self._curves = FilterRuns(), RecordFacts(), VariantCurves()
        self._frame: Frame | None = None
        self._schedule = Schedule()
        self._begun = self._frame_at = self._news_at = self._looked_at = self._study_at = -math.inf
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
                time.sleep(pause_before_frame(time.monotonic(), self._begun))
                self._session.wakeup.clear()
                self._begun = time.monotonic()
                self._guarded(self._turn)
                self.first_frame.set()

    def _tick(self) -> float:
        """When a live board is polled again without a request; inf for a finished record."""
        if not self._session.is_live:
            return math.inf
        silent = time.monotonic() - self._news_at > SETTLING
        return self._begun + (SILENT_INTERVAL if silent else LIVE_INTERVAL)

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
        if self._is_news(state, serial):
            self._draw(state, serial)

    def _is_news(self, state: State, serial: int) -> bool:
        """Whether its frame would differ from the last one; a wake-up for a live record may bring nothing new."""
        last, now = self._frame, time.monotonic()
        if last is None or state is not last.state or serial != last.serial or state.live is None:
            self._news_at = self._looked_at = now
            return True
        if now - self._looked_at < STATUS_INTERVAL:
            return False
        self._looked_at = now
        return now - self._news_at < SETTLING or self._session.connection() != last.connection

    def _draw(self, state: State, serial: int) -> None:
        asked = self._frame is None or serial != self._frame.serial
        try:
            self._show_frame(state, serial)
        finally:  # also where the frame has failed: what is on screen of the one before is taken away then
            due = state.live is None or asked or self._frame_at - self._study_at > STUDY_INTERVAL
            if self._studies is not None and due:
                self._study_at = self._frame_at
                self._studies.of(studied(state))

    def _show_frame(self, state: State, serial: int) -> None:
        limit = MAX_POINTS if state.live is None else MAX_LIVE_POINTS
        (channel, *others), window = state.measured, live_window(state)
        drawn = self._samples.once(
            lambda: choose_samples(
                state.recording, channel, window, limit, self._facts.of(state), others=tuple(others)
            ),
            *(state.recording, state.measured, window, limit),
        )
        variants = self._curves.of(state, drawn) if state.live is None else None
        frame = compute_frame(state, serial, drawn, self._runs, variants, self._session.connection())
        last, self._frame, self._frame_at = self._frame, frame, time.monotonic()
        whole = last is None or not is_move(last.state, state)
        self._show_parts(self._schedule.begin(self._frame_at, whole=whole))
