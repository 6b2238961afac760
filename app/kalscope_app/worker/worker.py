"""The worker as the dashboard sees it: one process, started early, that does one task at a time.

A task may hold its interpreter, fill its memory or crash: the dashboard, with the reader of a port and the
recorder, is another process. What ends a task early (Cancel, a limit, a crash) ends the process, and the next one
is started at once.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any, TypeVar

from kalscope.common.files import does_not_fit
from kalscope.common.progress import OnProgress
from kalscope.common.stopping import done_at_stop
from kalscope.errors import BadFile, Cancelled, NoMemory
from kalscope_app.worker.child import MAX_CPU_S, NO_MEMORY, main, receive, send

T = TypeVar("T")

MAX_SILENCE_S = 120.0
"""Seconds in which a task must report some progress."""
_LOOK_S = 0.05
"""Seconds between two checks whether a task is cancelled."""
_ENVIRONMENT = {"OPENBLAS_NUM_THREADS": "1", "PYTHONSAFEPATH": "1"}
"""Of the process: a thread of OpenBLAS takes 40 MB at the start, and no module may come from the user's folder."""


class Process:
    """One worker process and its temporary folder."""

    def __init__(self) -> None:
        self._folder = tempfile.mkdtemp(prefix="kalscope-worker-")
        spawn = multiprocessing.get_context("spawn")
        self.pipe, theirs = spawn.Pipe()
        self._process = spawn.Process(target=main, args=(theirs, self._folder), daemon=True)
        os.environ.update(_ENVIRONMENT)
        self._process.start()
        theirs.close()
        self._at_stop = ExitStack()
        self._at_stop.enter_context(done_at_stop(self.end))

    @property
    def pid(self) -> int:
        """Its number."""
        return self._process.pid or 0

    @property
    def is_alive(self) -> bool:
        """Whether it takes tasks."""
        return self._process.is_alive()

    def end(self) -> None:
        """End it at once with what it has started, whatever it does, and remove what it has unpacked."""
        if self.is_alive:  # else its number may be that of another process
            with suppress(OSError, AttributeError):  # no group yet, or none on this system
                os.killpg(self.pid, signal.SIGKILL)
            self._process.kill()
        self._process.join(1.0)  # longer if it is blocked on a lost network: the system ends it later
        shutil.rmtree(self._folder, ignore_errors=True)
        self._at_stop.close()

    def why_ended(self, what: str) -> BadFile | NoMemory:
        """Why the process ended while it read `what`."""
        self._process.join(1.0)  # its pipe ends a moment before it does
        status = self._process.exitcode
        if status == NO_MEMORY:
            return does_not_fit(what)
        if status == -getattr(signal, "SIGXCPU", 0):
            return BadFile(f"{what} must be read within {MAX_CPU_S} s of processor time (got more): given up")
        if status == -getattr(signal, "SIGKILL", 0):
            why = "the system ended the process that read it, as it does without memory"
        else:
            why = f"the process that read it crashed (status {status})"
        return BadFile(f"{what} could not be read: {why}")


class Worker:
    """Runs tasks in a process beside this one, which is kept ready."""

    def __init__(self) -> None:
        self._process: Process | None = None
        self._one_at_a_time = threading.Lock()
        self._starting = threading.Lock()
        self._is_closed = False

    def warm_up(self) -> None:
        """Start the process, unless it runs: the first task then finds everything imported."""
        with self._starting:
            if self._process is not None and not self._process.is_alive:
                self._process.end()
                self._process = None
            if self._process is None and not self._is_closed:
                self._process = Process()

    def close(self) -> None:
        """End the process and what it does."""
        self._is_closed = True
        with self._starting:
            self._replace(restart=False)

    def run(
        self,
        work: Callable[..., T],
        what: str,
        progress: OnProgress | None = None,
        cancelled: Callable[[], bool] | None = None,
    ) -> T:
        """Do `work` in the process and return what it returned.

        Args:
            work: The task; it and its answer can be pickled, and arrays are sent as they are.
            what: What is read, for messages.
            progress: Called with the progress, again and again; `work` then takes a `progress` by name.
            cancelled: Whether to stop: the process is then ended at once.

        Raises:
            BadFile: the task crashed the process, reported nothing for MAX_SILENCE_S, or took too long.
            Cancelled: `cancelled()` was true, or the worker was closed.
            NoMemory: the task or its answer does not fit into the memory.
            Exception: what the task raised.
        """
        with self._one_at_a_time:
            self.warm_up()
            process = self._process
            if process is None:
                raise Cancelled("the program is ending")
            try:
                kind, answer = self._answer(process, (work, progress is not None), what, progress, cancelled)
            except BaseException as error:
                with self._starting:
                    self._replace(restart=not self._is_closed)
                if isinstance(error, MemoryError):  # the rest of the answer is still in the pipe
                    raise does_not_fit(what) from None
                raise
        if kind == "done":
            return answer
        if isinstance(answer, MemoryError) and not isinstance(answer, NoMemory):
            raise does_not_fit(what)
        raise answer

    def _answer(
        self,
        process: Process,
        task: tuple[Callable[..., T], bool],
        what: str,
        progress: OnProgress | None,
        cancelled: Callable[[], bool] | None,
    ) -> tuple[str, Any]:
        """What the process answers to a task, "done" or "failed"."""
        fraction, text, reported_at = 0.0, "", time.monotonic()
        try:
            send(process.pipe, task)
            while True:
                if process.pipe.poll(_LOOK_S):
                    kind, answer = receive(process.pipe)
                    if kind != "progress":
                        return kind, answer
                    (fraction, text), reported_at = answer, time.monotonic()
                if cancelled is not None and cancelled():
                    raise Cancelled("the task was cancelled before it was finished")
                if progress is not None:
                    progress(fraction, text)
                if time.monotonic() - reported_at > MAX_SILENCE_S:
                    raise BadFile(
                        f"{what} must show progress every {MAX_SILENCE_S:g} s while it is read (got none)"
                    )
        except (EOFError, OSError):
            raise Cancelled("the program is ending") if self._is_closed else process.why_ended(what) from None

    def _replace(self, *, restart: bool) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.end()
        if restart:
            with suppress(OSError):  # the next task tries again, and reports why it fails
                self._process = Process()
