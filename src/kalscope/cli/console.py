"""What all commands share: exit statuses, messages, standard streams and progress."""

from __future__ import annotations

import errno
import os
import re
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, TextIO

import typer

from kalscope.common.progress import OnProgress
from kalscope.common.text import one_line, plain
from kalscope.errors import KalscopeError, describe

CHECK_FAILED = 1
"""Exit status when something that was checked is not as it must be."""
USER_ERROR = 2
"""Exit status when something the user gave cannot be used; stderr then has one line."""

PROGRESS_DELAY_S = 1.0
"""Work that takes longer than this shows its progress, s."""
PROGRESS_INTERVAL_S = 0.1
"""Least time between two updates of the progress, s."""
_NO_MEMORY = re.compile("failed to map segment|annot allocate memory|can't start new thread")
"""How Python, and a library that cannot be loaded, report that memory has run out."""


def say(message: str) -> None:
    """Print one line on stderr, if it is still open."""
    with suppress(OSError):
        print(f"kalscope: {one_line(message)}", file=sys.stderr, flush=True)


def utf8_streams() -> None:
    """Have everything that is printed into a file or a pipe in UTF-8: Windows would fail at the first −."""
    for stream in sys.stdout, sys.stderr:
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(encoding=None if stream.isatty() else "utf-8", errors="backslashreplace")


def plain_diagnostics() -> None:
    """Have tracebacks and warnings written without the control characters of what they quote."""
    write = warnings.formatwarning

    def show(kind: type[BaseException], error: BaseException | None, trace: TracebackType | None) -> None:
        sys.stderr.write(plain("".join(traceback.format_exception(kind, error, trace))))

    def warn(*about: Any) -> str:
        return plain(write(*about))

    sys.excepthook = show
    threading.excepthook = lambda fault: show(fault.exc_type, fault.exc_value, fault.exc_traceback)
    warnings.formatwarning = warn


def user_message(error: Exception) -> str | None:
    """The message for the user; None for an exception that is a bug of the program."""
    if isinstance(error, FileNotFoundError) and error.filename is None and not _has_working_folder():
        return "the folder in which kalscope was started must exist (it was removed or renamed)"
    if isinstance(error, MemoryError) or (not isinstance(error, OSError) and _NO_MEMORY.search(str(error))):
        return "the system must have free memory for this, and ulimit -v must allow it (got none)"
    if isinstance(error, KalscopeError | OSError):
        return describe(error)
    # Typer's usage errors; it brought its own copy of click's classes in 0.2x, the method is common to both.
    usage = getattr(error, "format_message", None)
    return str(usage()) if callable(usage) else None


def _has_working_folder() -> bool:
    try:
        return bool(os.getcwd())
    except FileNotFoundError:
        return False


def write_output(chunks: Iterator[str], output: Path | None) -> None:
    """Write text to a file, whole or not at all, or to stdout, without control characters of names from outside."""
    from kalscope.common.files import atomic_file

    with open_stdout() if output is None else atomic_file(output) as file:
        for chunk in chunks if output is not None else map(plain, chunks):
            file.write(chunk.encode("utf-8", "replace"))


@contextmanager
def open_stdout() -> Generator[BinaryIO]:
    """Standard output as bytes (Windows would add carriage returns), as `writes_stdout`."""
    with writes_stdout():
        sys.stdout.flush()  # what is printed before comes first
        yield sys.stdout.buffer


@contextmanager
def writes_stdout() -> Generator[None]:
    """Write what the block printed when it ends.

    If the reader closes the pipe, the command ends with status 0: `kalscope filter … | head` has all it needs.
    """
    try:
        yield
        sys.stdout.flush()
    except OSError as error:
        # What is left in the buffer would raise once more when Python ends, where it cannot be caught.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError) or (
            os.name == "nt" and error.errno == errno.EINVAL
        ):  # as Windows has it
            raise typer.Exit(0) from None
        raise


class TerminalLine:
    """A line that is rewritten in place on a terminal; nothing is written to anything else."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.visible = stream.isatty()
        """Whether the stream is a terminal."""
        self._width = 0

    def show(self, text: str) -> None:
        """Replace what the line shows."""
        if self.visible:
            text = plain(text)
            self._write(f"\r{text:<{self._width}}")
            self._width = max(self._width, len(text))

    def clear(self) -> None:
        """Leave an empty line behind."""
        if self._width:
            self._write(f"\r{' ' * self._width}\r")
            self._width = 0

    def _write(self, text: str) -> None:
        with suppress(OSError):  # a terminal that was closed must not end the work
            self._stream.write(text)
            self._stream.flush()


@contextmanager
def progress_line() -> Generator[OnProgress]:
    """Report progress inside the block, as a fraction and a few words: one line on stderr if it is a terminal.

    The line appears once the work has taken PROGRESS_DELAY_S, and is gone when the block ends.
    """
    line = TerminalLine(sys.stderr)
    due = time.monotonic() + PROGRESS_DELAY_S

    def report(fraction: float, text: str) -> None:
        nonlocal due
        now = time.monotonic()
        if now >= due:
            due = now + PROGRESS_INTERVAL_S
            line.show(f"{fraction:4.0%} {text}"[:70])

    try:
        yield report
    finally:
        line.clear()


def report_compiling() -> None:
    """Say on a terminal, from now on, when loops are compiled: the first start after an installation takes long."""
    from kalscope.common.compiled import Compiling, watch_compiling

    line = TerminalLine(sys.stderr)

    def show(progress: Compiling) -> None:
        if progress.is_busy:
            line.show(str(progress))
        else:
            line.clear()

    if line.visible:
        watch_compiling(show)
