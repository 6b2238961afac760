"""Work that takes longer than a gesture (reading a file, a long fit), one at a time, beside the engine."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable

from kalscope.errors import Cancelled, KalscopeError, describe
from kalscope_app.session.session import Failed, Session
from kalscope_app.session.state import State

log = logging.getLogger(__name__)

MAX_WAITING = 8
"""Jobs that may wait, at most: each may hold a whole uploaded file."""


def _nothing() -> None: ...


class Jobs:
    """One worker thread for slow work; a failure becomes one sentence for the user."""

    def __init__(self, tell: Callable[..., None]) -> None:
        """Args: shows a sentence, or logs and shows an exception; `good`: not an error; `failed`: its heading."""
        self._tell = tell
        self._waiting: queue.SimpleQueue[tuple[Callable[[], None], Failed]] = queue.SimpleQueue()
        self._idle: Callable[[], None] = _nothing
        self._every: float | None = None
        # A daemon, unlike the threads of a pool: a job that hangs does not keep the program from ending.
        threading.Thread(target=self._run, name="kalscope-jobs", daemon=True).start()

    def run(self, work: Callable[[], None], failed: Failed = Failed.OTHER) -> None:
        """Queue `work`, unless too much waits already; `failed` is the heading if it is refused."""
        if self._waiting.qsize() < MAX_WAITING:
            self._waiting.put((work, failed))
        else:
            self._tell("Too many tasks are waiting. Try again when the running one has finished.", failed=failed)

    def run_with_state(
        self, session: Session, work: Callable[[State], None], failed: Failed = Failed.OTHER
    ) -> None:
        """Queue `work` on the state, once every earlier request is in it."""
        session.with_state(lambda state: self.run(lambda: work(state), failed))

    def when_idle(self, work: Callable[[], None], every: float) -> None:
        """Repeat `work` whenever no job has arrived for `every` seconds, until it fails."""
        self._idle, self._every = work, every
        self._waiting.put((_nothing, Failed.OTHER))  # ends the wait without a timeout

    def _run(self) -> None:
        while True:
            try:
                work, failed = self._waiting.get(timeout=self._every)
            except queue.Empty:
                work, failed = self._idle, Failed.OTHER
            try:
                work()
            except Exception as error:  # the dashboard continues
                if work is self._idle:
                    self._every = None
                    log.exception("Idle work failed and is not tried again")
                elif isinstance(error, Cancelled):
                    self._tell(f"{error}.", good=True)
                elif isinstance(error, KalscopeError | OSError):
                    self._tell(describe(error), failed=failed)
                else:
                    self._tell(error)
