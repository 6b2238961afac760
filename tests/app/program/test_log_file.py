"""The log: what is in it, what is never in it, and how large it grows."""

from __future__ import annotations

import logging
import os
import stat

import pytest

from kalscope.errors import BadSetting
from kalscope_app.program import log as log_file
from kalscope_app.program.log import logging_to

OURS, FOREIGN = logging.getLogger("kalscope_app.some_part"), logging.getLogger("websockets.server")
TOKEN = "T0ken-T0ken_T0ken"


def fail(message="it broke"):
    try:
        raise ValueError(message)
    except ValueError:
        OURS.exception("A part failed")


def test_the_terminal_has_warnings_of_ours_in_one_line_each(capsys):
    with logging_to():
        OURS.info("quiet")
        OURS.warning("look here")
        FOREIGN.error("a port scan")
        fail()
    assert capsys.readouterr().err == "kalscope: look here\nkalscope: A part failed\n"


def test_the_file_has_everything_and_is_private(tmp_path):
    file = tmp_path / "kalscope.log"
    with logging_to(file):
        OURS.info("refused")
        FOREIGN.error("handshake failed")
        fail()
    text = file.read_text()
    for piece in ("INFO kalscope_app.some_part: refused", "ERROR websockets.server: handshake failed", "Traceback"):
        assert piece in text
    if os.name == "posix":
        assert stat.S_IMODE(file.stat().st_mode) == 0o600


def test_the_token_is_in_no_log(tmp_path, capsys):
    file = tmp_path / "kalscope.log"
    with logging_to(file, verbose=True) as log:
        OURS.warning("asked for /?token=Another-secret_of-old&x")
        OURS.warning("Cookie: kalscope_8080=Another-secret_of-old; a=b")
        log.hidden.append(TOKEN)
        OURS.warning("somewhere %s inside", TOKEN)
        fail(f"bad {TOKEN}")
    for text in (file.read_text(), capsys.readouterr().err):
        assert TOKEN not in text
        assert "Another-secret" not in text
        assert "token=…&x" in text
        assert "kalscope_8080=…; a=b" in text
        assert "somewhere … inside" in text


def test_a_hostile_name_neither_begins_an_entry_nor_moves_the_cursor(tmp_path):
    file = tmp_path / "kalscope.log"
    with logging_to(file):
        OURS.warning("opened %s", "x.csv\n2026-01-01 ERROR forged\r\x1b[2Jgone")
    first, second = file.read_text().splitlines()
    assert "opened x.csv" in first
    assert second == "    2026-01-01 ERROR forged··[2Jgone"


def test_the_file_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(log_file, "FILE_BYTES", 2000)
    file = tmp_path / "kalscope.log"
    with logging_to(file):
        for i in range(1000):
            OURS.warning("entry %d", i)
    assert sorted(os.listdir(tmp_path)) == ["kalscope.log", "kalscope.log.1", "kalscope.log.2"]
    assert sum(each.stat().st_size for each in tmp_path.iterdir()) <= 3 * 2000
    assert "entry 999" in file.read_text()


@pytest.mark.parametrize("name", ["notes.txt", "notes.txt.2"])
def test_a_file_that_is_no_log_is_neither_appended_to_nor_removed(tmp_path, name):
    (tmp_path / name).write_text("\nmine\n")
    with pytest.raises(BadSetting, match=f"got '.*{name}'"), logging_to(tmp_path / "notes.txt"):
        pass
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, "\nmine\n")]


def test_a_disk_that_fills_up_later_is_no_error(tmp_path, monkeypatch):
    with logging_to(tmp_path / "kalscope.log"):
        handler = logging.getLogger().handlers[-1]
        monkeypatch.setattr(handler, "format", lambda _record: 1 / 0)
        OURS.warning("goes on")


def test_afterwards_logging_is_as_before(tmp_path):
    root = logging.getLogger()
    before = root.handlers[:], root.level
    with logging_to(tmp_path / "kalscope.log", verbose=True):
        assert root.handlers != before[0]
    assert (root.handlers, root.level) == before
