"""Uncaught exceptions: each becomes a log entry and one sentence for the user; the program keeps running."""

from __future__ import annotations

import asyncio
import errno
import logging
import sys
import threading
import time
from collections.abc import Callable, Generator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.exceptions import ConnectionClosed

_log = logging.getLogger(__name__)

REPEAT_S = 10.0
"""Seconds for which the same notification is not shown again."""

_DISCONNECTED = (ConnectionClosed, ConnectionError, asyncio.CancelledError)
"""Raised when a browser disconnects in the middle of something; not a bug."""


class ErrorReporter:
    """Log uncaught exceptions and notify the user; the program keeps running. Any thread may call it."""

    def __init__(self) -> None:
        self._notify: Callable[[Exception], object] | None = None
        self._shown: dict[str, float] = {}
        self.is_ending = False
        """True during shutdown: errors are logged, not shown."""
        self._lock = threading.Lock()

    def notify_with(self, notify: Callable[[Exception], object]) -> None:
        """Notify the user in this way from now on."""
        self._notify = notify

    def report(self, where: str, error: BaseException | None) -> None:
        """Log the error, and notify the user unless the same notification was just shown."""
        if error is None or isinstance(error, SystemExit):
            return
        if self.is_ending or isinstance(error, _DISCONNECTED):
            _log.info("%s: %r", where, error)
            return
        _log.error("%s: %s: %s", where, type(error).__name__, error, exc_info=error)
        if self._notify is not None and isinstance(error, Exception) and self._is_new(sentence_for(error, None)):
            try:
                self._notify(error)
            except Exception:  # the notification itself may fail
                _log.exception("The user could not be notified")

    def _is_new(self, sentence: str) -> bool:
        now = time.monotonic()
        with self._lock:
            self._shown = {text: when for text, when in self._shown.items() if now - when < REPEAT_S}
            is_new = sentence not in self._shown
            self._shown[sentence] = now
        return is_new

    def watch_server(self, loop: asyncio.AbstractEventLoop, callbacks: Executor) -> None:
        """Report what is raised in tasks of the event loop and in callbacks, which viser would only print."""

        def on_loop(_loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
            self.report(f"event loop: {context.get('message', '')}", context.get("exception"))

        stock = callbacks.submit

        def submit(work: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Any:
            def watched() -> Any:
                try:
                    return work(*args, **kwargs)
                except Exception as error:
                    self.report("callback", error)
                    return None

            return stock(watched)

        loop.call_soon_threadsafe(loop.set_exception_handler, on_loop)
        callbacks.submit = submit  # the pool is viser's, and shared by all its parts

    @contextmanager
    def watch_threads(self) -> Generator[None]:
        """While the block runs, report what ends a thread, and what is raised where it cannot be passed on."""
        before = threading.excepthook, sys.unraisablehook

        def on_thread(args: threading.ExceptHookArgs) -> None:
            self.report(f"thread {args.thread.name if args.thread else '?'}", args.exc_value)

        def on_unraisable(args: Any) -> None:
            self.report(args.err_msg or "clean-up", args.exc_value)

        threading.excepthook, sys.unraisablehook = on_thread, on_unraisable
        try:
            yield
        finally:
            threading.excepthook, sys.unraisablehook = before


def sentence_for(error: BaseException, log_file: Path | None) -> str:
    """The notification for an error: what happened, that the dashboard keeps running, and what to do."""
    if isinstance(error, MemoryError):
        return "This needs more memory than the computer has. Nothing was changed. Try a shorter file."
    if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
        return (
            "Too many files and connections are open: the system allows no more. The dashboard keeps running: "
            "close other programs or pages, or start Kalscope with a higher limit (ulimit -n)."
        )
    what = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    details = f"Details are in {log_file}." if log_file else "Start Kalscope with --log FILE to keep the details."
    return (
        f"This is a bug in Kalscope ({what}). The dashboard keeps running: try again, undo the last step, "
        f"or reload the page. {details}"
    )
