"""A unit that takes too long ends its process, wherever it hangs, and leaves a note that names it.

A thread of C ends the process. It needs no lock of the interpreter, which a compiled loop may hold for ever.
"""

from __future__ import annotations

import faulthandler
import threading
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from operator import itemgetter
from pathlib import Path
from typing import BinaryIO

from kalscope.tuning.fleet.store.parts import note_path

FULL_BYTES = 16 << 20
"""A larger unit has more time, in proportion to its bytes."""
_TIMEOUT = b"Timeout ("
"""How `faulthandler` begins its report."""
_running: dict[object, tuple[float, BinaryIO]] = {}
"""The units of this process, one for each of its threads: when each must have ended, and its note."""
_changing = threading.Lock()


class TimedOut(Exception):
    """A unit of the batch has ended an earlier worker; the note says which."""


def time_limit(size: int, device_limit: float) -> float:
    """Longest time for a unit of `size` bytes, s."""
    return device_limit * max(1.0, size / FULL_BYTES)


def unit_in_note(folder: Path, keys: Sequence[str]) -> str | None:
    """The unit that took too long in the last attempt at a batch; None where it ended in another way."""
    with suppress(OSError):
        key, _, report = note_path(folder, keys).read_bytes().partition(b"\n")
        if report.startswith(_TIMEOUT):
            return key.decode()
    return None


class Deadlines:
    """The time limits of the units of one batch."""

    def __init__(self, note: BinaryIO) -> None:
        self._note = note

    @contextmanager
    def end_after(self, seconds: float, key: str) -> Generator[None]:
        """End this process if the block takes longer."""
        self._note.seek(0)
        self._note.truncate()
        self._note.write(f"{key}\n".encode())
        with _changing:
            _running[self] = time.monotonic() + seconds, self._note
            _start_clock()
        try:
            yield
        finally:
            with _changing:
                del _running[self]
                _start_clock()


@contextmanager
def deadlines(folder: Path, keys: Sequence[str]) -> Generator[Deadlines]:
    """The time limits of a batch of these units; its note is there until the block ends.

    Raises:
        TimedOut: an earlier attempt has left its note: a scheduler tries a batch again on its own.
        OSError: the note cannot be written.
    """
    if unit_in_note(folder, keys) is not None:
        raise TimedOut
    path = note_path(folder, keys)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with path.open("wb", buffering=0) as note:
            yield Deadlines(note)
    finally:
        path.unlink(missing_ok=True)


def _start_clock() -> None:
    """Wait for the next of the deadlines; a process has one clock."""
    if not _running:
        faulthandler.cancel_dump_traceback_later()
        return
    due, note = min(_running.values(), key=itemgetter(0))
    left = min(max(due - time.monotonic(), 1e-3), threading.TIMEOUT_MAX)
    faulthandler.dump_traceback_later(left, exit=True, file=note)
