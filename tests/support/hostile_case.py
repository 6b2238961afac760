"""One hostile file: how it is made, what must come of it, and what reading it took, in a process of its own."""

from __future__ import annotations

import resource
import sys
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kalscope import read_recording
from kalscope.errors import KalscopeError

MIB = 1 << 20
MAX_CPU_S = 300
"""Seconds of the processor after which the system ends a reading that does not end by itself."""


@dataclass(frozen=True)
class Case:
    """A row of the table."""

    name: str
    """What is hostile in it, in a few words."""
    make: Callable[[Path, int], object]
    """Makes the file, of this size."""
    expected: str
    """What must come of it, the beginning as a regular expression: "read: " with rows, channels and rejected lines,
    or "refused: " with the message."""
    small: int = 1
    """Size in the suite, in what `make` counts; 0: it is too long for the suite."""
    big: int = 1
    """Size in `make soak` and in the table of benchmarks."""
    mib: int = 64
    """Most memory that reading the small file may add, in MiB."""
    big_mib: int = 100
    """The same for the big file."""
    file: str = "log.csv"
    """Its file name."""
    then: str = ""
    """Where something else must come of the big file."""
    during: Callable[[Path], object] | None = None
    """What happens to the file as soon as it is being read."""

    def expects(self, *, big: bool) -> str:
        """What must come of the small or of the big file."""
        return self.then if big and self.then else self.expected


@dataclass(frozen=True)
class Seen:
    """What came of a file."""

    outcome: str
    """"read: …" or "refused: …", else a traceback."""
    mib: float
    """Most memory that was added, in MiB, also by processes that the reading started."""
    seconds: float
    """Seconds of the processor."""


def examine(path: Path, during: Callable[[Path], object] | None = None) -> Seen:
    """Read a file in this process, which must be a fresh one: its memory is measured by the peak."""
    resource.setrlimit(resource.RLIMIT_CPU, (MAX_CPU_S, MAX_CPU_S))
    memory, seconds = peak_mib(), busy_s()
    outcome = outcome_of(path, during)
    return Seen(outcome, peak_mib() - memory, busy_s() - seconds)


def examine_all(files: list[tuple[Path, Callable[[Path], object] | None]]) -> list[Seen]:
    """Read files in this fresh process, one after the other: each adds what its peak is above those before it."""
    return [examine(*file) for file in files]


def outcome_of(path: Path, during: Callable[[Path], object] | None) -> str:
    """What reading a file comes to; a warning counts as a failure, because it would reach the terminal."""
    waiting = [during] if during else []

    def look() -> bool:
        if waiting:
            waiting.pop()(path)
        return False

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            recording = read_recording(path, cancelled=look)
    except KalscopeError as refusal:
        return f"refused: {refusal}"
    except BaseException:
        return traceback.format_exc()
    report = recording.report
    return f"read: {len(recording)} rows, {len(recording.names)} channels, {report.rejected} rejected"


def busy_s() -> float:
    """Seconds of the processor that this process, and those that it started and that have ended, took so far."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def peak_mib() -> float:
    """Most memory that this process, or one that it started, has held so far, in MiB."""
    peak = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return peak / (MIB if sys.platform == "darwin" else 1024)


def in_child(context: Any, work: Callable[..., object], *arguments: object) -> Any:
    """The result of `work` in a new process of this multiprocessing context; a sentence where the process died."""
    receiving, sending = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(sending, work, arguments))
    process.start()
    sending.close()
    try:
        return receiving.recv()
    except EOFError:
        process.join()
        return Seen(f"the process ended with status {process.exitcode}", 0.0, 0.0)
    finally:
        process.join()


def _answer(sending: Any, work: Callable[..., object], arguments: tuple[object, ...]) -> None:
    sending.send(work(*arguments))
    sending.close()
