"""What all commands share: exit statuses, messages, standard streams, progress, and stopping."""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO, TextIO

import typer

from kalscope.common.progress import OnProgress
from kalscope.common.text import one_line, plain
from kalscope.errors import KalscopeError, describe

CHECK_FAILED = 1
"""Exit status when something that was checked is not as it must be."""
USER_ERROR = 2
"""Exit status when something the user gave cannot be used; stderr then has one line."""
INTERRUPTED = 130
"""Exit status after Ctrl-C, as a shell counts it."""

PROGRESS_DELAY_S = 1.0
"""Work that takes longer than this shows its progress, s."""
PROGRESS_INTERVAL_S = 0.1
"""Least time between two updates of the progress, s."""
MAX_STOP_S = 1.5
"""Longest time from Ctrl+C to the end of a command, s."""
STOP_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")


def say(message: str) -> None:
    """Print one line on stderr."""
    print(f"kalscope: {one_line(message)}", file=sys.stderr, flush=True)


def user_message(error: Exception) -> str | None:
    """The message for the user; None for an exception that is a bug of the program."""
    if isinstance(error, KalscopeError | OSError):
        return describe(error)
    # Typer's usage errors; it brought its own copy of click's classes in 0.2x, the method is common to both.
    usage = getattr(error, "format_message", None)
    return str(usage()) if callable(usage) else None


def write_output(chunks: Iterator[str], output: Path | None) -> None:
    """Write text to a file, whole or not at all, or to stdout, without control characters of names from outside."""
    from kalscope.common.files import atomic_file

    with open_stdout() if output is None else atomic_file(output) as file:
        for chunk in chunks if output is not None else map(plain, chunks):
            file.write(chunk.encode("utf-8", "replace"))


@contextmanager
def open_stdout() -> Generator[BinaryIO]:
    """Standard output as bytes (Windows would add carriage returns), quiet when its reader goes away."""
    try:
        yield sys.stdout.buffer
        sys.stdout.buffer.flush()
    except OSError as error:
        # What is left in the buffer would raise once more when Python ends, where it cannot be caught.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):  # `kalscope filter … | head` has all it needs
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


def tell_compiling() -> None:
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


def end_when_interrupted() -> None:
    """End the program MAX_STOP_S after Ctrl+C, even within a loop that Python cannot interrupt.

    A command that handles Ctrl+C itself (`stop_signals`) ends in its own time. What a command writes is whole or
    not there, whenever it ends (`atomic_file`).
    """
    heard, woken = socket.socketpair()
    woken.setblocking(False)
    signal.set_wakeup_fd(woken.fileno(), warn_on_full_buffer=False)

    def watch(_kept_open: socket.socket) -> None:
        while heard.recv(1) != bytes([signal.SIGINT]):  # written by the system before Python can handle the signal
            pass
        time.sleep(MAX_STOP_S)
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            os._exit(INTERRUPTED)

    threading.Thread(target=watch, args=(woken,), daemon=True).start()


@contextmanager
def stop_signals() -> Generator[threading.Event]:
    """An event that Ctrl+C, SIGTERM or the closing of the terminal sets while the block runs."""
    stop = threading.Event()

    def handle(*_: object) -> None:
        stop.set()

    previous: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():  # Python delivers signals to no other thread
        for name in STOP_SIGNALS:
            number = getattr(signal, name, None)  # SIGHUP is unknown on Windows, SIGBREAK elsewhere
            if number is not None and signal.getsignal(number) is not signal.SIG_IGN:  # nohup ignores SIGHUP
                previous[number] = signal.signal(number, handle)
    try:
        yield stop
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
