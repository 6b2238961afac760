"""Workers: how a run begins, reports and ends on them, and that each unit is done once whatever dies."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import dask.system
import distributed.system
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.fleet.fleet_runs import PLAIN, run_here, table, write_devices
from tests.support.program import command, end, next_line
from tests.support.waiting import wait_until

from kalscope.cli.fleet import progress_text
from kalscope.common.stopping import stop_signals
from kalscope.estimation.pool import Pool
from kalscope.estimation.request import Request
from kalscope.fleet import work
from kalscope.fleet.read import FleetOptions, Piece, Unit
from kalscope.fleet.run import Tally, WorkerDied, _Run, without_interrupts, workers_here
from kalscope.fleet.store import Row, stored
from kalscope.fleet.work import note_path

GIB = 1 << 30
STARTING = """
import signal, subprocess, sys
from multiprocessing import resource_tracker
from kalscope.fleet.run import without_interrupts
shown = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ()))"
with without_interrupts():
    resource_tracker.ensure_running()  # as each process that is started does: it lets the signal through
    print(subprocess.check_output([sys.executable, "-c", shown], text=True), end="")
"""
"""Whether a process that is started meanwhile holds Ctrl+C back."""


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="nothing is inherited here")
def test_ctrl_c_while_workers_start_is_held_back_from_them_and_not_lost():
    with stop_signals() as stop:
        with without_interrupts():
            os.kill(os.getpid(), signal.SIGINT)
        wait_until(stop.is_set, "Ctrl+C")  # another thread of the process may have got it
    assert subprocess.check_output([sys.executable, "-c", STARTING], text=True) == "True\n"
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_no_more_workers_are_started_than_cores_memory_and_tasks_allow_and_progress_counts_units(monkeypatch):
    monkeypatch.setattr(dask.system, "CPU_COUNT", 64)
    for memory, tasks, workers in ((16, 1000, 16), (256, 1000, 64), (256, 3, 3), (0, 9, 1)):
        monkeypatch.setattr(distributed.system, "MEMORY_LIMIT", memory * GIB)
        assert workers_here(tasks) == workers
    assert progress_text(Tally(10, 6, done=1, seconds=2.0)) == "7 of 10 done (70 %), 6 s left"
    assert progress_text(Tally(4, 4)) == "4 of 4 done (100 %)"


@pytest.mark.slow
def test_a_straggling_batch_ends_with_its_slow_file_and_the_rest_is_shared(tmp_path, at_once, capsys, monkeypatch):
    """Three of nine are done when the time is up; the other six go to two workers, and nothing is done twice."""
    write_devices(tmp_path / "logs", 9)
    clock, plain, read = [0.0], work.fit_unit, []

    def slow(unit, asked):
        read.append(unit.id)
        clock[0] += 2 * work.MAX_SECONDS if unit.id == "dev0002.csv" else 0.0
        return plain(unit, asked)

    monkeypatch.setattr(work, "fit_unit", slow)
    monkeypatch.setattr(work, "time", SimpleNamespace(monotonic=lambda: clock[0], thread_time=time.thread_time))
    run_here(capsys, tmp_path / "logs", "-o", tmp_path / "out", *PLAIN)
    (workers,) = at_once
    assert [list(batch) for batch in workers.batches] == [list(range(9)), [3, 4, 5], [6, 7, 8]]
    assert read == [row["id"] for row in table(tmp_path / "out")]


SCANNING = """
import os
import kalscope.fleet.read as find
below = find._below
def held(*where):
    print("looks", flush=True)
    while True:
        yield from below(*where)
find._below = held
"""
"""A source that goes on for ever."""


def test_a_signal_ends_a_run_that_looks_through_its_source(tmp_path):
    write_devices(tmp_path / "logs", 2)
    with command("fleet", tmp_path / "logs", "-o", tmp_path / "out", change=SCANNING) as driver:
        assert next_line(driver) == "looks\n"
        assert end(driver, signal.SIGTERM) == (
            143,
            "",
            "kalscope: stopped by SIGTERM: what was done is kept: run the same command again to continue\n",
        )


class Draws:
    """Workers of which units of `poison` kill one; by chance others are killed, cut short or forgotten."""

    def __init__(self, poison, kills, seed):
        self.poison, self.kills, self.draw, self.flight = poison, kills, random.Random(seed), []

    def submit(self, batch, _call, units, _options, folder):
        self.flight.append((batch, [unit.id for unit in units], Path(folder)))

    def ended(self, _timeout):
        batch, keys, folder = self.flight.pop(self.draw.randrange(len(self.flight)))
        killer = next((i for i in batch if i in self.poison), self.draw.choice(batch))
        if killer in self.poison or self.draw.random() < self.kills:
            note_path(folder, keys).write_text(f"{killer}\n")
            return batch, WorkerDied()
        done = keys[: self.draw.choice([0, *range(1, len(batch) + 1)])]  # 0: the scheduler forgot it
        return batch, [stored(key, [Row(key, verdict="ok")], Pool.empty()) for key in done]


@given(st.integers(0, 60), st.sets(st.integers(0, 59), max_size=4), st.integers(), st.sampled_from([0.0, 0.3]))
def test_every_unit_is_done_once_or_is_lost_because_it_kills(n, poison, seed, kills):
    keys, units = [str(i) for i in range(n)], [Unit(str(i), (Piece("x", 1 << 25),)) for i in range(n)]
    rows, tally = [], Tally(n, 0)
    with tempfile.TemporaryDirectory() as folder:
        store = SimpleNamespace(folder=Path(folder), keep=rows.extend)
        _Run(units, keys, FleetOptions(Request()), store, tally).do(range(n), Draws(poison, kills, seed), None)
        assert not any(Path(folder).iterdir())
    verdicts = {one.key: Row(*msgspec.msgpack.decode(one.rows)[0]).verdict for one in rows}
    lost = {int(key) for key, verdict in verdicts.items() if verdict == "failed"}
    assert sorted(verdicts, key=int) == keys
    assert len(rows) == tally.done == n
    assert kills or lost == poison & set(range(n))
