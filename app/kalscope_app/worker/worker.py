"""The worker as the dashboard sees it: one process, started early, that does one task at a time.

A task may hold its interpreter, fill its memory or crash: the dashboard, with the reader of a port and the
recorder, is another process. What ends a task early (Cancel, a limit, a crash) ends the process, and the next one
is started at once.
"""

from __future__ import annotations

import io
import os
import queue
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import TypeVar, cast

from kalscope.common.files import does_not_fit
from kalscope.common.progress import OnProgress
from kalscope.common.stopping import done_at_stop
from kalscope.errors import BadFile, Cancelled, NoMemory
from kalscope_app.worker.child import MAX_CPU_S, NO_MEMORY, Task
from kalscope_app.worker.messages import Done, Failed, Progress, receive, send

T = TypeVar("T")

MAX_SILENCE_S = 120.0
"""Seconds in which a task must report some progress."""
_LOOK_S = 0.05
"""Seconds between two checks whether a task is cancelled."""
_CODE = "import sys; sys.path[:] = {path!r}; from kalscope_app.worker.child import main; main({folder!r})"


class Process:
    """One worker process and its temporary folder."""

    def __init__(self) -> None:
        self._folder = tempfile.mkdtemp(prefix="kalscope-worker-")
        code = _CODE.format(path=[part for part in sys.path if part], folder=self._folder)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            bufsize=0,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},  # each of its threads takes 40 MB at the start
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            process_group=0 if os.name == "posix" else None,  # which ends with it, see `_kill`
        )
        self.pid, self._is_readable = self._process.pid, True
        self._at_stop = ExitStack()
        self._at_stop.enter_context(done_at_stop(self.end))
        self.news: queue.SimpleQueue[Progress | Done | Failed | None] = queue.SimpleQueue()
        """What it reports; None once it has ended."""
        threading.Thread(target=self._listen, name="kalscope-worker", daemon=True).start()

    def _listen(self) -> None:
        try:
            with cast("io.FileIO", self._process.stdout) as stream:
                while True:
                    self.news.put(receive(stream))
        except (EOFError, OSError, ValueError):  # ValueError: closed by `end`
            pass
        except Exception as error:  # an answer that does not fit into the memory; its rest is still in the pipe
            self._is_readable = False
            self.news.put(Failed(error))
        self.news.put(None)

    @property
    def is_alive(self) -> bool:
        """Whether it takes tasks."""
        return self._is_readable and self._process.poll() is None

    def send(self, task: Task) -> None:
        """Give it a task; if it has ended meanwhile, `news` brings None."""
        with suppress(OSError):
            send(cast("io.FileIO", self._process.stdin), task)

    def end(self) -> None:
        """End it at once, whatever it does, and remove what it has unpacked."""
        with suppress(OSError):
            cast("io.FileIO", self._process.stdin).close()
        self._kill()
        with suppress(subprocess.TimeoutExpired):  # it is blocked on a lost network: the system ends it later
            self._process.wait(1.0)
        shutil.rmtree(self._folder, ignore_errors=True)
        self._at_stop.close()

    def _kill(self) -> None:
        """End it and, where there are process groups, what it has started: a spreadsheet is read by a process."""
        if os.name != "posix":
            self._process.kill()
        elif self._process.poll() is None:  # else its number may be that of another process
            with suppress(OSError):  # it has just ended: macOS then refuses where Linux finds no process
                os.killpg(self.pid, signal.SIGKILL)

    def why_ended(self, what: str) -> BadFile | NoMemory:
        """Why the process ended while it read `what`."""
        with suppress(subprocess.TimeoutExpired):  # its output ends a moment before it does
            self._process.wait(1.0)
        status = self._process.poll()
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
        task = Task(work, reports=progress is not None)
        with self._one_at_a_time:
            self.warm_up()
            process = self._process
            if process is None:
                raise Cancelled("the program is ending")
            try:
                process.send(task)
                answer = self._wait(process, what, progress, cancelled)
            except BaseException:
                with self._starting:
                    self._replace(restart=not self._is_closed)
                raise
            if isinstance(answer, Done):
                return answer.answer
            if isinstance(answer.error, MemoryError) and not isinstance(answer.error, NoMemory):
                raise does_not_fit(what)
            raise answer.error

    def _wait(
        self, process: Process, what: str, progress: OnProgress | None, cancelled: Callable[[], bool] | None
    ) -> Done | Failed:
        """The answer to the task that the process does."""
        last, reported_at = Progress(0.0, ""), time.monotonic()
        while True:
            with suppress(queue.Empty):
                news = process.news.get(timeout=_LOOK_S)
                if isinstance(news, Done | Failed):
                    return news
                if news is None:
                    ended = process.why_ended(what)
                    raise Cancelled("the program is ending") if self._is_closed else ended
                last, reported_at = news, time.monotonic()
            if cancelled is not None and cancelled():
                raise Cancelled("the task was cancelled before it was finished")
            if progress is not None:
                progress(last.fraction, last.text)
            if time.monotonic() - reported_at > MAX_SILENCE_S:
                raise BadFile(f"{what} must show progress every {MAX_SILENCE_S:g} s while it is read (got none)")

    def _replace(self, *, restart: bool) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.end()
        if restart:
            with suppress(OSError):  # the next task tries again, and reports why it fails
                self._process = Process()
