"""The worker as the dashboard sees it: one process, started early, that does one task at a time.

A task may hold its interpreter, fill its memory or crash: the dashboard, with the reader of a port and the
recorder, is another process. What ends a task early (Cancel, a limit, a crash) ends the process, and the next one
is started at once.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any, TypeVar, cast

from kalscope.common.files import does_not_fit
from kalscope.common.progress import Progress
from kalscope.errors import BadFile, Cancelled, NoMemory
from kalscope_app.worker.child import MAX_CPU_S, main, receive, send

if TYPE_CHECKING:
    from multiprocessing.context import SpawnProcess

T = TypeVar("T")

MAX_SILENCE_S = 120.0
"""Seconds in which a task must report some progress."""
_LOOK_S = 0.05
"""Seconds between two checks whether a task is cancelled."""
_ENVIRONMENT = {"OPENBLAS_NUM_THREADS": "1", "PYTHONSAFEPATH": "1"}
"""Of the process: a thread of OpenBLAS takes 40 MB at the start, and no module may come from the user's folder."""


class Worker:
    """Runs tasks in a process beside this one, which is kept ready."""

    def __init__(self) -> None:
        self._process: SpawnProcess | None = None
        self._one_at_a_time, self._starting = threading.Lock(), threading.Lock()
        self._is_closed = False

    def warm_up(self) -> None:
        """Start the process, unless it runs: the first task then finds everything imported."""
        with self._starting:
            if self._process is None or not self._process.is_alive():
                self._replace()

    def close(self) -> None:
        """End the process and what it does."""
        self._is_closed = True
        with self._starting:
            self._replace()

    def run(self, work: Callable[..., T], what: str, progress: Progress | None = None) -> T:
        """Do `work` in the process and return what it returned.

        Args:
            work: The task; it and its answer can be pickled, and arrays are sent as they are.
            what: What is read, for messages.
            progress: Called again and again; where it reports, `work` takes a `progress` by name. To cancel it ends
                the process at once.

        Raises:
            BadFile: the task crashed the process, reported nothing for MAX_SILENCE_S, or took too long.
            Cancelled: `progress` was cancelled, or the worker was closed.
            NoMemory: the task or its answer does not fit into the memory.
            KalscopeError, OSError: what the task raised.
            RuntimeError: the task raised something else, which is named.
        """
        progress = progress or Progress()
        with self._one_at_a_time:
            self.warm_up()
            if self._is_closed:
                raise Cancelled("the program is ending")
            try:
                kind, answer = self._answer((work, progress.report is not None), what, progress)
            except BaseException as error:  # the rest of the answer may still be in the pipe
                with self._starting, suppress(OSError):  # the next task tries again, and reports why it fails
                    self._replace()
                kind, answer = "failed", cast("Any", error)
        if kind == "done":
            return answer
        if isinstance(answer, MemoryError) and not isinstance(answer, NoMemory):
            raise does_not_fit(what) from None
        raise answer

    def _answer(self, task: tuple[Callable[..., T], bool], what: str, progress: Progress) -> tuple[str, Any]:
        """What the process answers to a task, "done" or "failed"."""
        fraction, text, reported_at = 0.0, "", time.monotonic()
        try:
            send(self._pipe, task)
            while True:
                if self._pipe.poll(_LOOK_S):
                    kind, answer = receive(self._pipe)
                    if kind != "progress":
                        return kind, answer
                    (fraction, text), reported_at = answer, time.monotonic()
                progress(fraction, text)
                if time.monotonic() - reported_at > MAX_SILENCE_S:
                    raise BadFile(
                        f"{what} must show progress every {MAX_SILENCE_S:g} s while it is read (got none)"
                    )
        except (EOFError, OSError):
            raise Cancelled("the program is ending") if self._is_closed else self._why_ended(what) from None

    def _why_ended(self, what: str) -> BadFile:
        """Why the process ended while it read `what`."""
        status = None
        if self._process is not None:
            self._process.join(1.0)  # its pipe ends a moment before it does
            status = self._process.exitcode
        if status == -getattr(signal, "SIGPROF", math.inf):
            return BadFile(f"{what} must be read within {MAX_CPU_S} s of processor time (got more): given up")
        if status == -getattr(signal, "SIGKILL", math.inf):
            why = "the system ended the process that read it, as it does without memory"
        else:
            why = f"the process that read it crashed (status {status})"
        return BadFile(f"{what} could not be read: {why}")

    def _replace(self) -> None:
        """End the process with all that it started, and start another unless the worker is closed."""
        process, self._process = self._process, None
        if process is not None:
            if process.is_alive():  # else its number may be that of another process
                with suppress(OSError, AttributeError):  # no group yet, or none on this system
                    os.killpg(process.pid or 0, signal.SIGKILL)
                process.kill()
            process.join(1.0)  # longer if it is blocked on a lost network: the system ends it later
            shutil.rmtree(self._folder, ignore_errors=True)
        if self._is_closed:
            return
        self._folder = tempfile.mkdtemp(prefix="kalscope-worker-")
        spawn = multiprocessing.get_context("spawn")
        self._pipe, theirs = spawn.Pipe()
        process = spawn.Process(target=main, args=(theirs, self._folder), daemon=True)
        os.environ.update(_ENVIRONMENT)
        process.start()
        theirs.close()
        self._process = process
