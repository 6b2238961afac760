"""Whole runs: every file accounted for, only what is missing done, each id once whatever dies.

What needs no process has workers that do a batch at once, in this process; the rest runs as a user starts it.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import dask.system
import distributed
import msgspec
import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.fleet.fleet_runs import ANSWER, PLAIN, InProcesses, files_of, kept, run_here, table, write_devices
from tests.support.forked import Forked
from tests.support.program import command, end, next_line
from tests.support.waiting import PATIENCE, wait_until

from kalscope.cli.app import run as kalscope
from kalscope.cli.fleet import progress_text
from kalscope.common.stopping import stop_signals
from kalscope.errors import BadSetting
from kalscope.estimation.pool import Pool
from kalscope.estimation.request import Request
from kalscope.fleet import run, work
from kalscope.fleet.read import FleetOptions, Piece, Unit
from kalscope.fleet.store import STORE, Row, open_store, stored

LOST = "lag_loss_samples", "noise_loss_db", "error_growth"
"""What each loses by the filter for all, which is another one where a device is."""


@pytest.mark.slow
def test_a_rerun_does_only_what_is_missing_or_changed(tmp_path, at_once, capsys):
    logs, out = tmp_path / "logs", tmp_path / "out"
    write_devices(logs, 12)
    run_here(capsys, logs, "-o", out, *PLAIN)
    whole = {row["id"]: row for row in table(out, *LOST)}
    (logs / "dev0007.csv").write_text("time (s),light (lx)\n0.0,1\n0.1,5\n0.2,2\n")
    (logs / "dev0008.csv").unlink()
    write_devices(logs / "new", 1)
    assert "; 2 of 12 files or row groups done" in run_here(capsys, logs, "-o", out, *PLAIN).out
    rows = {row["id"]: row for row in table(out, *LOST)}
    assert rows.pop("dev0007.csv")["samples"] == 3
    assert rows.pop("new/dev0000.csv")["samples"] == 200
    assert rows == {name: row for name, row in whole.items() if name not in ("dev0007.csv", "dev0008.csv")}
    again = run_here(capsys, logs, "-o", out, *PLAIN).out
    assert again.startswith("12 rows: 11 with q and r, 1 without; nothing was missing\n")
    assert "; 12 of 12 files" in run_here(capsys, logs, "-o", out, "--lag-ms", "50").out
    assert {row["verdict"] for row in table(out)} == {"chosen"}


@pytest.mark.slow
def test_the_options_of_tune_hold_for_every_recording_and_a_goal_needs_a_sample_period(tmp_path, at_once, capsys):
    write_devices(tmp_path / "logs", 3)
    run_here(capsys, tmp_path / "logs", "-o", tmp_path / "out", "--lag-ms", "30", "--rate", "200", "--gate", "9")
    for row in table(tmp_path / "out"):
        assert row["rate_hz"] == pytest.approx(200.0)
        assert row["lag_samples"] == pytest.approx(6.0)
        assert row["gate"] == 9.0
    refused = run_here(capsys, tmp_path / "logs", "-o", tmp_path / "out", "--channel", "dark")
    assert "3 × channel must be one of light (got 'dark')" in refused.out
    (tmp_path / "a.csv").write_text("1\n3\n2\n4\n" * 9)
    printed = run_here(capsys, tmp_path / "a.csv", "-o", tmp_path / "out", "--lag-ms", "50").out
    reason = "a lag of 50 ms needs the time between two samples: give --sample-period (got none)"
    assert f"1 × {reason}\nNo filter for all: {reason}\n" in printed


TIMED_OUT = "timed_out", "it must be read and fitted within 0.5 s (got no result)"


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="pause() is of POSIX")
def test_a_device_that_hangs_in_c_or_is_killed_is_a_row_and_others_are_done(tmp_path, at_once, capsys, monkeypatch):
    logs, out = tmp_path / "logs", tmp_path / "out"
    write_devices(logs, 2)
    for name in ("hangs0.csv", "hangs1.csv", "kills.csv"):
        (logs / name).write_text("1")
    with monkeypatch.context() as patch:
        patch.setattr(run, "open_workers", lambda *_: nullcontext(InProcesses()))
        patch.setattr(work, "DEVICE_LIMIT_S", 0.5)
        patch.setattr(work, "FULL_BYTES", 1)
        printed = run_here(capsys, logs, "-o", out, *PLAIN).out
    rows = {row["id"]: (row["verdict"], row["reason"]) for row in table(out) if row["reason"]}
    assert rows == {"hangs0.csv": TIMED_OUT, "hangs1.csv": TIMED_OUT, "kills.csv": ("failed", run.LOST)}
    assert printed.startswith("5 rows: 2 with q and r, 3 failed; 5 of 5 files or row groups done")
    assert files_of(out) == ANSWER
    assert "; 3 of 5 files or row groups done" in run_here(capsys, logs, "-o", out, *PLAIN).out  # tried again
    assert {row["verdict"] for row in table(out) if row["reason"]} == {"failed"}


@pytest.mark.slow
def test_what_failed_is_tried_again_and_nothing_else(tmp_path, at_once, capsys, monkeypatch):
    h5py = pytest.importorskip("h5py")
    logs, out = tmp_path / "logs", tmp_path / "out"
    write_devices(logs, 5)
    (logs / "empty.csv").write_text("")
    with h5py.File(logs / "a.h5", "w") as file:
        file["value"] = [float(abs(i % 90 - 45) + i % 7) for i in range(300)]
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "h5py", None)
        run_here(capsys, logs, "-o", out, *PLAIN)
        assert "pip install" in table(out)[0]["reason"]
        assert "; 2 of 7 files" in run_here(capsys, logs, "-o", out, *PLAIN).out
    assert "; 2 of 7 files" in run_here(capsys, logs, "-o", out, *PLAIN).out
    assert {row["id"] for row in table(out) if row["reason"]} == {"empty.csv"}
    (logs / "empty.csv").unlink()
    assert "nothing was missing" in run_here(capsys, logs, "-o", out, *PLAIN).out
    assert kept(out) == 6  # no trace of the failures


def mounted(*argv):
    return subprocess.run(["mount", "-t", "tmpfs", *argv], capture_output=True).returncode == 0


@pytest.mark.skipif(sys.platform != "linux" or os.geteuid() != 0, reason="only root may mount a file system")
def test_a_disk_that_is_full_is_said_and_the_run_goes_on_when_there_is_room(tmp_path, at_once, capsys):
    logs, out = tmp_path / "logs", tmp_path / "disk" / "out"
    write_devices(logs, 30, n=40, comment=20_000)
    out.parent.mkdir()
    if not mounted("-o", "size=128k", "tmpfs", out.parent):
        pytest.skip("no file system can be mounted here")
    try:
        for _ in range(2):
            full = run_here(capsys, logs, "-o", out, *PLAIN, expect=2).err
            assert full.startswith("kalscope: ")
            assert full.endswith("the disk is full\n")
            assert files_of(out) == {"units.sqlite"}
        done = kept(out)
        assert 0 < done < 30
        assert mounted("-o", "remount,size=8m", "tmpfs", out.parent)
        printed = run_here(capsys, logs, "-o", out, *PLAIN).out
        assert f"; {30 - done} of 30 files or row groups done" in printed
        assert [row["id"] for row in table(out)] == sorted(path.name for path in logs.iterdir())
    finally:
        subprocess.run(["umount", out.parent], check=True)


# ---- on Dask


@pytest.fixture(scope="module")
def devices(tmp_path_factory):
    """Files in 20 batches."""
    folder = tmp_path_factory.mktemp("fleet")
    write_devices(folder, 40, n=60, comment=130_000)
    return folder


@pytest.fixture(scope="module")
def whole(devices, tmp_path_factory):
    """The table of an undisturbed run over them, on a scheduler that is named by its address."""
    out = tmp_path_factory.mktemp("whole")
    with distributed.LocalCluster(
        n_workers=1,
        threads_per_worker=1,
        processes=False,
        protocol="tcp://",
        silence_logs=60,
        dashboard_address=None,
        scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
    ) as other:
        there = ["--cluster", other.scheduler_address]
        assert kalscope(["fleet", str(devices), "-o", str(out), *there, *PLAIN]) == 0
    return table(out)


DRIVER = """
import os, time
import dask.system
from kalscope.fleet import run
os.setsid()  # signals to all of its processes reach no other
dask.system.CPU_COUNT = 2
rest = run._Run._rest
def waits(self, *ended):
    left = rest(self, *ended)
    while os.path.exists("killed") and not os.path.exists("go on"):
        time.sleep(0.01)
    return left
