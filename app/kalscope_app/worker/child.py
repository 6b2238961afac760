"""What runs in the worker process: it takes tasks from its input, one at a time, and answers on its output."""

from __future__ import annotations

import importlib
import io
import os
import pickle
import queue
import shutil
import signal
import tempfile
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kalscope.common.files import free_memory, limit_memory
from kalscope.errors import KalscopeError
from kalscope_app.worker.messages import Done, Failed, Progress, receive, send

IDLE_S = 0.5
"""Seconds to wait for the first task before warming up: it may be on its way."""
REPORT_S = 0.1
"""Seconds between two reports of progress, at least."""
MEMORY_SHARE = 0.8
"""Share of the free memory that a task may take."""
NO_MEMORY = 12
"""Exit status of this process where a task does not fit into the memory."""
MAX_CPU_S = 1800
"""Processor time of a task, s: ends even one that cannot be interrupted after the dashboard was killed."""


@dataclass(frozen=True)
class Task:
    """A call to make."""

    work: Callable[..., Any]
    """The function, known by its name."""
    reports: bool
    """Whether it takes `progress`, an `OnProgress`."""


def main(folder: str) -> None:
    """Serve tasks until the input ends; temporary files go into `folder`, which is then removed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to every process of the program
    tempfile.tempdir = folder
    answers = io.FileIO(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what a library prints is not an answer
    tasks: queue.SimpleQueue[Task] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(tasks, folder), daemon=True).start()
    importlib.import_module("kalscope.catalogue")  # with every reader of text
    try:
        task = tasks.get(timeout=IDLE_S)
    except queue.Empty:
        _warm_up(Path(folder))
        task = tasks.get()
    while True:
        send(answers, _answer(task, answers))
        task = tasks.get()


def _listen(tasks: queue.SimpleQueue[Task], folder: str) -> None:
    """Pass the tasks on; end this process, whatever it does, when the dashboard ends."""
    status = 1
    try:
        with io.FileIO(0, "r", closefd=False) as stream:
            while True:
                tasks.put(receive(stream))
    except (EOFError, OSError):
        status = 0
    except MemoryError:  # the rest of the input belongs to that task
        status = NO_MEMORY
    finally:
        shutil.rmtree(folder, ignore_errors=True)  # a dashboard that was killed cannot
        if status == 0 and os.name == "posix" and os.getpgrp() == os.getpid():
            os.killpg(0, signal.SIGKILL)  # and what it has started
        os._exit(status)


def _warm_up(folder: Path) -> None:
    """Read a log once, so that everything is imported and compiled before the first file of the user comes."""
    from kalscope.sources.reading.recording_file import read_recording
    from kalscope.sources.reading.rows import MAX_BYTES_BY_LINE

    log = folder / "warm.csv"
    with suppress(KalscopeError, OSError):
        log.write_text("t,a\n" + "".join(f"{i},{i % 7}.5\n" for i in range(MAX_BYTES_BY_LINE // 4)))
        read_recording(log)
    log.unlink(missing_ok=True)


def _answer(task: Task, answers: io.RawIOBase) -> Done | Failed:
    """Do one task."""
    free, due = free_memory(), time.monotonic() + REPORT_S
    if free is not None:
        limit_memory(int(MEMORY_SHARE * free))
    _limit_time()

    def report(fraction: float, text: str) -> None:
        nonlocal due
        if time.monotonic() >= due:
            due = time.monotonic() + REPORT_S
            send(answers, Progress(fraction, text))

    try:
        return Done(task.work(progress=report) if task.reports else task.work())
    except Exception as error:
        if not isinstance(error, KalscopeError | OSError):
            error.add_note(traceback.format_exc())
        return Failed(_sendable(error))


def _sendable(error: Exception) -> Exception:
    """The error, or one with its text if it cannot be pickled."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError("".join(traceback.format_exception(error)))
    return error


def _limit_time() -> None:
    """Let the system end this process after MAX_CPU_S more of processor time; Windows cannot."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        used = resource.getrusage(resource.RUSAGE_SELF)
        _, hard = resource.getrlimit(resource.RLIMIT_CPU)
        resource.setrlimit(resource.RLIMIT_CPU, (int(used.ru_utime + used.ru_stime) + MAX_CPU_S, hard))
