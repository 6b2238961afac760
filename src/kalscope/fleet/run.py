"""A run on Dask: batches of units that are missing, workers that die, and the answer at the end."""

from __future__ import annotations

import os
import queue
import signal
import tempfile
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import active_children, resource_tracker
from pathlib import Path
from typing import Any, cast

from kalscope.common.files import temporary_folder
from kalscope.common.stopping import done_at_stop, is_ending
from kalscope.common.text import trimmed
from kalscope.errors import BadDevice, KalscopeError
from kalscope.estimation.pool import Pool
from kalscope.fleet.read import FleetOptions, Unit, find_units
from kalscope.fleet.results import Fleet, Tally, answer_for, devices_of, save_answer
from kalscope.fleet.store import FAILED, TIMED_OUT, Store, Stored, library, open_store, stored
from kalscope.fleet.work import TimedOut, lost_row, note_path, noted_unit, run_batch, time_limit

MAX_BATCH_BYTES = 64 << 20
"""Most bytes of a batch of several units: with them a worker needs about 0.5 GB."""
MIN_BATCH_BYTES = 256 << 10
"""Least bytes, so that a task takes much longer than its share of the scheduler, 2 ms."""
MAX_UNITS = 2000
"""Most units of a batch: empty files have no bytes."""
BATCHES = 1000
"""Batches of a large fleet: a kill loses a thousandth of the work for each worker."""
MAX_IN_FLIGHT = 2000
"""Most tasks that the scheduler knows at a time, however large the fleet is."""
MAX_DEATHS = 3
"""How many times workers must die at a unit until it is lost: another cause may have ended them."""
LOOK_S = 0.2
"""How often the driver shows its progress, s."""
PATIENCE_S = 15.0
"""Time for a scheduler to answer, and for its first worker to connect, s."""
WORKER_BYTES = 1 << 30
"""Memory that a worker of this machine may need; with less per core, fewer workers are started."""
LOST = "its worker died each time that it was read, perhaps out of memory"
"""Reason of a recording that kills every worker."""
SETTINGS = {
    "distributed.scheduler.allowed-failures": 1,  # tried again once: another batch may have killed the worker
    "distributed.worker.daemon": True,  # workers end with the driver, even after kill -9
    "distributed.comm.timeouts.connect": PATIENCE_S,
    "distributed.admin.tick.limit": "1 h",  # no warnings about an event loop that waited for a fit
    # A worker holds nothing between two batches, so that waiting or writing its memory to disk would not help:
    # paused workers would never resume. One that is about to exceed its share is ended.
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
}
"""Settings of Dask for the driver, and for the workers that it starts."""