run._Run._rest = waits
"""
"""A run with two workers that waits for a file once one of them was killed and a batch has ended."""


def workers_of(driver):
    """The processes below the driver that run tasks."""
    try:
        below = psutil.Process(driver.pid).children(recursive=True)
        return [one for one in below if "spawn_main" in " ".join(one.cmdline())]
    except psutil.Error:  # one ended meanwhile
        return []


@pytest.mark.slow
def test_a_killed_worker_another_run_and_ctrl_c_change_nothing(
    tmp_path, devices, whole, at_once, capsys, monkeypatch
):
    (tmp_path / "tmp").mkdir()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    assert [row["id"] for row in whole] == sorted(path.name for path in devices.iterdir())
    out = tmp_path / "out"
    with command("fleet", devices, "-o", out, *PLAIN, cwd=tmp_path, change=DRIVER) as driver:
        wait_until(lambda: (out / STORE).exists() and (out / STORE).stat().st_size > EMPTY, "a batch")
        workers = wait_until(lambda: workers_of(driver))
        (tmp_path / "killed").touch()
        workers[0].kill()
        second = run_here(capsys, devices, "-o", out, *PLAIN, expect=2)
        assert second.err.startswith("kalscope: -o must name a folder that no other run writes (got ")
        assert second.err.count("\n") == 1
        below = psutil.Process(driver.pid).children(recursive=True)
        os.killpg(driver.pid, signal.SIGINT)  # a terminal sends it to every process
        (tmp_path / "go on").touch()
        stdout, stderr = driver.communicate(timeout=PATIENCE)
        assert (driver.returncode, stdout) == (130, "")
    assert psutil.wait_procs(below, timeout=PATIENCE)[1] == []
    assert stderr.startswith("kalscope: stopped by Ctrl+C: ")
    assert stderr.endswith("run the same command again to continue\n")
    assert stderr.count("\n") == 1, stderr
    assert [*(tmp_path / "tmp").iterdir()] == []
    assert not (out / "fleet.parquet").exists()
    done = kept(out)
    assert 0 < done < 40
    (out / f".{'0' * 32}.note").write_text("of a run that was killed")
    assert f"; {40 - done} of 40 files" in run_here(capsys, devices, "-o", out, *PLAIN).out
    assert table(out) == whole
    assert files_of(out) == ANSWER


EMPTY = 20480
"""Bytes of a database without units."""
HOLDER = """
import time
from pathlib import Path
from kalscope.estimation.pool import Pool
from kalscope.fleet.run import open_workers
from kalscope.fleet.store import Row, open_store, stored
def units():
    yield from [stored(f"{i}", [Row("a", verdict="ok")] * 1000, Pool.empty()) for i in range(100)]
    print("held", flush=True)
    time.sleep(1e6)
