"""A device that hangs or is killed, and a full disk, end no run; a rerun does what failed and nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import contextmanager, nullcontext

import pytest
from tests.fleet.fleet_runs import ANSWER, PLAIN, InProcesses, files_of, kept, run_here, table, write_devices

from kalscope.fleet import run as fleet_run
from kalscope.fleet import work
from kalscope.fleet.run import LOST

TIMED_OUT = "timed_out", "it must be read and fitted within 0.5 s (got no result)"


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="pause() is of POSIX")
def test_a_device_that_hangs_in_c_or_is_killed_is_a_row_and_others_are_done(tmp_path, at_once, capsys, monkeypatch):
    logs, out = tmp_path / "logs", tmp_path / "out"
    write_devices(logs, 2)
    for name in ("hangs0.csv", "hangs1.csv", "kills.csv"):
        (logs / name).write_text("1")
    with monkeypatch.context() as patch:
        patch.setattr(fleet_run, "open_workers", lambda *_: nullcontext(InProcesses()))
        patch.setattr(work, "DEVICE_LIMIT_S", 0.5)
        patch.setattr(work, "FULL_BYTES", 1)
        said = run_here(capsys, logs, "-o", out, *PLAIN)
    rows = {row["id"]: (row["verdict"], row["reason"]) for row in table(out) if row["reason"]}
    assert rows == {"hangs0.csv": TIMED_OUT, "hangs1.csv": TIMED_OUT, "kills.csv": ("failed", LOST)}
    assert said.out.startswith("5 rows: 2 with q and r, 3 failed; 5 of 5 files or row groups done")
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


@contextmanager
def disk_of(folder, kilobytes):
    """A file system of this size at the folder; the test is skipped where it cannot be mounted."""
    folder.mkdir()
    argv = ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(folder)]
    if sys.platform != "linux" or os.geteuid() != 0 or subprocess.run(argv, capture_output=True).returncode:
        pytest.skip("only root may mount a file system")
    try:
        yield
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def test_a_disk_that_is_full_is_said_and_the_run_goes_on_when_there_is_room(tmp_path, at_once, capsys):
    logs, disk = tmp_path / "logs", tmp_path / "disk"
    write_devices(logs, 30, n=40, comment=20_000)
    with disk_of(disk, 128):
        out = disk / "out"
        full = run_here(capsys, logs, "-o", out, *PLAIN, expect=2)
        assert full.err.startswith("kalscope: ")
        assert full.err.endswith("the disk is full\n")
        assert files_of(out) == {"units.sqlite"}
        done = kept(out)
        assert 0 < done < 30
        assert "the disk is full" in run_here(capsys, logs, "-o", out, *PLAIN, expect=2).err
        subprocess.run(["mount", "-o", "remount,size=8m", str(disk)], check=True)
        said = run_here(capsys, logs, "-o", out, *PLAIN).out
        assert f"; {30 - done} of 30 files or row groups done" in said
        assert [row["id"] for row in table(out)] == sorted(path.name for path in logs.iterdir())
