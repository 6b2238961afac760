"""What a rerun does again: what failed for a reason outside of the recording, and nothing else."""

from __future__ import annotations

import errno
import sys

import pytest
from fleet_runs import parts, run_here, table, write_devices
from required import not_here

from kalscope.errors import BadFile, BadSetting
from kalscope.fleet import work
from kalscope.fleet.run import LOST, WorkerDied
from kalscope.fleet.work import may_pass

try:
    import pyarrow  # noqa: F401
except ImportError:
    not_here("pyarrow is not installed")

PLAIN = ["--momentum", "0", "--no-robust"]


def wrapped(error):
    """The error as the readers pass it on: in one line, its origin unsaid."""
    try:
        try:
            raise error
        except type(error):
            raise BadFile("cannot read 'a.csv'") from None
    except BadFile as one:
        return one


@pytest.mark.parametrize(
    ("error", "passes"),
    [
        (PermissionError(errno.EACCES, "Permission denied"), True),
        (OSError(errno.EIO, "Input/output error"), True),
        (OSError(errno.ENOSPC, "No space left on device"), True),
        (MemoryError(), True),
        (ModuleNotFoundError("No module named 'h5py'"), True),
        (OSError("Not a gzipped file"), False),
        (OSError(errno.EINVAL, "Invalid argument"), False),
        (ValueError("no number"), False),
        (BadSetting("channel must be one of a"), False),
    ],
)
def test_what_lies_outside_of_a_recording_may_pass(error, passes):
    assert may_pass(error) == passes
    assert may_pass(wrapped(error)) == passes


def failing(monkeypatch, name, error):
    """Reading this file fails so, until the patch is undone."""
    plain = work.read_file

    def read(unit, asked):
        if unit.id == name:
            raise wrapped(error)
        return plain(unit, asked)

    monkeypatch.setattr(work, "read_file", read)


@pytest.mark.slow
def test_a_cause_outside_of_the_recording_is_tried_again_and_one_in_it_is_not(
    tmp_path, at_once, capsys, monkeypatch
):
    logs, out = tmp_path / "logs", tmp_path / "out"
    write_devices(logs, 6)
    (logs / "empty.csv").write_text("")
    with monkeypatch.context() as patch:
        failing(patch, "dev0003.csv", PermissionError(errno.EACCES, "Permission denied"))
        said = run_here(capsys, logs, "-o", out, *PLAIN).err
        rows = {row["id"]: row["reason"] for row in table(out)}
        assert rows["dev0003.csv"].startswith("cannot read")
        assert "; 1 of 7 files" in run_here(capsys, logs, "-o", out, *PLAIN).out
    assert said == (
        "kalscope: 1 of 7 files or row groups failed for a reason that may pass, such as access, memory or time:"
        " run the same command to retry\n"
    )
    again = run_here(capsys, logs, "-o", out, *PLAIN)
    assert ("; 1 of 7 files" in again.out, again.err) == (True, "")
    assert {row["id"] for row in table(out) if row["reason"]} == {"empty.csv"}
    assert "nothing was missing" in run_here(capsys, logs, "-o", out, *PLAIN).out
    assert len(parts(out)) == 2  # no trace of the failure


@pytest.mark.slow
def test_what_killed_its_workers_is_tried_again(tmp_path, at_once, capsys):
    faults, _ = at_once
    logs, out = tmp_path / "logs", tmp_path / "out"
    write_devices(logs, 4)
    faults.append(lambda units: WorkerDied() if any(unit.id == "dev0002.csv" for unit in units) else None)
    run_here(capsys, logs, "-o", out, *PLAIN)
    assert [row["reason"] for row in table(out) if row["reason"]] == [LOST]
    faults.clear()
    assert "; 1 of 4 files" in run_here(capsys, logs, "-o", out, *PLAIN).out
    assert [row["id"] for row in table(out) if not row["reason"]] == sorted(path.name for path in logs.iterdir())


@pytest.mark.slow
def test_a_missing_library_is_no_fault_of_the_file(tmp_path, at_once, capsys, monkeypatch):
    h5py = pytest.importorskip("h5py")
    logs, out = tmp_path / "logs", tmp_path / "out"
    write_devices(logs, 2)
    with h5py.File(logs / "a.h5", "w") as file:
        file["value"] = [float(abs(i % 90 - 45) + i % 7) for i in range(300)]
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "h5py", None)
        run_here(capsys, logs, "-o", out, *PLAIN)
        assert "pip install" in table(out)[0]["reason"]
    run_here(capsys, logs, "-o", out, *PLAIN)
    assert table(out)[0]["reason"] == ""
