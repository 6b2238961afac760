"""The log: what is in it, what never is, how large it grows; and uncaught errors, which are logged and told."""

from __future__ import annotations

import asyncio
import errno
import logging
import os
import queue
import stat
from functools import partial
from pathlib import Path

import pytest
from tests.support.waiting import PATIENCE
from viser import _scene_api

from kalscope.errors import BadSetting
from kalscope_app.guard.server import guarded_server
from kalscope_app.guard.viser_private import callback_errors_to
from kalscope_app.program import log as log_file
from kalscope_app.program.log import ErrorReporter, logging_to, sentence_for

OURS, FOREIGN = logging.getLogger("kalscope_app.some_part"), logging.getLogger("websockets.server")
TOKEN = "T0ken-T0ken_T0ken"


def fail(message="it broke"):
    try:
        raise ValueError(message)
    except ValueError:
        OURS.exception("A part failed")


def test_the_terminal_has_our_warnings_in_one_line_each_and_the_private_file_has_everything(capsys, tmp_path):
    file = tmp_path / "kalscope.log"
    with logging_to(file):
        OURS.info("refused")
        OURS.warning("look here")
        FOREIGN.error("handshake failed")
        fail()
    assert capsys.readouterr().err == "kalscope: look here\nkalscope: A part failed\n"
    text = file.read_text()
    for piece in ("INFO kalscope_app.some_part: refused", "ERROR websockets.server: handshake failed", "Traceback"):
        assert piece in text
    if os.name == "posix":
        assert stat.S_IMODE(file.stat().st_mode) == 0o600


def test_the_token_is_in_no_log(tmp_path, capsys):
    file = tmp_path / "kalscope.log"
    with logging_to(file, verbose=True) as hidden:
        OURS.warning("asked for /?token=Another-secret_of-old&x")
        OURS.warning("Cookie: kalscope_8080=Another-secret_of-old; a=b")
        hidden.append(TOKEN)
        OURS.warning("somewhere %s inside", TOKEN)
        fail(f"bad {TOKEN}")
    for text in (file.read_text(), capsys.readouterr().err):
        assert TOKEN not in text
        assert "Another-secret" not in text
        assert "token=…&x" in text
        assert "kalscope_8080=…; a=b" in text
        assert "somewhere … inside" in text


def test_the_file_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(log_file, "FILE_BYTES", 2000)
    file = tmp_path / "kalscope.log"
    with logging_to(file):
        for i in range(1000):
            OURS.warning("entry %d", i)
        monkeypatch.setattr(logging.getLogger().handlers[-1], "format", lambda _record: 1 / 0)
        OURS.warning("a disk that is full is no error")
    assert sorted(os.listdir(tmp_path)) == ["kalscope.log", "kalscope.log.1", "kalscope.log.2"]
    assert sum(each.stat().st_size for each in tmp_path.iterdir()) <= 3 * 2000
    assert "entry 999" in file.read_text()


@pytest.mark.parametrize("name", ["notes.txt", "notes.txt.2"])
def test_a_file_that_is_no_log_is_neither_appended_to_nor_removed(tmp_path, name):
    (tmp_path / name).write_text("\nmine\n")
    with pytest.raises(BadSetting, match=f"got '.*{name}'"), logging_to(tmp_path / "notes.txt"):
        pass
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, "\nmine\n")]


def test_the_sentence_says_what_happened_and_what_to_do():
    full = OSError(errno.EMFILE, "Too many open files")
    for error, words in (
        *((ValueError("odd\nvalue"), "ValueError: odd value"), (ValueError(), "reload the page")),
        *((ValueError(), "--log FILE"), (MemoryError(), "more memory"), (full, "oo many")),
    ):
        assert words in sentence_for(error, None)
    assert "kalscope.log" in sentence_for(ValueError(), Path("kalscope.log"))


def test_a_callback_of_the_scene_that_raises_is_told(capfd):
    """viser calls those on the event loop itself, and would print what they raise."""
    errors, told = ErrorReporter(), queue.Queue()
    errors.notify = lambda error: told.put(sentence_for(error, None))
    stock = _scene_api.print_awaited_callback_error
    with callback_errors_to(partial(errors.report, "callback")), guarded_server(port=0) as running:
        server = running.server

        async def broken(_event):
            raise LookupError("in the scene")

        call = server.scene._dispatch_callback(broken, None)
        asyncio.run_coroutine_threadsafe(call, server._event_loop).result(PATIENCE)
        assert "in the scene" in told.get(timeout=PATIENCE)
    assert _scene_api.print_awaited_callback_error is stock
    assert "in the scene" not in capfd.readouterr().err
