"""A disk that is really full: a small file system in memory, which only root may mount."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import contextmanager

import pytest
from tests.fleet.fleet_runs import PLAIN, files_of, kept, run_here, table, write_devices


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
