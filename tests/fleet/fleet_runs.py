"""Runs of `kalscope fleet` in this process, and what they leave behind."""

from __future__ import annotations

import ctypes
import os
import signal
import sqlite3
from contextlib import closing

import numpy as np
from tests.support.forked import fork_server
from tests.support.hostile_case import Seen, in_child

from kalscope.cli.app import run as kalscope
from kalscope.fleet import work
from kalscope.fleet.run import WorkerDied

PLAIN = ["--momentum", "0", "--no-robust"]
"""Options of a quick run."""
RNG = np.random.default_rng(11)


def write_devices(folder, count, n=200, comment=0):
    """Files of devices of one kind, longer by so many characters that cost nothing to read."""
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(count):
        z = np.cumsum(0.3 * RNG.normal(size=n)) + RNG.normal(size=n)
        rows = (f"{k / 100:.2f},{value:.5f}\n" for k, value in enumerate(z))
        (folder / f"dev{i:04d}.csv").write_text(f"# {'x' * comment}\ntime (s),light (lx)\n" + "".join(rows))


def table(folder, *without):
    """The table as a list of rows, without the time that they took and these columns."""
    import pyarrow.parquet as pq

    return pq.ParquetFile(folder / "fleet.parquet").read().drop_columns(["seconds", *without]).to_pylist()


ANSWER = {"units.sqlite", "fleet.parquet", "fleet.json", "tuning.toml"}
"""Names of the files of a finished fleet."""


def files_of(folder):
    return {path.name for path in folder.rglob("*") if path.is_file()}


def kept(folder):
    """How many units the database holds; no run may have it open."""
    with closing(sqlite3.connect(folder / "units.sqlite")) as database:
        return database.execute("SELECT count(*) FROM units").fetchone()[0]


class AtOnce:
    """Workers of this process: a batch is done when its result is wanted."""

    def __init__(self):
        self.flight, self.batches = [], []

    def submit(self, batch, *call):
        self.flight.append((batch, call))
        self.batches.append(batch)

    def ended(self, _timeout):
        batch, (function, *rest) = self.flight.pop(0)
        return batch, function(*rest)


class InProcesses(AtOnce):
    """Workers that do each batch in a process of its own, which the batch may end."""

    def ended(self, _timeout):
        batch, call = self.flight.pop(0)
        done = in_child(fork_server(), done_by_hanging_worker, *call)
        return batch, WorkerDied() if isinstance(done, Seen) else done


def done_by_hanging_worker(function, units, *rest):
    """A call in a worker that hangs at a unit named "hangs…", in C, and is killed at one named "kills…".

    The time limit of a unit is in proportion to its bytes.
    """
    plain, work.FULL_BYTES, work.DEVICE_LIMIT_S = work.fit_unit, 1, 0.5

    def fit(unit, asked):
        if unit.id.startswith("hangs"):
            ctypes.PyDLL(None).pause()
        if unit.id.startswith("kills"):
            os.kill(os.getpid(), signal.SIGKILL)
        return plain(unit, asked)

    work.fit_unit = fit
    return function(units, *rest)


def run_here(capsys, *argv, expect=0):
    assert kalscope(["fleet", *map(str, argv)]) == expect
    return capsys.readouterr()
