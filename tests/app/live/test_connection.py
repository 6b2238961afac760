"""The connection beside the session: what is on screen stays connected, or is recorded; Undo reconnects."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from kalscope import Recording
from kalscope_app.live import BoardConnection
from kalscope_app.session.changes import opened_live
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Session, undo


class Source:
    """A source that only notes what is asked of it."""

    def __init__(self, _port=None):
        self.calls, self.recorder = [], None
        self.spec = SimpleNamespace(url="x", baud=9600)

    def start(self):
        self.calls.append("start")

    def close(self, _timeout=3.0):
        self.calls.append("close")

    def snapshot(self):
        return None

    def status(self):
        return "status"


@pytest.fixture
def connection():
    """The connection of a board of the command line, on screen."""
    connection = BoardConnection(SimpleNamespace(run=lambda work: work()), Source())
    connection.start()
    return connection


@pytest.fixture
def board(connection):
    return connection.source


FILE = Recording(np.arange(50.0), ("z",), ("",), np.random.default_rng(0).normal(size=(50, 1)), 1.0)


def test_a_board_is_closed_once_a_file_is_on_screen_and_undo_reconnects_it(connection, board):
    session = Session(opened_live(board, "x"), connection)
    session.apply_requests()
    assert board.calls == ["start"]
    session.request(lambda state: opened(FILE, state))
    session.apply_requests()
    assert (board.calls[1:], connection.source) == (["close"], None)
    assert not session.connection().connected
    session.request(undo)
    session.apply_requests()
    assert (board.calls[2:], connection.source) == (["start"], board)
    assert session.connection().status == "status"


def test_a_board_that_is_recorded_stays_connected_behind_a_file(connection, board):
    board.recorder = object()
    connection.look_at(None)
    state = connection.state(None)
    assert (state.connected, state.recording, state.status) == (True, True, "status")
    board.recorder = None
    connection.look_at(None)
    assert board.calls == ["start", "close"]


def test_another_board_is_closed_once_the_session_has_shown_it_in_the_same_turn_too(connection, board, monkeypatch):
    monkeypatch.setattr("kalscope_app.live.LiveSource", Source)
    session = Session(opened_live(board, "x"), connection)
    connection.open(session, None)
    other = connection.source
    connection.look_at(board)
    assert (board.calls, other.calls) == (["start", "close"], ["start"])
    session.request(lambda state: opened(FILE, state))
    session.apply_requests()
    assert (other.calls, connection.source) == (["start", "close"], None)
    session.request(undo)
    session.apply_requests()
    assert (other.calls[2:], connection.source) == (["start"], other)


def test_an_overtaken_request_does_not_close_the_board_that_is_awaited(connection, monkeypatch):
    monkeypatch.setattr("kalscope_app.live.LiveSource", Source)
    session, changes = Session(opened(FILE), connection), []
    for _ in range(2):
        connection.open(SimpleNamespace(request=changes.append), None)
    session.request(changes[0])
    session.apply_requests()
    assert connection.source.calls == ["start"]
    session.request(changes[1])
    assert connection.source is session.apply_requests()[0].live.board
