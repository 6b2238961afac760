"""Whole runs, as a user starts them: every file accounted for, and each id once whatever dies."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from required import not_here
from waiting import PATIENCE, wait_until

try:
    import distributed  # noqa: F401
    import psutil
    import pyarrow.parquet as pq
except ImportError:
    not_here("dask, distributed or pyarrow is not installed")

SHARED_DATA = Path(__file__).parents[4] / "shared" / "data"
PROGRAM = [sys.executable, "-m", "kalscope.cli", "fleet"]
PLAIN = ["--momentum", "0", "--no-robust"]
RNG = np.random.default_rng(11)


def write_devices(folder, count, n=200):
    """Files of devices of one kind."""
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(count):
        z = np.cumsum(0.3 * RNG.normal(size=n)) + RNG.normal(size=n)
        rows = (f"{k / 100:.2f},{value:.5f}\n" for k, value in enumerate(z))
        (folder / f"dev{i:04d}.csv").write_text("time (s),light (lx)\n" + "".join(rows))


def run(*argv, expect=0):
    done = subprocess.run([*PROGRAM, *map(str, argv)], capture_output=True, text=True, timeout=10 * PATIENCE)
    assert done.returncode == expect, done.stderr
    return done


def start(*argv):
    return subprocess.Popen(
        [*PROGRAM, *map(str, argv)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def table(folder):
    """The table as a list of rows without the time that they took."""
    return pq.ParquetFile(folder / "fleet.parquet").read().drop_columns(["seconds"]).to_pylist()


def parts(folder):
    return sorted((folder / "parts").glob("??/*.parquet"))


def leftovers(folder):
    return [path.name for path in folder.rglob("*") if path.name.endswith(".tmp")]


def workers_of(driver):
    """The processes below the driver that run tasks."""
    try:
        below = psutil.Process(driver.pid).children(recursive=True)
        return [one for one in below if "spawn_main" in " ".join(one.cmdline())]
    except psutil.Error:
        return []


@pytest.fixture(scope="module")
def devices(tmp_path_factory):
    """400 files, and the table of an undisturbed run over them."""
    folder = tmp_path_factory.mktemp("fleet")
    write_devices(folder / "logs", 400)
    run(folder / "logs", "-o", folder / "whole", *PLAIN)
    return folder / "logs", table(folder / "whole")


@pytest.mark.slow
def test_every_file_is_accounted_for(tmp_path):
    """Twenty real recordings and generated ones, an empty file, a picture, an unreadable file, a folder x.csv."""
    logs = tmp_path / "logs"
    write_devices(logs, 30)
    real = sorted(path for path in SHARED_DATA.rglob("*.csv") if path.stat().st_size < 200_000)[:20]
    for i, path in enumerate(real):
        shutil.copy(path, logs / f"real{i:02d}.csv")
    (logs / "empty.csv").write_text("")
    (logs / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)))
    (logs / "x.csv").mkdir()
    os.symlink(tmp_path / "nowhere", logs / "gone.csv")
    (logs / "locked.csv").write_text("1\n2\n3\n")
    (logs / "locked.csv").chmod(0)  # root reads it all the same: it has a row in both cases
    done = run(logs, "-o", tmp_path / "out", *PLAIN)
    rows = {row["id"]: row for row in table(tmp_path / "out")}
    assert set(rows) == {path.name for path in logs.iterdir()}
    assert all((row["q"] is None) == bool(row["reason"]) for row in rows.values())
    said = {"empty.csv": "empty file", "picture.png": "PNG image", "x.csv": "is empty", "gone.csv": "No such"}
    for name, reason in said.items():
        assert rows[name]["verdict"] == "failed"
        assert reason in rows[name]["reason"]
    assert f"{len(rows)} rows" in done.stdout
    assert "1 × picture.png must be a text file (got a PNG image)" in done.stdout


@pytest.mark.slow
def test_a_rerun_does_only_what_is_missing_or_changed(tmp_path, devices):
    logs, whole = devices
    shutil.copytree(logs, tmp_path / "logs")
    out = tmp_path / "out"
    run(tmp_path / "logs", "-o", out, *PLAIN)
    assert table(out) == whole
    before = set(parts(out))
    (tmp_path / "logs" / "dev0007.csv").write_text("time (s),light (lx)\n0.0,1\n0.1,5\n0.2,2\n")
    (tmp_path / "logs" / "dev0008.csv").unlink()
    write_devices(tmp_path / "logs" / "new", 1)
    done = run(tmp_path / "logs", "-o", out, *PLAIN)
    assert "2 of 400 files or row groups read" in done.stdout
    assert len(set(parts(out)) - before) <= 2
    rows = {row["id"]: row for row in table(out)}
    assert rows["dev0007.csv"]["samples"] == 3
    assert "dev0008.csv" not in rows
    assert rows["new/dev0000.csv"]["samples"] == 200
    same = [row for row in whole if row["id"] not in ("dev0007.csv", "dev0008.csv")]
    assert [rows[row["id"]] for row in same] == same
    assert "nothing was missing" in run(tmp_path / "logs", "-o", out, *PLAIN).stdout
    assert "400 of 400 files or row groups read" in run(tmp_path / "logs", "-o", out, "--lag-ms", "50").stdout


@pytest.mark.slow
def test_killed_workers_and_a_killed_driver_change_nothing(tmp_path, devices):
    logs, whole = devices
    out = tmp_path / "out"
    driver = start(logs, "-o", out, *PLAIN)
    for wanted in (1, 4):
        wait_until(lambda wanted=wanted: len(parts(out)) >= wanted and workers_of(driver), "a part and a worker")
        workers_of(driver)[0].kill()
    wait_until(lambda: len(parts(out)) >= 6, "six parts")
    below = psutil.Process(driver.pid).children(recursive=True)
    driver.kill()
    driver.communicate()
    psutil.wait_procs(below, timeout=PATIENCE)
    assert not any(one.is_running() for one in below), "workers outlive the driver"
    kept = len(parts(out))
    (parts(out)[0].parent / ".x.parquet.kalscope-0123456789abcdef.tmp").write_bytes(b"torn")
    run(logs, "-o", out, *PLAIN)
    assert table(out) == whole
    assert leftovers(out) == []
    assert len(parts(out)) >= kept


@pytest.mark.slow
def test_ctrl_c_stops_and_says_how_to_go_on(tmp_path, devices):
    logs, whole = devices
    out = tmp_path / "out"
    driver = start(logs, "-o", out, *PLAIN)
    wait_until(lambda: parts(out), "the first part")
    os.killpg(driver.pid, signal.SIGINT)  # a terminal sends it to every process
    stdout, stderr = driver.communicate(timeout=PATIENCE)
    assert driver.returncode == 130
    assert stdout == ""
    assert stderr.startswith("kalscope: stopped with ")
    assert stderr.endswith("run the same command again to go on\n")
    assert stderr.count("\n") == 1, stderr
    assert not (out / "fleet.parquet").exists()
    run(logs, "-o", out, *PLAIN)
    assert table(out) == whole


@pytest.mark.slow
def test_a_second_run_into_the_same_folder_is_refused(tmp_path, devices):
    logs, whole = devices
    out = tmp_path / "out"
    first = start(logs, "-o", out, *PLAIN)
    wait_until(lambda: parts(out), "the first part")
    second = run(logs, "-o", out, *PLAIN, expect=2)
    assert second.stderr.startswith("kalscope: -o must name a folder that no other run writes (got ")
    assert f"process {first.pid} on " in second.stderr
    assert second.stderr.count("\n") == 1
    assert first.wait(timeout=PATIENCE) == 0
    assert table(out) == whole


SCHEDULER = """
import sys
from distributed import LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=60) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""


@pytest.mark.slow
def test_the_workers_of_another_scheduler_do_the_same(tmp_path, devices):
    logs, whole = devices
    (tmp_path / "scheduler.py").write_text(SCHEDULER)
    command = [sys.executable, str(tmp_path / "scheduler.py")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        address = other.stdout.readline().strip()
        run(logs, "-o", tmp_path / "out", "--cluster", address, *PLAIN)
        other.stdin.close()
    assert table(tmp_path / "out") == whole


@pytest.mark.slow
def test_a_scheduler_that_does_not_answer_is_named(tmp_path):
    write_devices(tmp_path / "logs", 1)
    done = run(tmp_path / "logs", "-o", tmp_path / "out", "--cluster", "tcp://127.0.0.1:9", expect=2)
    assert done.stderr.startswith("kalscope: --cluster must name a scheduler with workers (got 'tcp://127.0.0.1:9'")
    assert done.stderr.count("\n") == 1
