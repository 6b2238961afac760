"""Ctrl+C, SIGTERM and closing the terminal end the program, whatever it is doing.

The first signal counts, and further ones change nothing. It raises SystemExit at the current line, which removes
unfinished files on its way out; a command that has something to finish gets an event instead (`stop_signals`).
A program that has not ended some time later, because it computes or waits where Python cannot interrupt it, is
terminated after the actions of `done_at_stop` and `removed_at_stop`. Only the standard library is imported: a
program calls this before it imports anything that takes long.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from typing import Any

MAX_STOP_S = 1.5
"""Longest time from a signal to the end of the program, s."""
MAX_FINISH_S = 5.0
"""Longest time for a command that has something to finish, s; it takes two seconds unless the machine is busy."""
STOP_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
_LAST_S = 0.2
"""Longest time to write the last line, which may no longer have a reader, and to clean up, each, s."""
_NOTHING_KEPT = "no file is left half-written"


INTERRUPTED = 128 + signal.SIGINT
"""Exit status after Ctrl+C, as a shell counts it; after another signal its number replaces that of SIGINT."""


class Stop(threading.Event):
    """Set by the first signal that asks the program to end."""

    number: int = signal.SIGINT
    """The signal."""
    interrupts = False
    """Whether the signal also leaves what runs in the main thread; see `interrupting`."""

    def by(self, number: int) -> None:
        """Set it, because of this signal."""
        self.number = number
        self.set()

    @property
    def status(self) -> int:
        """The exit status of a command that leaves its work half done."""
        return 128 + self.number

    @contextmanager
    def interrupting(self) -> Generator[None]:
        """A part that need not be finished: the signal leaves this block, too."""
        self.interrupts = True
        try:
            yield
        except SystemExit:
            if not self.is_set():
                raise
        finally:
            self.interrupts = False


class _Ending:
    """What is known of the end of this program."""

    number = 0
    """The first signal; 0 before it."""
    is_watched = False
    """Whether signals end this program, and not only a block of `stop_signals`."""
    stop: Stop | None = None
    """Of the command that ends itself."""
    is_own = False
    """Whether the command got the event, and ends itself."""
    kept: Callable[[], str] = staticmethod(lambda: _NOTHING_KEPT)

    def __init__(self) -> None:
        self.last: dict[object, Callable[[], None]] = {}
        """The clean-up actions, newest last."""


_ending = _Ending()
_last = threading.Lock()


@contextmanager
def ended_by_signals() -> Generator[None]:
    """The whole program: a signal that asks it to end does so in time, with one line and status 128 + its number.

    Signals that its parent had it ignore, as nohup does, stay ignored.
    """
    try:
        _watch_signals()
        yield
    except BaseException:
        if not _ending.number or _ending.is_own:
            raise
    if _ending.number and not _ending.is_own:  # whatever a library made of the SystemExit
        _end_now()


@contextmanager
def stop_signals(kept: Callable[[], str] | None = None) -> Generator[Stop]:
    """An event that Ctrl+C, SIGTERM or closing the terminal sets while the block runs; the block must then end.

    Args:
        kept: What to say of the work if the program has to be terminated, one line without control characters.
    """
    stop = Stop()
    if threading.current_thread() is not threading.main_thread():  # Python delivers signals to no other thread
        yield stop
        return
    previous = _handle_signals()
    _ending.stop = stop
    with message_at_stop(kept or _ending.kept):
        if _ending.number:
            stop.by(_ending.number)
        try:
            yield stop
        finally:
            _ending.stop = None
            if not _ending.is_watched:
                _ending.number, _ending.is_own = 0, False
            for number, handler in previous.items():
                signal.signal(number, handler)


@contextmanager
def done_at_stop(action: Callable[[], None]) -> Generator[None]:
    """While the block runs, a signal that ends the program does this at the very end, what came last first."""
    key = object()
    _ending.last[key] = action
    try:
        yield
    finally:
        if not is_ending():
            _ending.last.pop(key, None)


@contextmanager
def removed_at_stop(path: str | os.PathLike[str]) -> Generator[None]:
    """While the block runs, this file or folder is unfinished: the block or the end of the program removes it."""
    name = os.fspath(path)
    with done_at_stop(lambda: _remove(name)):
        yield


def is_ending() -> bool:
    """Whether a signal has asked the program to end: what would wait for its end can leave it to `done_at_stop`."""
    return bool(_ending.number)


@contextmanager
def message_at_stop(kept: Callable[[], str]) -> Generator[None]:
    """While the block runs, a signal that ends the program prints this about its work: one line of plain text."""
    before, _ending.kept = _ending.kept, kept
    try:
        yield
    finally:
        if not _ending.number:
            _ending.kept = before


def _watch_signals() -> None:
    """Handle the signals from now on, and start a thread that ensures that they end the program."""
    _open_missing_streams()  # first: a socket would take their place
    _ending.is_watched = True
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    numbers = frozenset(_handle_signals())
    signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reader, writer, numbers), daemon=True).start()


def _handle_signals() -> dict[int, Any]:
    """Handle all signals that are not ignored; the handlers before, by number."""
    previous: dict[int, Any] = {}
    for name in STOP_SIGNALS:
        number = getattr(signal, name, None)  # SIGHUP is unknown on Windows, SIGBREAK elsewhere
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            previous[number] = signal.signal(number, _on_signal)
    return previous


def _on_signal(number: int, _: object) -> None:
    is_first = not _ending.number
    if is_first:
        _ending.number, _ending.is_own = number, _ending.stop is not None
    if _ending.stop is not None:
        _ending.stop.by(_ending.number)
    if is_first and (_ending.stop is None or _ending.stop.interrupts):
        # A finaliser or another thread that is cut short would show a traceback.
        sys.unraisablehook = threading.excepthook = lambda _: None
        raise SystemExit(128 + number)


def _watch(reader: socket.socket, _kept_open: socket.socket, numbers: frozenset[int]) -> None:
    """End the program that does not end by itself; the system writes the signal before Python can handle it."""
    while (number := reader.recv(1)[0]) not in numbers:
        pass
    time.sleep(MAX_STOP_S)
    if _ending.is_own or _ending.stop is not None:
        time.sleep(MAX_FINISH_S - MAX_STOP_S)
    _ending.number = _ending.number or number
    _end_now()


def _end_now() -> None:
    """Say what was kept, and exit at once: what a normal exit flushes or joins may hang."""
    _last.acquire()  # and never released: the other thread that comes here waits for the end
    for last in (_say, _clean_up):
        thread = threading.Thread(target=last, daemon=True)
        thread.start()
        thread.join(_LAST_S)
    os._exit(128 + _ending.number)


def _say() -> None:
    """Write the last line: the name of the signal, and what is kept of the work."""
    with suppress(Exception):
        name = "Ctrl+C" if _ending.number == signal.SIGINT else signal.Signals(_ending.number).name
        os.write(2, f"kalscope: stopped by {name}: {_ending.kept()}\n".encode("utf-8", "replace"))


def _clean_up() -> None:
    for action in reversed([*_ending.last.values()]):
        with suppress(Exception):
            action()


def _remove(path: str) -> None:
    import shutil

    with suppress(OSError):  # a folder
        os.unlink(path)
    shutil.rmtree(path, ignore_errors=True)


def _open_missing_streams() -> None:
    """Open standard streams that the parent closed (`>&-`), so that no other file gets their numbers."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 (for as long as the program runs)
