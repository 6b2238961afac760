"""Mistakes of ours that nobody caught: each becomes a log entry and one sentence for the person; all goes on."""

from __future__ import annotations

import asyncio
import functools
import logging
import sys
import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from viser import _scene_api, _viser
from websockets.exceptions import ConnectionClosed

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from concurrent.futures import Executor
    from pathlib import Path

_log = logging.getLogger(__name__)

PAUSE = 10.0
"""Seconds for which the same sentence is not said again."""

_PARTING = (ConnectionClosed, ConnectionError, asyncio.CancelledError)
"""What happens when a browser goes away in the middle of something: nobody's mistake."""


class Trouble:
    """Reports whatever was raised where nobody catches it. Any thread may call it."""

    def __init__(self) -> None:
        self._tell: Callable[[Exception], object] | None = None
        self._said: dict[str, float] = {}
        self.is_ending = False
        """From now on what breaks is the end of the program, and nobody's trouble."""
        self._lock = threading.Lock()

    def tell_with(self, tell: Callable[[Exception], object]) -> None:
        """From now on a person can be told."""
        self._tell = tell

    def report(self, where: str, error: BaseException | None) -> None:
        """Log it, and tell the person unless just told."""
        if error is None or isinstance(error, SystemExit):
            return
        if self.is_ending or isinstance(error, _PARTING):
            _log.info("%s: %r", where, error)
            return
        _log.error("%s: %s: %s", where, type(error).__name__, error, exc_info=error)
        if self._tell is not None and isinstance(error, Exception) and self._is_news(sentence_for(error, None)):
            try:
                self._tell(error)
            except Exception:  # to tell may be what does not work
                _log.exception("The person could not be told")

    def _is_news(self, sentence: str) -> bool:
        now = time.monotonic()
        with self._lock:
            self._said = {text: when for text, when in self._said.items() if now - when < PAUSE}
            is_news = sentence not in self._said
            self._said[sentence] = now
        return is_news

    def watch_server(self, loop: asyncio.AbstractEventLoop, callbacks: Executor) -> None:
        """Hear of what is raised in tasks of the event loop and in callbacks, which viser prints and forgets."""

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
    def watch_threads(self) -> Iterator[None]:
        """While the block runs, hear of what ends a thread, and of what is raised where it cannot be passed on.

        Also of what a callback of the scene or of a connection raises on the event loop: viser would print it.
        """
        before = threading.excepthook, sys.unraisablehook
        printing = [(module, module.print_awaited_callback_error) for module in (_scene_api, _viser)]

        def on_thread(args: threading.ExceptHookArgs) -> None:
            self.report(f"thread {args.thread.name if args.thread else '?'}", args.exc_value)

        def on_unraisable(args: Any) -> None:
            self.report(args.err_msg or "clean-up", args.exc_value)

        threading.excepthook, sys.unraisablehook = on_thread, on_unraisable
        for module, _ in printing:
            setattr(module, "print_awaited_callback_error", functools.partial(self.report, "callback"))  # noqa: B010
        try:
            yield
        finally:
            threading.excepthook, sys.unraisablehook = before
            for module, stock in printing:
                setattr(module, "print_awaited_callback_error", stock)  # noqa: B010


def sentence_for(error: BaseException, log_file: Path | None) -> str:
    """What the person is told: what happened, that all goes on, and what to do."""
    if isinstance(error, MemoryError):
        return "That needs more memory than this computer has. Nothing was changed; a shorter file may fit."
    what = " ".join(f"{type(error).__name__}: {error}".split())[:200]
    details = f"Details are in {log_file}." if log_file else "Started with --log FILE, Kalscope keeps the details."
    return (
        f"This is a mistake of Kalscope's own ({what}). The dashboard goes on: try again, undo the last step, "
        f"or reload the page. {details}"
    )
