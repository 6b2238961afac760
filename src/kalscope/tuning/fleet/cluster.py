"""Dask: the cores of this machine, or the scheduler that the user names; the same code for both."""

from __future__ import annotations

import math
import os
import queue
import signal
import time
from collections.abc import Generator
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import active_children, resource_tracker
from typing import TYPE_CHECKING, Any

from kalscope.common.files import temporary_folder
from kalscope.common.stopping import done_at_stop, is_ending
from kalscope.errors import BadDevice
from kalscope.tuning.fleet.batches import Batch
from kalscope.tuning.fleet.libraries import library

if TYPE_CHECKING:
    from pathlib import Path

PATIENCE_S = 15.0
"""Time for a scheduler to answer, and for its first worker to connect, s."""
SETTINGS = {
    "distributed.scheduler.allowed-failures": 0,  # the dispatcher decides what a death means
    "distributed.worker.daemon": True,  # workers end with the driver, even after kill -9
    "distributed.comm.timeouts.connect": PATIENCE_S,
    "distributed.admin.tick.limit": "1 h",  # no warnings about an event loop that waited for a fit
    # A worker holds nothing between two batches, so that waiting or writing its memory to disk would not help:
    # paused workers would never resume. One that is about to exceed its share is ended, and its batch halved.
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
}
"""Settings of Dask for the driver, and for the workers that it starts."""
WORKER_BYTES = 1 << 30
"""Memory that a worker of this machine may need; with less per core, fewer workers are started."""


class WorkerDied(Exception):
    """The worker of a task is gone, killed or out of memory."""


class TaskLost(Exception):
    """The task was forgotten: the scheduler was lost, or another one took its place."""


class Workers:
    """Workers that take batches and return their results, in any order."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._batches: dict[Any, Batch] = {}
        self._threads, self._asked = 0, -math.inf

    @property
    def threads(self) -> int:
        """Tasks that run at a time, as the scheduler said a second ago at most: workers come and go."""
        if time.monotonic() > self._asked + 1.0:
            with suppress(Exception):  # a scheduler that is gone is noticed by its tasks
                self._threads = sum(self._client.nthreads().values())
            self._asked = time.monotonic()
        return self._threads

    def submit(self, batch: Batch, *call: Any) -> None:
        """Begin a batch: call[0] with the other arguments, on some worker."""
        future = self._client.submit(*call, pure=False)
        self._batches[future] = batch
        future.add_done_callback(self._ended.put)

    def ended(self, timeout: float) -> tuple[Batch, Any] | None:
        """A batch that has ended and what its call returned, or the exception that it raised; None on timeout.

        Raises:
            BadDevice: the scheduler is gone.
        """
        try:
            future = self._ended.get(timeout=timeout)
        except queue.Empty:
            if self._client.status in ("closed", "closing"):
                raise BadDevice("the scheduler must stay reachable (got no answer)") from None
            return None
        batch = self._batches.pop(future)
        try:
            result = future.result(timeout=PATIENCE_S)
        except CancelledError:
            result = TaskLost()
        except Exception as error:
            result = WorkerDied() if isinstance(error, library("distributed").KilledWorker) else error
        future.release()
        return batch, result

    def cancel(self) -> None:
        """Cancel all batches that have not ended."""
        with suppress(Exception):  # a scheduler that is gone has forgotten it
            self._client.cancel(list(self._batches), force=True)


@contextmanager
def open_workers(address: str | None, tasks: int) -> Generator[Workers]:
    """The workers of a scheduler, or those of this machine while the block runs, one for each core.

    Args:
        address: "tcp://HOST:PORT" of a scheduler; None = this machine.
        tasks: How many there will be: more workers than that are not started.

    Raises:
        BadDevice: no scheduler answers there, or it has no worker.
    """
    dask, distributed = library("dask"), library("distributed")
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(SETTINGS))
        if address is None:
            folder = stack.enter_context(temporary_folder())
            place = stack.enter_context(_this_machine(distributed, _workers_here(tasks), folder))
        else:
            place = address
        try:
            client = stack.enter_context(distributed.Client(place, timeout=PATIENCE_S, set_as_default=False))
            if address is not None:
                client.wait_for_workers(1, timeout=PATIENCE_S)
        except (OSError, ValueError, TimeoutError) as error:
            reason = " ".join(str(error).split())[:200]
            raise BadDevice(f"--cluster must name a scheduler with workers (got {address!r}: {reason})") from None
        found = Workers(client)
        stack.callback(found.cancel)
        yield found


def _workers_here(tasks: int) -> int:
    """How many workers this machine has cores and memory for, at most one for each task."""
    memory = library("distributed.system").MEMORY_LIMIT
    return max(1, min(tasks, library("dask.system").CPU_COUNT, memory // WORKER_BYTES))


@contextmanager
def _this_machine(distributed: Any, count: int, folder: Path) -> Generator[Any]:
    """Workers on this machine that keep their temporary files in `folder`."""
    cluster: Any = None

    def kill() -> None:  # a part is whole or absent, whenever this happens
        for worker in () if cluster is None else [*cluster.workers.values()]:  # Dask changes them meanwhile
            worker.status = distributed.Status.closing  # else Dask would start it again
        for process in active_children():
            process.kill()

    with done_at_stop(kill):
        with _without_interrupts():
            cluster = distributed.LocalCluster(
                threads_per_worker=1,
                n_workers=count,
                processes=True,
                dashboard_address=None,
                # Dask serves metrics on this port, as 8787 may be taken; a scheduler keeps files in a folder, too.
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0", "local_directory": str(folder)},
                local_directory=str(folder),
                silence_logs=60,  # a worker that dies is handled here
                preload=["kalscope.tuning.fleet.worker_setup"],
            )
        try:
            yield cluster
        finally:
            if not is_ending():  # a worker would finish its recording first
                cluster.close(timeout=10.0)


@contextmanager
def _without_interrupts() -> Generator[None]:
    """Block Ctrl+C while processes are started, which inherit that: a terminal sends it to them too.

    Outside POSIX nothing is inherited.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    with _environment(
        PYTHONWARNINGS="ignore:resource_tracker:UserWarning"
    ):  # it would warn of what killed workers left
        resource_tracker.ensure_running()  # it would unblock the signal when it starts
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _environment(**added: str) -> Generator[None]:
    """Variables for the processes that are started meanwhile."""
    before = {name: os.environ.get(name) for name in added}
    os.environ.update(added)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value
