"""The log, and uncaught exceptions: each becomes a log entry and one sentence for the user."""

from __future__ import annotations

import asyncio
import errno
import logging
import logging.handlers
import os
import re
import sys
import threading
from collections.abc import Callable, Generator
from concurrent.futures import Executor
from contextlib import contextmanager
from io import TextIOWrapper
from pathlib import Path
from typing import Any

from websockets.exceptions import ConnectionClosed

from kalscope.common.text import CONTROL
from kalscope.errors import BadSetting

# Uncaught exceptions: each becomes a log entry and one sentence for the user; the program keeps running.


_log = logging.getLogger(__name__)

_DISCONNECTED = (ConnectionClosed, ConnectionError, asyncio.CancelledError)
"""Raised when a browser disconnects in the middle of something; not a bug."""


class ErrorReporter:
    """Log uncaught exceptions and notify the user; the program keeps running. Any thread may call it."""

    def __init__(self) -> None:
        self.notify: Callable[[Exception], object] | None = None
        """How the user is told; None: not yet."""
        self.is_ending = False
        """True during shutdown: errors are logged, not shown."""

    def report(self, where: str, error: BaseException | None) -> None:
        """Log the error, and notify the user."""
        if error is None or isinstance(error, SystemExit):
            return
        if self.is_ending or isinstance(error, _DISCONNECTED):
            _log.info("%s: %r", where, error)
            return
        _log.error("%s: %s: %s", where, type(error).__name__, error, exc_info=error)
        if self.notify is not None and isinstance(error, Exception):
            try:
                self.notify(error)
            except Exception:  # the notification itself may fail
                _log.exception("The user could not be notified")

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

        threading.excepthook = on_thread
        sys.unraisablehook = lambda args: self.report(args.err_msg or "clean-up", args.exc_value)
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


# The log: warnings on the terminal, everything in a file if requested. Never the token.


FILE_BYTES = 2**20
"""Size at which a new log file is begun."""
OLD_FILES = 2
"""Full files kept beside the current one, as FILE.1 and FILE.2."""

_ENTRY = re.compile(rb"[0-9]{4}-[0-9]{2}-[0-9]{2} [0-9:,]{12} [A-Z]+ [^ ]+: |\Z")
"""What a log begins with; an empty file is as good."""
_SECRET = re.compile(r"(token=|kalscope_\d+=)[A-Za-z0-9_-]+")


class Lines(logging.Formatter):
    """One entry per line; text from outside can neither begin an entry of its own nor move the cursor."""

    def __init__(self, pattern: str, hidden: list[str], *, with_traceback: bool) -> None:
        super().__init__(pattern)
        self._hidden, self._with_traceback = hidden, with_traceback

    def format(self, record: logging.LogRecord) -> str:
        """The entry, with further lines indented."""
        without = {} if self._with_traceback else {"exc_info": None, "exc_text": None, "stack_info": None}
        text = _SECRET.sub(r"\1…", super().format(logging.makeLogRecord(record.__dict__ | without)))
        for secret in self._hidden:
            text = text.replace(secret, "…")
        return "\n    ".join(CONTROL.sub("·", line) for line in text.split("\n"))


class _File(logging.handlers.RotatingFileHandler):
    def _open(self) -> TextIOWrapper:
        """For this user only: other users of the machine must not learn the names of files."""
        handle = os.open(self.baseFilename, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
        return open(handle, "a", encoding="utf-8", errors="backslashreplace")


@contextmanager
def logging_to(file: Path | None = None, *, verbose: bool = False) -> Generator[list[str]]:
    """Log on standard error, and into `file`, while the block runs.

    Args:
        file: gets everything, with tracebacks; at most `(1 + OLD_FILES) * FILE_BYTES`; None for no file.
        verbose: the terminal shows what happens (who connects, what is refused), not only what went wrong.

    Yields:
        Texts that are replaced by an ellipsis wherever they occur; add the token.

    Raises:
        OSError: the file cannot be written.
        BadSetting: the file, or an old one beside it, exists and is not such a log.
    """
    known = () if file is None else (file, *(Path(f"{file}.{number}") for number in range(1, OLD_FILES + 1)))
    for path in filter(Path.is_file, known):  # it would be appended to, and removed once there are newer ones
        with path.open("rb") as old:
            if not _ENTRY.match(old.read(200)):
                raise BadSetting(f"--log must name a new file or a log of Kalscope (got {str(path)!r})")
    hidden: list[str] = []
    on_terminal = logging.StreamHandler(sys.stderr)
    on_terminal.setFormatter(Lines("kalscope: %(message)s", hidden, with_traceback=verbose))
    on_terminal.setLevel(logging.INFO if verbose else logging.WARNING)
    if not verbose:  # libraries report each broken request of a port scan as an error, with its traceback
        on_terminal.addFilter(lambda record: record.name.startswith("kalscope"))
    handlers: list[logging.Handler] = [on_terminal]
    if file is not None:
        in_file = _File(file, maxBytes=FILE_BYTES, backupCount=OLD_FILES)
        pattern = "%(asctime)s %(levelname)s %(name)s: %(message)s"
        in_file.setFormatter(Lines(pattern, hidden, with_traceback=True))
        handlers.append(in_file)
    root, level = logging.getLogger(), logging.getLogger().level
    for handler in handlers:
        root.addHandler(handler)
    root.setLevel(logging.INFO if file is not None or verbose else logging.WARNING)
    logging.captureWarnings(True)
    logging.raiseExceptions = False  # a full disk or a closed terminal must not become an error of its own
    try:
        yield hidden
    finally:
        logging.captureWarnings(False)
        root.setLevel(level)
        for handler in handlers:
            root.removeHandler(handler)
            handler.close()
