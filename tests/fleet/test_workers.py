"""How a run begins, reports and ends on its workers."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import dask.system
import distributed.system
import pytest
from tests.fleet.fleet_runs import PLAIN, run_here, table, write_devices
from tests.support.program import command, end, next_line
from tests.support.waiting import wait_until

from kalscope.cli.fleet import progress_text
from kalscope.common.stopping import stop_signals
from kalscope.fleet import work
from kalscope.fleet.results import Tally
from kalscope.fleet.run import without_interrupts, workers_here

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


def test_no_more_workers_are_started_than_cores_memory_and_tasks_allow(monkeypatch):
    monkeypatch.setattr(dask.system, "CPU_COUNT", 64)
    for memory, tasks, workers in ((16, 1000, 16), (256, 1000, 64), (256, 3, 3), (0, 9, 1)):
        monkeypatch.setattr(distributed.system, "MEMORY_LIMIT", memory * GIB)
        assert workers_here(tasks) == workers


def test_progress_counts_what_was_kept_in_both_numbers():
    assert progress_text(Tally(10, 6, done=1, seconds=2.0)) == "7 of 10 done (70 %), 6 s left"
    assert progress_text(Tally(4, 4)) == "4 of 4 done (100 %)"


@pytest.mark.slow
def test_a_straggling_batch_ends_with_its_slow_recording_and_the_rest_is_shared_out(
    tmp_path, at_once, capsys, monkeypatch
):
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
