"""Hostile files and names: each file is one row, the counts add up, and all that is printed or written is plain."""

from __future__ import annotations

import gzip
import os
import re

import numpy as np
import pytest
from tests.fleet.fleet_runs import ANSWER, PLAIN, files_of, run_here, table, write_devices
from tests.support.hostile_names import TERMINAL

from kalscope.common import files
from kalscope.common.text import CONTROL
from kalscope.fleet.results import read_fleet
from kalscope_app.views.fleet import about_fleet

MAGIC = (b"PAR1", b"\x89HDF\r\n\x1a\n", b"#ROSBAG V2", b"PK\x03\x04", b"\x1f\x8b\x08\0", b"LabVIEW Measurement\n")
WORDS = ("nan", "inf", "", "1e308", "-1e308", "1e400", "5e-324", "0")
NAMES = ("-x.csv", "a\nb.csv", "\x1b[2J.csv", "*.csv", "%s.csv", "{x}.csv", "a" * 240 + ".csv", "😀", "\udcff.csv")
BOMB = 2 << 20
"""Bytes that a packed file unpacks to."""


def rows(values, head="t,x\n"):
    return head + "".join(f"{i / 100:.2f},{value}\n" for i, value in enumerate(values))


def write_hostile(folder):
    """Write the files; how many rows of a table they are."""
    folder.mkdir()
    g = np.random.default_rng(5)
    for i, data in enumerate(contents(g)):
        (folder / f"{i:02d}.csv").write_bytes(data)
    for name in NAMES:
        (folder / name).write_text(rows(walk(g)))
    os.symlink(folder / "loop.csv", folder / "loop.csv")
    os.symlink(folder, folder / "up")
    os.symlink("/dev/zero", folder / "zero.csv")
    os.mkfifo(folder / "pipe.csv")
    (folder / "folder.csv").mkdir()
    return len(os.listdir(folder))


def walk(g, n=200):
    return (np.cumsum(0.3 * g.normal(size=n)) + g.normal(size=n)).round(4).tolist()


def contents(g):
    """Noise, beginnings of binary formats, packed files, and numbers that no fit may fail at."""
    yield from (g.bytes(n) for n in (1, 100, 5000))
    yield from (magic + g.bytes(500) for magic in MAGIC)
    yield gzip.compress(rows(walk(g)).encode())[:40]
    yield gzip.compress(b"1,2\n" * (BOMB // 4))
    for word in WORDS:
        yield rows([word] * 100).encode()
        yield rows([word if i % 9 == 0 else value for i, value in enumerate(walk(g))]).encode()
    yield rows(np.frombuffer(g.bytes(8 * 200)).tolist()).encode()
    for span in (20, 300):
        pairs = zip(g.normal(size=200), g.integers(-span, span, 200), strict=True)
        yield rows(f"{a:.3f}e{b}" for a, b in pairs).encode()
    yield from (b"1," * 5000, b"\n" * 1000, b"", b"[" * 5000)
    yield from (rows(walk(g, n), head).encode() for n, head in ((1, "t,x\n"), (200, "x,x\n"), (200, "<html>\n")))


HOSTILE = "".join(TERMINAL).replace("\0", "")
"""Sets the clipboard, clears the screen, ends lines; it fits into a name of 255 bytes."""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="neither links nor pipes")
def test_each_hostile_file_is_one_row_and_one_count(tmp_path, at_once, capsys, monkeypatch):
    monkeypatch.setattr(files, "MAX_UNPACKED", BOMB // 2)
    count, out = write_hostile(tmp_path / "logs"), tmp_path / "out"
    printed = run_here(capsys, tmp_path / "logs", "-o", out)
    rows = table(out)
    assert len(rows) == len({row["id"] for row in rows}) == count > 50
    for row in rows:
        assert (row["q"] is None) == bool(row["reason"]), row
        assert not re.match(r"\w+(Error|Warning|Exception): ", row["reason"]), row
    assert sum("must unpack to at most" in row["reason"] for row in rows) == 1
    failed = sum(row["verdict"] == "failed" for row in rows)
    fitted = sum(row["q"] is not None for row in rows)
    counted = f"{count} rows: {fitted} with q and r, {count - fitted - failed} without, {failed} failed"
    assert printed.out.startswith(f"{counted}; {count} of {count} files or row groups done in ")
    assert about_fleet(read_fleet(out)).replace("\\", "").startswith(counted)
    assert not CONTROL.search(printed.out + printed.err)
    assert files_of(out) == ANSWER


@pytest.mark.slow
def test_what_a_fleet_prints_and_writes_of_hostile_names_is_plain(tmp_path, at_once, capsys):
    logs, out = tmp_path / "logs", tmp_path / f"out{HOSTILE}"
    write_devices(logs, 1)
    rows = (logs / "dev0000.csv").read_text().split("\n", 2)[2]
    (logs / f"{HOSTILE}.csv").write_text(f'time (s),"{HOSTILE} ({HOSTILE})"\n{rows}', encoding="utf-8")
    (logs / f"{HOSTILE}.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    (tmp_path / f"{HOSTILE}.txt").write_text(f"logs/{HOSTILE}.csv\n", encoding="utf-8", newline="")
    printed = [
        run_here(capsys, logs, "-o", out, *PLAIN, "--channel", HOSTILE),
        run_here(capsys, logs / HOSTILE, "-o", out, expect=2),
        run_here(capsys, f"@{tmp_path / HOSTILE}.txt", "-o", out),
        run_here(capsys, logs, "-o", logs / f"{HOSTILE}.csv", expect=2),
        run_here(capsys, logs, "-o", out, *PLAIN),
    ]
    texts = [text for one in printed for text in one]
    assert sum("]52;c;ZXZpbA==" in text for text in texts) >= len(printed)
    written = [path.read_text("utf-8") for path in out.iterdir() if path.suffix in (".json", ".toml")]
    assert len(written) == 2
    assert [text for text in (*texts, *written) if CONTROL.search(text)] == []
    assert all(one.err.count("\n") <= 1 for one in printed)
