"""Hostile files and names: each file is one row, the counts add up, and all that is said or written is plain."""

from __future__ import annotations

import os
import re

import pytest
from fleet_runs import ANSWER, PLAIN, files_of, run_here, table, write_devices
from hostile_folder import write_hostile
from hostile_names import TERMINAL

from kalscope.common import files
from kalscope.common.text import CONTROL
from kalscope.fleet.results import read_fleet
from kalscope_app.views.fleet import about_fleet

HOSTILE = "".join(TERMINAL).replace("\0", "")
"""Sets the clipboard, clears the screen, ends lines; it fits into a name of 255 bytes."""


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
    assert about_fleet(read_fleet(out)).replace("\\", "").startswith(counted)
    assert not CONTROL.search(said.out + said.err)
    assert files_of(out) == ANSWER


@pytest.mark.slow
def test_what_a_fleet_says_and_writes_of_hostile_names_is_plain(tmp_path, at_once, capsys):
    logs, out = tmp_path / "logs", tmp_path / f"out{HOSTILE}"
    write_devices(logs, 1)
    rows = (logs / "dev0000.csv").read_text().split("\n", 2)[2]
    (logs / f"{HOSTILE}.csv").write_text(f'time (s),"{HOSTILE} ({HOSTILE})"\n{rows}', encoding="utf-8")
    (logs / f"{HOSTILE}.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    (tmp_path / f"{HOSTILE}.txt").write_text(f"logs/{HOSTILE}.csv\n", encoding="utf-8", newline="")
    said = [
        run_here(capsys, logs, "-o", out, *PLAIN, "--channel", HOSTILE),
        run_here(capsys, logs / HOSTILE, "-o", out, expect=2),
        run_here(capsys, f"@{tmp_path / HOSTILE}.txt", "-o", out),
        run_here(capsys, logs, "-o", logs / f"{HOSTILE}.csv", expect=2),
        run_here(capsys, logs, "-o", out, *PLAIN),
    ]
    texts = {
        path.name: path.read_text(encoding="utf-8") for path in out.iterdir() if path.suffix in (".json", ".toml")
    }
    assert len(texts) == 2
    assert sum("]52;c;ZXZpbA==" in text for one in said for text in one) >= len(said)
    assert [text for one in said for text in one if CONTROL.search(text)] == []
    assert [name for name, text in texts.items() if CONTROL.search(text)] == []
    assert all(one.err.count("\n") <= 1 for one in said)
