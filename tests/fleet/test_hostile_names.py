"""Names of files, channels and folders that mean harm: the terminal and every file of text get them plain."""

from __future__ import annotations

import pytest
from fleet_runs import PLAIN, run_here, write_devices
from hostile_names import TERMINAL

from kalscope.common.text import CONTROL

HOSTILE = "".join(TERMINAL).replace("\0", "")
"""Sets the clipboard, clears the screen, ends lines; it fits into a name of 255 bytes."""


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
