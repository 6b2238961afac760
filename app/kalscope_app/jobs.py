"""Work that takes longer than a gesture (reading a file, writing one), one at a time, beside the engine."""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from kalscope.errors import KalscopeError

log = logging.getLogger(__name__)


class Jobs:
    """One worker thread for slow work; whatever fails becomes one sentence for the person."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="kalscope-job")

    def run(self, work: Callable[[], None]) -> None:
        """Queue `work`."""
        self._pool.submit(self._guarded, work)

    def stop(self) -> None:
        """Drop what waits; what runs is left to end with the program."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _guarded(self, work: Callable[[], None]) -> None:
        try:
            work()
        except (KalscopeError, OSError) as error:
            self._tell(str(error))
        except Exception as error:  # the dashboard goes on
            log.exception("A job failed")
            self._tell(f"That did not work: {error}")
