"""Work that takes longer than a gesture (reading a file, a long fit), one at a time, beside the engine."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable

from kalscope.errors import Cancelled, KalscopeError, describe
from kalscope_app.session.session import Session
from kalscope_app.session.state import State

log = logging.getLogger(__name__)

MAX_WAITING = 8
"""Jobs that may wait, at most: each may hold a whole uploaded file."""


class Jobs:
    """One worker thread for slow work; a failure becomes one sentence for the user."""

    def __init__(self, tell: Callable[..., None]) -> None:
        """Args: who shows a sentence, or an exception that is our mistake; `good=True` marks no refusal."""
        self._tell = tell
        self._waiting: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        # A daemon, unlike the threads of a pool: a job that hangs does not keep the program from ending.
        threading.Thread(target=self._run, name="kalscope-jobs", daemon=True).start()

    def run(self, work: Callable[[], None]) -> None:
        """Queue `work`, unless too much waits already."""
        if self._waiting.qsize() < MAX_WAITING:
            self._waiting.put(work)
        else:
            self._tell("Too much is waiting already. Try again when what runs has ended.")

    def run_with_state(self, session: Session, work: Callable[[State], None]) -> None:
        """Queue `work` on the state, once every earlier request is in it."""
        session.with_state(lambda state: self.run(lambda: work(state)))

    def _run(self) -> None:
        while True:
            work = self._waiting.get()
            try:
                work()
            except Cancelled as error:
                self._tell(f"{error}.", good=True)
            except (KalscopeError, OSError) as error:
                self._tell(describe(error))
            except Exception as error:  # the dashboard goes on
                log.exception("A job failed")
                self._tell(error)
