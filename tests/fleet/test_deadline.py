"""A device that hangs ends its process, not the run, and takes no other device with it."""

from __future__ import annotations

import os
from contextlib import nullcontext

import pytest
from fleet_runs import ANSWER, PLAIN, InProcesses, files_of, run_here, table, write_devices

from kalscope.fleet import run as fleet_run
from kalscope.fleet import work

REASON = "it must be read and fitted within 0.5 s (got no result)"


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="pause() is of POSIX")
def test_a_device_that_hangs_in_c_is_a_row_and_its_neighbours_are_done(tmp_path, at_once, capsys, monkeypatch):
    logs, out = tmp_path / "logs", tmp_path / "out"
    write_devices(logs, 2)
    for name in ("hangs0.csv", "hangs1.csv"):
        (logs / name).write_text("1")
    with monkeypatch.context() as patch:
        patch.setattr(fleet_run, "open_workers", lambda *_: nullcontext(InProcesses()))
        patch.setattr(work, "DEVICE_LIMIT_S", 0.5)
        patch.setattr(work, "FULL_BYTES", 1)
        said = run_here(capsys, logs, "-o", out, *PLAIN)
    rows = {row["id"]: (row["verdict"], row["reason"]) for row in table(out) if row["reason"]}
    assert rows == {f"hangs{i}.csv": ("timed_out", REASON) for i in (0, 1)}
    assert said.out.startswith("4 rows: 2 with q and r, 2 failed; 4 of 4 files or row groups done")
    assert files_of(out) == ANSWER
    assert "; 2 of 4 files or row groups done" in run_here(capsys, logs, "-o", out, *PLAIN).out  # tried again
    assert {row["verdict"] for row in table(out) if row["reason"]} == {"failed"}
