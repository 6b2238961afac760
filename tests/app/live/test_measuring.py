"""A live board measures its own noise on request: what the folder shows, uses and keeps, and what goes wrong."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
from tests.support.measuring_board import MeasuringBoard
from tests.support.waiting import wait_until

from kalscope.common.text import number
from kalscope.sources.live.source import LiveSource
from kalscope_app.engine.jobs import Jobs
from kalscope_app.live import BoardConnection
from kalscope_app.session.changes import opened_live, set_paused
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Failed, Session, undo
from kalscope_app.views import widgets
from kalscope_app.views.board import FORGET, KEEP, CalibrationView


class Widgets:
    """Widgets by their labels, whose properties can be read and which can be clicked."""

    def __init__(self):
        self.made = {}

    def __getattr__(self, kind):
        def make(label, value=None, **properties):
            widget = MagicMock(label=label, value=value, content="", **properties)
            self.made[label if kind != "add_markdown" else "text"] = widget
            return widget

        return make


class Desk:
    """A board, the session that shows it, and the folder."""

    def __init__(self, board):
        self.board, self.told, self.widgets = board, [], Widgets()
        source = LiveSource(board.port)
        self.connection = BoardConnection(Jobs(self.tell), source)
        self.state = opened_live(source, "board")
        self.session = Session(self.state, self.connection)
        self.view = CalibrationView(self.widgets, self.session, self.tell, self.connection)
        self.connection.start()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._draw)
        self._thread.start()
        wait_until(lambda: self.state.live.settled)

    def tell(self, text, **how):
        self.told.append((str(text), how))

    def _draw(self):
        while not self._end.wait(0.005):
            self.state, _, failures = self.session.apply_requests()
            self.told.extend(failures)
            self.view.show(SimpleNamespace(state=self.state))

    def shown(self, label):
        return self.widgets.made[label].visible

    @property
    def text(self):
        text = self.widgets.made["text"]
        return text.content.replace("\\", "").replace("\xa0", " ") if text.visible else ""

    def click(self, label):
        widget = self.widgets.made[label]
        callback = widget.on_click.call_args[0][0]
        with pytest.raises(StopIteration):
            callback(SimpleNamespace(client=object())).send(None)

    def measure(self, seconds):
        self.widgets.made["measure for (s)"].value = seconds
        self.click("Let the board measure r")

    def close(self):
        self._end.set()
        self._thread.join()
        self.connection.close()


@pytest.fixture
def desk(monkeypatch):
    monkeypatch.setattr(widgets, "MIN_SECONDS", 0.0)  # else Cancel is only there after a second
    with MeasuringBoard() as board:
        desk = Desk(board)
        yield desk
        desk.close()


@pytest.mark.slow
def test_a_board_measures_and_its_values_are_compared_used_and_kept(desk):
    desk.session.request(set_paused(True))  # the screen stands still, the samples go on
    desk.measure("4")
    desk.click("Let the board measure r")  # twice: one measurement
    wait_until(lambda: desk.shown("Cancel") and desk.text)
    assert desk.text == "Measuring for 4 s: keep what the sensor measures constant."
    assert not desk.shown("Let the board measure r")
    wait_until(lambda: desk.shown("Use its r and q here"))
    assert (desk.shown("Let the board measure r"), desk.shown("Cancel")) == (True, False)
    values = desk.state.calibration.values
    measured = f"The board measured r = {number(values.r, 4)} unit², and for the lag of the export q = "
    assert desk.text.startswith(measured)
    assert "here: equal within 0.0010 %." in desk.text
    assert "; from 696 samples" in desk.text
    ((_, how),) = desk.told
    assert how["good"]
    before = desk.state.tuning
    desk.click("Use its r and q here")
    wait_until(lambda: desk.state.tuning.how == "measured by the board" and not desk.shown("Use its r and q here"))
    assert (np.float32(desk.state.tuning.q), np.float32(desk.state.tuning.r)) == (values.q, values.r)
    desk.session.request(undo)
    wait_until(lambda: desk.state.tuning == before)
    wait_until(lambda: desk.shown("Use its r and q here"))  # what was measured stays so
    keep = desk.widgets.made[KEEP]
    for label, kept in ((FORGET, True), (KEEP, False)):
        desk.click(KEEP)
        wait_until(lambda label=label: keep.label == label)
        assert desk.board.kept == kept
    assert [line for line in desk.board.asked if line != "?"] == ["c 4", "k", "f"]


@pytest.mark.slow
def test_what_went_wrong_is_said_and_stays_on_screen_and_nothing_is_stuck(desk):
    button = "Let the board measure r"

    def fails(words, seconds="4", act=lambda: None):
        told = len(desk.told)
        desk.measure(seconds)
        act()
        wait_until(lambda: len(desk.told) > told and desk.shown(button))
        text, how = desk.told[-1]
        assert words in text
        return how

    assert fails("must be a number such as", "soon")["failed"] is Failed.MEASURE
    desk.board.refuses = "the level moves"
    assert fails("the level moves.")["failed"] is Failed.MEASURE
    wait_until(lambda: desk.text.startswith("The board keeps its values: the level moves."))
    desk.board.knows = False
    fails("The sketch on this board cannot measure by itself: export the Arduino sketch with self-calibration")
    desk.board.knows = True

    def fails_while_it_measures(words, act):
        before = len(desk.board.asked)

        def wait_and_act():
            wait_until(lambda: desk.shown("Cancel") and "c 300" in desk.board.asked[before:])
            act()

        return fails(words, "300", wait_and_act)

    assert fails_while_it_measures("cancelled: the board keeps its values", lambda: desk.click("Cancel"))["good"]
    wait_until(lambda: desk.text == "")
    lost = "The board was disconnected before it answered"
    fails_while_it_measures(lost, lambda: desk.session.request(lambda state: opened(state.recording, state)))
    assert not desk.view._folder.visible
    desk.session.request(undo)
    wait_until(lambda: desk.view._folder.visible and desk.connection.source.status().word == "connected")
    desk.board.refuses = ""
    fails_while_it_measures(lost, desk.board.unplug)
    fails("is not connected", "4")
