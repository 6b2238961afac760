"""A fleet from its sources to its table: what is missing is done on Dask, then all parts are merged."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from kalscope.common.text import trimmed
from kalscope.errors import BadSetting, KalscopeError
from kalscope.estimation.fleet.pool import Pool
from kalscope.tuning.fleet.batches import Batch, Dispatcher, lay_out, window
from kalscope.tuning.fleet.cluster import TaskLost, WorkerDied, Workers, open_workers
from kalscope.tuning.fleet.recordings.find import find_units
from kalscope.tuning.fleet.recordings.unit import Unit
from kalscope.tuning.fleet.store.begun import check_own, note_begun
from kalscope.tuning.fleet.store.lock import locked
from kalscope.tuning.fleet.store.merge import merge
from kalscope.tuning.fleet.store.parts import find_parts, note_path, sweep, write_part
from kalscope.tuning.fleet.store.row import FAILED, TIMED_OUT
from kalscope.tuning.fleet.work.asked import Asked
from kalscope.tuning.fleet.work.deadline import TimedOut, time_limit, unit_in_note
from kalscope.tuning.fleet.work.task import Done, lost_row, run_batch

LOOK_S = 0.2
"""How often the driver shows its progress, s."""
LOST = "its worker died each time that it was read, perhaps out of memory"
"""Reason of a recording that kills every worker."""


def too_slow(limit: float) -> str:
    """Reason of a recording that took longer than its limit, s."""
    return f"it must be read and fitted within {trimmed(limit)} s (got no result): --device-limit allows more"


@dataclass
class Tally:
    """What a run has done so far."""

    units: int
    """Units of the fleet."""
    kept: int
    """Units that an earlier run had done."""
    bytes: int
    """Bytes of all units."""
    kept_bytes: int
    """Bytes of those that an earlier run had done."""
    done: int = 0
    """Units done."""
    done_bytes: int = 0
    """Their bytes."""
    rows: int = 0
    """Rows written."""
    again: int = 0
    """Units that failed for a reason outside of them, for which the next run tries them again."""
    fitting_s: float = 0.0
    """Processor time of the fits, s."""
    total_s: float = 0.0
    """Processor time of the tasks, s."""
    peak_bytes: int = 0
    """Most memory that a worker has used, bytes."""
    deaths: int = 0
    """Batches whose worker died."""
    threads: int = 0
    """Tasks that ran at a time."""
    begun: float = 0.0
    """When the first batch began, s of the monotonic clock."""
    seconds: float = 0.0
    """How long the batches took, s."""

    @classmethod
    def at_start(cls, units: Sequence[Unit], missing: Sequence[Sequence[int]]) -> Tally:
        """The tally before the first of the missing batches, each the indices of its units."""
        todo, whole = [i for batch in missing for i in batch], sum(unit.size for unit in units)
        return cls(len(units), len(units) - len(todo), whole, whole - sum(units[i].size for i in todo))

    def add(self, done: Done, size: int) -> None:
        """Count a task over `size` bytes."""
        self.done += done.units
        self.done_bytes += size
        self.rows += done.rows
        self.again += done.again
        self.fitting_s += done.fitting_s
        self.total_s += done.total_s
        self.peak_bytes = max(self.peak_bytes, done.peak_bytes)
        self.seconds = time.monotonic() - self.begun


OnTally = Callable[[Tally], None]


def run_fleet(
    sources: Sequence[str],
    asked: Asked,
    folder: Path,
    cluster: str | None = None,
    show: OnTally | None = None,
    finish: Callable[[Pool], None] | None = None,
    looked: Callable[[int], None] | None = None,
) -> Tally:
    """Do the missing work of a fleet, and merge its table.

    It can be ended at any moment, by an exception or by kill -9: what is finished by then is kept.

    Args:
        sources: See `find_units`.
        asked: The options.
        folder: Of the results; every worker must see it under this path.
        cluster: Address of a scheduler; None = the cores of this machine.
        show: Called with the tally whenever a task has ended, and a few times a second.
        finish: Called once the table is written, with what the fleet says about one filter for all, while no other
            run may write into the folder.
        looked: Called with the number of files found so far, while the sources are scanned.

    Returns:
        What was done.

    Raises:
        BadSetting: a source names nothing, another run holds the folder, a library is missing, or what was
            finished has been removed from the folder meanwhile.
        BadDevice: the scheduler cannot be reached.
        OSError: the disk is full, or the folder cannot be written; what is finished is kept.
    """
    folder = folder.absolute()
    with locked(folder):
        check_own(folder)
        sweep(folder)
        if looked is not None:
            looked(0)
        units = find_units(sources, folder, asked.row_groups, looked)
        options = asked.fingerprint()
        note_begun(folder, len(units), options, asked.reading, asked.sample_period, pooled=asked.is_pooled)
        keys = [unit.key(options) for unit in units]
        settled = find_parts(folder, settled=True)
        batches = lay_out([unit.size for unit in units])
        missing = [[i for i in batch if keys[i] not in settled] for batch in batches]
        tally = Tally.at_start(units, missing)
        if any(missing):
            with open_workers(cluster, sum(map(bool, missing))) as workers:
                _Run(units, keys, asked, folder, tally).all_of(missing, workers, show)
        parts = find_parts(folder)
        if (gone := sum(key not in parts for key in keys)) > 0:
            raise BadSetting(f"-o must name a folder that nothing else changes ({gone} finished units are gone)")
        sweep(folder, {parts[key] for key in keys})
        pool = merge(folder, [[keys[i] for i in batch] for batch in batches], parts)
        if finish is not None:
            finish(pool)
        return tally


@dataclass(frozen=True)
class _Run:
    """A run of batches on the workers."""

    units: Sequence[Unit]
    keys: Sequence[str]
    asked: Asked
    folder: Path
    tally: Tally

    def all_of(self, missing: Sequence[Sequence[int]], workers: Workers, show: OnTally | None) -> None:
        """Do the units, given batch by batch."""
        jobs, tally = Dispatcher.of(missing), self.tally
        tally.begun, tally.threads = time.monotonic(), workers.threads
        while jobs.active:
            limit = window(max(tally.threads, workers.threads))
            while len(jobs.running) < limit and (batch := jobs.next()) is not None:
                workers.submit(batch, run_batch, [self.units[i] for i in batch.units], self.asked, str(self.folder))
            ended = workers.ended(LOOK_S)
            if ended is not None:
                batch, result = ended
                if isinstance(result, Done):
                    tally.add(result, sum(self.units[i].size for i in batch.units[: result.units]))
                    jobs.finished(batch, batch.units[result.units :])
                elif isinstance(result, WorkerDied | TimedOut):
                    tally.deaths += 1
                    self._died(jobs, batch)
                elif isinstance(result, TaskLost):
                    jobs.returned(batch)
                else:
                    raise _not_of_one_recording(result)
                while jobs.lost:
                    self._give_up(jobs.lost.pop(), LOST)
            if show is not None:
                show(tally)

    def _died(self, jobs: Dispatcher, batch: Batch) -> None:
        """A batch whose worker has died: if a unit took too long, it has its row, and the others go on."""
        keys = [self.keys[i] for i in batch.units]
        slow = unit_in_note(self.folder, keys)
        if slow not in keys:
            jobs.died(batch)
            return
        i = batch.units[keys.index(slow)]
        limit = time_limit(self.units[i].size, self.asked.device_limit)
        self._give_up(i, too_slow(limit), TIMED_OUT)
        note_path(self.folder, keys).unlink(missing_ok=True)
        jobs.finished(batch, [other for other in batch.units if other != i])

    def _give_up(self, i: int, reason: str, verdict: str = FAILED) -> None:
        """A row for a unit that has none of its worker."""
        key, row = self.keys[i], lost_row(self.units[i], reason, verdict)
        write_part(self.folder, {key: ([row], Pool.empty())}, [key])
        self.tally.done += 1
        self.tally.again += 1
        self.tally.done_bytes += self.units[i].size
        self.tally.rows += 1


def _not_of_one_recording(error: object) -> Exception:
    """What a task raised: not a recording's fault, so the run ends; what is finished is kept."""
    if isinstance(error, KalscopeError | OSError):
        return error
    if isinstance(error, ImportError):
        return KalscopeError(f"every worker of --cluster must have kalscope installed, this version (got {error})")
    return error if isinstance(error, Exception) else RuntimeError(repr(error))
