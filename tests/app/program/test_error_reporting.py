"""Uncaught exceptions: the user reads one sentence, the log has the details, the program keeps running."""

from __future__ import annotations

import asyncio
import errno
import queue
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pytest
from viser import _scene_api
from waiting import PATIENCE

from kalscope_app.guard.server import guarded_server
from kalscope_app.guard.viser_private import callback_errors_to, thread_pool
from kalscope_app.program import log
from kalscope_app.program.log import ErrorReporter, sentence_for


@pytest.fixture
def heard():
    """An ErrorReporter and its notifications."""
    told = queue.Queue()
    errors = ErrorReporter()
    errors.notify = lambda error: told.put(sentence_for(error, None))
    return errors, told


def test_the_sentence_says_what_happened_and_what_to_do():
    sentence = sentence_for(ValueError("odd\nvalue"), Path("kalscope.log"))
    assert "ValueError: odd value" in sentence
    assert "reload the page" in sentence
    assert "kalscope.log" in sentence
    assert "--log FILE" in sentence_for(ValueError(), None)
    assert "more memory" in sentence_for(MemoryError(), None)
    full = sentence_for(OSError(errno.EMFILE, "Too many open files"), None)
    assert "too many" in full.lower()
    assert "bug" not in full


def test_what_ends_a_thread_is_told(heard, caplog):
    errors, told = heard
    before = threading.excepthook
    with errors.watch_threads():
        reader = threading.Thread(target=lambda: 1 / 0, name="reader")
        reader.start()
        reader.join()
    assert "ZeroDivisionError" in told.get(timeout=PATIENCE)
    assert "thread reader" in caplog.text
    assert threading.excepthook is before


def test_a_callback_that_raises_is_told_and_the_next_one_runs(heard):
    errors, told = heard
    loop = asyncio.new_event_loop()
    with ThreadPoolExecutor(1) as pool:
        errors.watch_server(loop, pool)
        assert pool.submit(lambda: {}["no such key"]).result(PATIENCE) is None
        assert pool.submit(lambda a, b: a + b, 1, b=2).result(PATIENCE) == 3
    loop.close()
    assert "KeyError: 'no such key'" in told.get(timeout=PATIENCE)


def test_callbacks_of_a_real_server_are_watched(heard):
    """Both kinds: in the pool, and on the event loop."""
    errors, told = heard
    with guarded_server(port=0) as running:
        server = running.server
        errors.watch_server(server.get_event_loop(), thread_pool(server))

        async def broken():
            raise LookupError("on the loop")

        server._event_loop.call_soon_threadsafe(lambda: server._event_loop.create_task(broken()) and None)
        assert "on the loop" in told.get(timeout=PATIENCE)
        server._thread_executor.submit(lambda: 1 / 0).result(PATIENCE)
        assert "ZeroDivisionError" in told.get(timeout=PATIENCE)


def test_a_callback_of_the_scene_that_raises_is_told(heard, capfd):
    """viser calls those on the event loop itself, and would print what they raise."""
    errors, told = heard
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


def test_the_same_sentence_is_not_said_twice_in_a_row(heard, caplog, monkeypatch):
    errors, told = heard
    for _ in range(5):
        errors.report("reader", ValueError("again"))
    assert told.qsize() == 1
    assert caplog.text.count("ValueError: again") >= 5  # each with its traceback
    monkeypatch.setattr(log, "REPEAT_S", 0.0)
    errors.report("reader", ValueError("again"))
    assert told.qsize() == 2
