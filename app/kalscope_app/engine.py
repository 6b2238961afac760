"""One worker thread: it takes the requests, computes one Frame for all of them, and hands it to the views.

The latest request wins because requests are cheap and a Frame is computed only after all that wait are in. What is
slower, the checks, is computed on a second thread once nothing has been asked for a while.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from kalscope.errors import KalscopeError
from kalscope_app.checks import Checks, compute_checks
from kalscope_app.frame import Frame, Shown, choose_shown, compute_frame
from kalscope_app.session import Session
from kalscope_app.state import State

LEAST_INTERVAL = 0.04
"""Seconds between two frames at least: a browser that is slower builds a backlog that nothing drops."""

REST = 0.2
"""Seconds without a request after which the checks are computed."""

log = logging.getLogger(__name__)


def pause_before_frame(now: float, last: float) -> float:
    """Seconds to wait before the next frame may be sent."""
    return max(0.0, min(LEAST_INTERVAL, last + LEAST_INTERVAL - now))


class Checker:
    """Computes the checks of the latest state once it has rested, so that no frame waits for them."""

    def __init__(self, show: Callable[[Checks | None], None], tell: Callable[[str], None]) -> None:
        """Args: who draws the checks; who tells of a failure."""
        self._show = show
        self._tell = tell
        self._state: State | None = None
        self._news = threading.Event()
        threading.Thread(target=self._run, name="kalscope-checks", daemon=True).start()

    def judge(self, state: State) -> None:
        """This state is on screen now."""
        self._state = state
        self._news.set()

    def _run(self) -> None:
        while True:
            self._news.wait()
            self._news.clear()
            if self._news.wait(timeout=REST):
                continue
            state = self._state
            try:
                checks = compute_checks(state) if state is not None else None
                if state is self._state:
                    self._show(checks)
            except Exception as error:  # the thread must outlive any single state
                log.exception("The checks failed")
                self._tell(f"The fit could not be judged: {error}")


class Engine:
    """Session -> Frame, on a thread of its own."""

    def __init__(
        self,
        session: Session,
        show: Callable[[Frame], None],
        tell: Callable[[str], None],
        show_checks: Callable[[Checks | None], None] | None = None,
    ) -> None:
        """Args: the session; who draws a frame; who tells of a refused request; who draws the checks."""
        self._session = session
        self._show = show
        self._tell = tell
        self._checker = None if show_checks is None else Checker(show_checks, tell)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="kalscope-engine", daemon=True)
        self._shown_for: tuple[object, ...] = ()
        self._shown: Shown | None = None
        self.first_frame = threading.Event()

    def start(self) -> None:
        """Begin with a frame of the state as it is."""
        self._session.bell.set()
        self._thread.start()

    def stop(self) -> None:
        """End the thread; returns when it has ended, or after 2 s."""
        self._stopping.set()
        self._session.bell.set()
        self._thread.join(timeout=2.0)

    def _run(self) -> None:
        last = 0.0
        while not self._stopping.is_set():
            self._session.bell.wait(timeout=self._session.seconds_to_next())
            time.sleep(pause_before_frame(time.monotonic(), last))
            self._session.bell.clear()
            if self._stopping.is_set():
                return
            last = time.monotonic()
            self._guarded(self._turn)

    def _guarded(self, step: Callable[[], None]) -> None:
        try:
            step()
        except Exception as error:  # the thread must outlive any single frame
            log.exception("A frame could not be made")
            self._tell(f"That could not be shown: {error}")

    def _turn(self) -> None:
        state, serial, failures = self._session.settle()
        for failure in failures:
            if not isinstance(failure, KalscopeError):
                log.error("A request failed", exc_info=failure)
            self._tell(str(failure))
        frame = compute_frame(state, serial, self._choose(state))
        self._show(frame)
        self.first_frame.set()
        if self._checker is not None:
            self._checker.judge(frame.state)

    def _choose(self, state: State) -> Shown:
        """The samples to draw: chosen anew only for another recording, channel or window."""
        asked = (state.recording, state.channel, state.window)
        same = len(self._shown_for) == 3 and all(
            a is b if i == 0 else a == b for i, (a, b) in enumerate(zip(asked, self._shown_for, strict=True))
        )
        if self._shown is None or not same:
            self._shown = choose_shown(*asked)
            self._shown_for = asked
        return self._shown
