"""What a rerun does again: what failed, and nothing else."""

from __future__ import annotations

import sys
from contextlib import nullcontext

import pytest
from fleet_runs import PLAIN, InProcesses, kept, run_here, table, write_devices

from kalscope.fleet import run as fleet_run
from kalscope.fleet.run import LOST


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


@pytest.mark.slow
def test_what_kills_its_workers_is_lost_alone_and_tried_again(tmp_path, at_once, capsys, monkeypatch):
    logs, out = tmp_path / "logs", tmp_path / "out"
    write_devices(logs, 4)
    (logs / "kills.csv").write_text((logs / "dev0000.csv").read_text())
    with monkeypatch.context() as patch:
        patch.setattr(fleet_run, "open_workers", lambda *_: nullcontext(InProcesses()))
        run_here(capsys, logs, "-o", out, *PLAIN)
    assert {row["id"]: row["reason"] for row in table(out) if row["reason"]} == {"kills.csv": LOST}
    assert "; 1 of 5 files" in run_here(capsys, logs, "-o", out, *PLAIN).out
    assert [row["id"] for row in table(out) if not row["reason"]] == sorted(path.name for path in logs.iterdir())
