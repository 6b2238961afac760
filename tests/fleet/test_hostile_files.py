"""Whatever the files of a fleet hold, each ends in one row, and the counts of all that is said add up."""

from __future__ import annotations

import os
import re

import pytest
from fleet_runs import ANSWER, files_of, run_here, table
from hostile_folder import write_hostile

from kalscope.common import files
from kalscope.common.text import CONTROL
from kalscope.fleet.results import read_fleet
from kalscope_app.views.fleet import about_fleet


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="neither links nor pipes")
def test_each_hostile_file_is_one_row_and_one_count(tmp_path, at_once, capsys, monkeypatch):
    monkeypatch.setattr(files, "MAX_UNPACKED", 1 << 20)
    count, out = write_hostile(tmp_path / "logs", 2 << 20), tmp_path / "out"
    said = run_here(capsys, tmp_path / "logs", "-o", out)
    rows = table(out)
    assert len(rows) == len({row["id"] for row in rows}) == count > 60
    for row in rows:
        assert (row["q"] is None) == bool(row["reason"]), row
        assert not re.match(r"\w+(Error|Warning|Exception): ", row["reason"]), row
    assert sum("must unpack to at most" in row["reason"] for row in rows) == 2
    failed = sum(row["verdict"] == "failed" for row in rows)
    fitted = sum(row["q"] is not None for row in rows)
    counted = f"{count} rows: {fitted} with q and r, {count - fitted - failed} without, {failed} failed"
    assert said.out.startswith(f"{counted}; {count} of {count} files or row groups done in ")
    assert about_fleet(read_fleet(out)).startswith(f"{counted}. ")
    assert not CONTROL.search(said.out + said.err)
    assert files_of(out) == ANSWER