with open_store(Path()) as store, open_workers(None, 1):
    store.keep([stored("k", [Row("a", verdict="ok")], Pool.empty())])
    store.keep(units())
"""


def test_a_killed_driver_leaves_whole_batches_no_worker_and_no_lock(tmp_path):
    with Forked(HOLDER, tmp_path, os.environ) as driver:
        assert next_line(driver) == "held\n"
        with pytest.raises(BadSetting, match="no other run writes") as refused, open_store(tmp_path):
            pass
        assert "\n" not in str(refused.value)
        below = psutil.Process(driver.pid).children(recursive=True)
        assert workers_of(driver)
    _, alive = psutil.wait_procs(below, timeout=PATIENCE)
    assert alive == []
    with open_store(tmp_path) as store:
        assert store.settled() == {"k"}


@pytest.mark.slow
def test_a_scheduler_that_does_not_answer_is_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(run, "PATIENCE_S", 0.1)
    write_devices(tmp_path / "logs", 1)
    nobody = "tcp://127.0.0.1:9"
    done = run_here(capsys, tmp_path / "logs", "-o", tmp_path / "out", "--cluster", nobody, expect=2)
    assert done.err.startswith(f"kalscope: --cluster must name a scheduler with workers (got '{nobody}'")
    assert done.err.count("\n") == 1


# ---- how a run begins, reports and ends on workers


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
        with run.without_interrupts():
            os.kill(os.getpid(), signal.SIGINT)
        wait_until(stop.is_set, "Ctrl+C")  # another thread of the process may have got it
    assert subprocess.check_output([sys.executable, "-c", STARTING], text=True) == "True\n"
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_no_more_workers_are_started_than_cores_memory_and_tasks_allow_and_progress_counts_units(monkeypatch):
    monkeypatch.setattr(dask.system, "CPU_COUNT", 64)
    for memory, tasks, workers in ((16, 1000, 16), (256, 1000, 64), (256, 3, 3), (0, 9, 1)):
        monkeypatch.setattr(distributed.system, "MEMORY_LIMIT", memory << 30)
        assert run.workers_here(tasks) == workers
    assert progress_text(run.Tally(10, 6, done=1, seconds=2.0)) == "7 of 10 done (70 %), 6 s left"
    assert progress_text(run.Tally(4, 4)) == "4 of 4 done (100 %)"


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
            work.note_path(folder, keys).write_text(f"{killer}\n")
            return batch, run.WorkerDied()
        done = keys[: self.draw.choice([0, *range(1, len(batch) + 1)])]  # 0: the scheduler forgot it
        return batch, [stored(key, [Row(key, verdict="ok")], Pool.empty()) for key in done]


@given(st.integers(0, 60), st.sets(st.integers(0, 59), max_size=4), st.integers(), st.sampled_from([0.0, 0.3]))
def test_every_unit_is_done_once_or_is_lost_because_it_kills(n, poison, seed, kills):
    keys, units = [str(i) for i in range(n)], [Unit(str(i), (Piece("x", 1 << 25),)) for i in range(n)]
    rows, tally = [], run.Tally(n, 0)
    with tempfile.TemporaryDirectory() as folder:
        store = SimpleNamespace(folder=Path(folder), keep=rows.extend)
        run._Run(units, keys, FleetOptions(Request()), store, tally).do(range(n), Draws(poison, kills, seed), None)
        assert not any(Path(folder).iterdir())
    verdicts = {one.key: Row(*msgspec.msgpack.decode(one.rows)[0]).verdict for one in rows}
    lost = {int(key) for key, verdict in verdicts.items() if verdict == "failed"}
    assert sorted(verdicts, key=int) == keys
    assert len(rows) == tally.done == n
    assert kills or lost == poison & set(range(n))