def lay_out(sizes: Sequence[int]) -> list[range]:
    """The batches of a fleet, as ranges of its units.

    Args:
        sizes: Bytes of each unit, in the order of the table.
    """
    limit = min(max(sum(sizes) // BATCHES, MIN_BATCH_BYTES), MAX_BATCH_BYTES)
    first, filled, batches = 0, 0, list[range]()
    for i, size in enumerate(sizes):
        if i > first and (filled + size > limit or i - first >= MAX_UNITS):
            batches.append(range(first, i))
            first, filled = i, 0
        filled += size
    return [*batches, range(first, len(sizes))] if sizes else []


Batch = list[int]
"""Units that one task does: their indices in the fleet, ascending."""


class WorkerDied(Exception):
    """The workers of a task are gone, killed or out of memory."""


class Workers:
    """Workers that take batches and return their results, in any order."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._batches: dict[Any, Batch] = {}

    def submit(self, batch: Batch, *call: Any) -> None:
        """Start a batch: call[0] with the other arguments, on some worker."""
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
        try:
            result: Any = future.result(timeout=PATIENCE_S)
        except TimeoutError:  # its worker is busy
            self._ended.put(future)
            return None
        except CancelledError:  # forgotten: the scheduler was lost, or another one took its place
            result = []
        except Exception as error:
            result = WorkerDied() if isinstance(error, library("distributed").KilledWorker) else error
        future.release()
        return self._batches.pop(future), result

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
    dask, distributed = map(library, ("dask", "distributed"))
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(SETTINGS))
        place = address or _this_machine(stack, distributed, workers_here(tasks))
        try:
            client = stack.enter_context(distributed.Client(place, timeout=PATIENCE_S, set_as_default=False))
            if address is not None:
                client.wait_for_workers(1, timeout=PATIENCE_S)
        except (OSError, ValueError, TimeoutError) as error:
            reason = " ".join(str(error).split())[:200]
            raise BadDevice(f"--cluster must name a scheduler with workers (got {address!r}: {reason})") from None
        workers = Workers(client)
        stack.callback(workers.cancel)
        yield workers


def workers_here(tasks: int) -> int:
    """How many workers this machine has cores and memory for, at most one for each task."""
    memory = library("distributed.system").MEMORY_LIMIT
    return max(1, min(tasks, library("dask.system").CPU_COUNT, memory // WORKER_BYTES))


def _this_machine(stack: ExitStack, distributed: Any, count: int) -> Any:
    """Workers on this machine, until the stack is left."""
    folder, clusters = str(stack.enter_context(temporary_folder())), list[Any]()

    def kill() -> None:
        for worker in [one for cluster in clusters for one in list(cluster.workers.values())]:  # Dask changes them
            worker.status = distributed.Status.closing  # else Dask would start it again
        for process in active_children():
            process.kill()

    stack.enter_context(done_at_stop(kill))
    with without_interrupts():
        clusters.append(
            distributed.LocalCluster(
                threads_per_worker=1,
                n_workers=count,
                processes=True,
                dashboard_address=None,
                # Dask serves metrics on this port, as 8787 may be taken; a scheduler keeps files in a folder, too.
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0", "local_directory": folder},
                local_directory=folder,
                silence_logs=60,  # a worker that dies is handled here
                preload=[__name__],  # for dask_setup
            )
        )
    stack.callback(
        lambda: is_ending() or clusters[0].close(timeout=10.0)
    )  # a worker would finish its recording first
    return clusters[0]


def dask_setup(worker: Any) -> None:
    """What Dask calls first in a worker: leave Ctrl+C to the driver, and temporary files, as it may be killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    tempfile.tempdir = worker.local_directory


@contextmanager
def without_interrupts() -> Generator[None]:
    """Block Ctrl+C while processes are started, which inherit that: a terminal sends it to them too.

    Outside POSIX nothing is inherited.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = os.environ.get("PYTHONWARNINGS", "")
    os.environ["PYTHONWARNINGS"] = "ignore:resource_tracker:UserWarning"  # of what killed workers do not clean up
    resource_tracker.ensure_running()  # it would unblock the signal when it starts
    os.environ["PYTHONWARNINGS"] = before
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def run_fleet(
    sources: Sequence[str],
    options: FleetOptions,
    folder: Path,
    cluster: str | None = None,
    show: Callable[[Tally], None] | None = None,
) -> tuple[Tally, Fleet]:
    """Do the missing work of a fleet, and write its answer.

    It can be ended at any moment, by an exception or by kill -9: what is finished by then is kept.

    Args:
        sources: See `find_units`.
        options: The options.
        folder: Of the results; every worker must see it under this path.
        cluster: Address of a scheduler; None = the cores of this machine.
        show: Called with the tally whenever a task has ended, and a few times a second.

    Returns:
        What was done, and the fleet with its answer.

    Raises:
        BadSetting: a source names nothing, another run holds the folder, a library is missing.
        BadDevice: the scheduler cannot be reached.
        OSError: the disk is full, or the folder cannot be written; what is finished is kept.
    """
    folder = folder.absolute()
    units = find_units(sources, folder)
    with open_store(folder) as store:
        for path in folder.glob(f".{'[0-9a-f]' * 32}.note"):  # of a run that was killed
            path.unlink(missing_ok=True)
        fingerprint, settled = options.fingerprint(), store.settled()
        keys = [unit.key(fingerprint) for unit in units]
        missing = [i for i, key in enumerate(keys) if key not in settled]
        tally = Tally(len(units), len(units) - len(missing))
        if missing:
            with open_workers(cluster, len(missing)) as workers:
                _Run(units, keys, options, store, tally).do(missing, workers, show)
        table, inputs, pool = store.merged(keys)
        fleet = answer_for(devices_of(table, inputs), pool, options, folder)
        save_answer(fleet, table, store)
        return tally, fleet


@dataclass(frozen=True)
class _Run:
    """A run of batches on the workers."""

    units: Sequence[Unit]
    keys: Sequence[str]
    options: FleetOptions
    store: Store
    tally: Tally
    deaths: Counter[int] = field(default_factory=Counter[int])
    """How many times the workers of a batch died at each unit."""

    def do(self, missing: Sequence[int], workers: Workers, show: Callable[[Tally], None] | None) -> None:
        """Do these units: each until it is done, or lost."""
        batches = lay_out([self.units[i].size for i in missing])
        waiting, running, start = deque([missing[i] for i in batch] for batch in batches), 0, time.monotonic()
        while waiting or running:
            while waiting and running < MAX_IN_FLIGHT:
                batch, running = waiting.popleft(), running + 1
                units = [self.units[i] for i in batch]
                workers.submit(batch, run_batch, units, self.options, str(self.store.folder))
            if (ended := workers.ended(LOOK_S)) is not None:
                running -= 1
                waiting.extendleft(filter(None, reversed(self._rest(*ended))))
                self.tally.seconds = time.monotonic() - start
            if show is not None:
                show(self.tally)

    def _rest(self, batch: Batch, result: Any) -> list[Batch]:
        """What a batch has left to do; a unit at which a worker died is tried alone, and the others without it."""
        if isinstance(result, list):
            self._keep(cast("list[Stored]", result))
            rest = batch[len(cast("list[Stored]", result)) :]  # to two workers
            return [rest[: len(rest) // 2], rest[len(rest) // 2 :]]
        if isinstance(result, WorkerDied | TimedOut):
            keys = [self.keys[i] for i in batch]
            note = note_path(self.store.folder, keys)
            key, is_late = noted_unit(note)
            note.unlink(missing_ok=True)
            i = batch[keys.index(key)] if key in keys else batch[0]
            others = [other for other in batch if other != i]
            self.deaths[i] += 1
            if not is_late and self.deaths[i] < MAX_DEATHS:
                return [others, [i]]
            late = f"it must be read and fitted within {trimmed(time_limit(self.units[i].size))} s (got no result)"
            row = lost_row(self.units[i], late if is_late else LOST, TIMED_OUT if is_late else FAILED)
            self._keep([stored(self.keys[i], [row], Pool.empty())])
            return [others]
        if isinstance(result, ImportError):
            raise KalscopeError(
                f"every worker of --cluster must have kalscope installed, this version (got {result})"
            )
        # not a recording's fault, so the run ends; what is finished is kept
        raise result if isinstance(result, Exception) else RuntimeError(repr(result))

    def _keep(self, units: list[Stored]) -> None:
        self.store.keep(units)
        self.tally.done += len(units)
