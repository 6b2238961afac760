"""What runs in the worker process: it takes tasks from a pipe, one at a time, and sends back what they return."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import pickle
import shutil
import signal
import tempfile
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from kalscope.common.files import free_memory, limit_memory
from kalscope.errors import KalscopeError

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

IDLE_S = 0.5
"""Seconds to wait for the first task before warming up: it may be on its way."""
REPORT_S = 0.1
"""Seconds between two reports of progress, at least."""
MEMORY_SHARE = 0.8
"""Share of the free memory that a task may take."""
MAX_CPU_S = 1800
"""Processor time of a task, s: ends even one that cannot be interrupted after the dashboard was killed."""
PART = 1 << 24
"""Bytes of an array that are sent at a time: the pipe of Python holds what it receives twice. For a recording of
480 MB this process takes 0.5 GB and the dashboard 0.5 GB, against 1.4 and 0.9 with `pipe.send` alone."""


def send(pipe: Connection, message: Any) -> None:
    """Send a message, its arrays as they are in memory.

    Raises:
        OSError: the other process no longer reads.
    """
    arrays: list[memoryview] = []
    body = pickle.dumps(message, 5, buffer_callback=lambda array: arrays.append(array.raw()))
    pipe.send((body, [array.nbytes for array in arrays]))
    for array in arrays:
        for at in range(0, array.nbytes, PART):
            pipe.send_bytes(array[at : at + PART])


def receive(pipe: Connection) -> Any:
    """Receive a message; other threads can run while its arrays arrive.

    Raises:
        EOFError, OSError: the other process has ended.
        MemoryError: it does not fit into the memory.
    """
    body, sizes = pipe.recv()
    free = free_memory()
    if free is not None and sum(sizes) > free:
        raise MemoryError
    arrays = [np.empty(size, np.uint8).data for size in sizes]  # a bytearray would be filled with zeros first
    for array in arrays:
        for at in range(0, array.nbytes, PART):
            pipe.recv_bytes_into(array[at : at + PART])
    return pickle.loads(body, buffers=arrays)


def main(pipe: Connection, folder: str) -> None:
    """Serve tasks until this process is ended; temporary files go into `folder`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to every process of the program
    if os.name == "posix":
        os.setpgid(0, 0)  # what a task starts ends with this process
    tempfile.tempdir = folder
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in 1, 2:  # standard output is for the link
        os.dup2(nowhere, stream)
    watch = threading.Thread(target=_end_with_dashboard, args=(folder,), daemon=True)
    watch.start()
    importlib.import_module("kalscope.catalogue")  # with every reader of text
    if not pipe.poll(IDLE_S):
        _warm_up(Path(folder))
    try:
        while True:
            work, reports = receive(pipe)
            send(pipe, _answer(pipe, work, reports=reports))
    except (EOFError, OSError):
        watch.join()


def _end_with_dashboard(folder: str) -> None:
    """End this process, whatever it does, when the dashboard has ended; one that was killed cannot do it."""
    dashboard = multiprocessing.parent_process()
    if dashboard is not None:
        dashboard.join()
    shutil.rmtree(folder, ignore_errors=True)
    if os.name == "posix":
        os.killpg(0, signal.SIGKILL)
    os._exit(0)


def _warm_up(folder: Path) -> None:
    """Read a log once, so that everything is imported and compiled before the first file of the user comes."""
    from kalscope.sources.reading.recording_file import read_recording
    from kalscope.sources.reading.rows import MAX_BYTES_BY_LINE

    log = folder / "warm.csv"
    with suppress(KalscopeError, OSError):
        log.write_text("t,a\n" + "".join(f"{i},{i % 7}.5\n" for i in range(MAX_BYTES_BY_LINE // 4)))
        read_recording(log)
    log.unlink(missing_ok=True)


def _answer(pipe: Connection, work: Callable[..., Any], *, reports: bool) -> tuple[str, Any]:
    """Do one task: "done" and what it returned, or "failed" and what it raised; "progress" is sent meanwhile."""
    free, due = free_memory(), time.monotonic() + REPORT_S
    if free is not None:
        limit_memory(int(MEMORY_SHARE * free))
    with suppress(AttributeError):  # Windows has no such timer
        signal.setitimer(signal.ITIMER_PROF, MAX_CPU_S)

    def report(fraction: float, text: str) -> None:
        nonlocal due
        if time.monotonic() >= due:
            due = time.monotonic() + REPORT_S
            send(pipe, ("progress", (fraction, text)))

    try:
        return "done", work(progress=report) if reports else work()
    except (KalscopeError, OSError, MemoryError) as error:
        return "failed", error
    except Exception as error:  # which may be one that cannot be pickled
        bug = RuntimeError(repr(error))
        bug.add_note(traceback.format_exc())
        return "failed", bug
