"""A setting on its way to a board: which filter it is for, what a refusal leaves, what the comparison speaks of."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from kalscope import BadSetting, FilterParams, Recording
from kalscope.errors import BadDevice
from kalscope.estimation.result import Estimate
from kalscope.export.board import momentum_on_board
from kalscope.export.float32 import Float32Params, filter_float32
from kalscope.filtering.classic import Chain, Exponential
from kalscope.sources.live.samples import Snapshot
from kalscope_app.live import BoardConnection, send_setting
from kalscope_app.session.changes import apply_estimate
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Session
from kalscope_app.session.state import Live, Sent, State
from kalscope_app.views.board import BoardView, compared, values


class Board:
    """Obeys as the exported sketch does; `says` replaces its answer to a command that begins so."""

    def __init__(self, says=None, momentum=None):
        self.used = {"q": np.float32(1.0), "r": np.float32(1.0), "p": np.float32(np.inf)}
        if momentum is not None:
            self.used["t"] = np.float32(momentum)
        self.says, self.asked, self.commands = says or {}, [], self

    def snapshot(self):
        return None

    def send(self, line, is_reply, **_):
        self.asked.append(line)
        name = line.split()[0]
        if name in self.says:
            if not is_reply(self.says[name]):
                raise BadDevice(f"the board did not answer {line!r} within 5 s")
            return (self.says[name],)
        if name != "?":
            self.used[name] = np.float32(float(line.split()[1]))
        bits = ",".join(f"{one.view(np.uint32):08X}" for one in self.used.values())
        return (f"# light q=0 r=0 p=0 bits={bits}",)


@pytest.fixture
def state() -> State:
    raw = np.random.default_rng(4).integers(300, 700, 400).astype(float)
    used = Float32Params(np.float32(0.037), np.float32(11.3))
    both = np.column_stack([raw, filter_float32(raw, used)])
    recording = Recording(np.arange(400) * 0.005, ("raw", "filtered"), ("", ""), both, 0.005)
    live = Live(Board(), Snapshot(recording=recording, generation=1, version=1, first=0), settled=True)
    state = replace(opened(recording), live=live).with_tuning(q=0.037, r=11.3)
    return replace(state, sent=Sent(state.record_key, "raw", "filtered", state.params, used, 0))


def test_fused_sensors_cannot_be_sent_to_a_running_board_and_the_folder_says_so(state):
    readings = np.column_stack([state.z, state.z + 1.0])
    recording = Recording(state.recording.time, ("a", "b"), ("", ""), readings, 0.005)
    params = FilterParams(1.0, np.ones(2))
    found = Estimate(q=1.0, r=params.r, loglik=0.0, verdict="ok", message="", params=params)
    fused = apply_estimate(recording, ("a", "b"), found)(opened(recording))
    fused = replace(fused, live=state.live)
    with pytest.raises(BadSetting, match="sketch of fused sensors takes no values while it runs: export it again"):
        send_setting(fused, None)
    view = BoardView(gui := MagicMock(), MagicMock(), MagicMock(), MagicMock(), MagicMock())
    for shown, words in (fused, "takes no values while it runs"), (state, "Its filter restarts with"):
        view.show(SimpleNamespace(state=shown))
        assert (gui.add_button.return_value.visible, words in view._how.content) == (shown is state, True)


def test_another_filter_than_the_boards_is_not_sent_and_the_board_left_as_it_is(state):
    classic = {"chain": Chain(then=Exponential(0.125))}
    median = "# light q=0 r=0 p=0 m=5 bits=3F800000,3F800000,7F800000"
    for tuned, answers, words in (
        (classic, {}, "sketch of a classic filter takes no values while it runs: export"),
        ({}, {"?": "# light takes no values while it runs: …"}, "filter of light on this board is not Kalman's"),
        ({"chain": Chain(3)}, {"?": median}, r"5 samples, which no command changes \(got 3\)"),
        ({"momentum": 20.0}, {}, "momentum must be 0 for this board, whose sketch was exported without it"),
    ):
        board = Board(answers)
        with pytest.raises(BadSetting, match=words):
            send_setting(state.with_tuning(**tuned), board)
        assert board.asked == ([] if tuned is classic else ["?"])


@pytest.mark.parametrize(("momentum", "before"), [(0.0, None), (20.0, 3.0), (0.0, 3.0), (20.0, 0.0)])
def test_what_the_board_says_it_uses_is_what_counts(state, momentum, before):
    board, state = Board(momentum=before), state.with_tuning(momentum=momentum)
    sent = send_setting(state, board)
    assert [line.split()[0] for line in board.asked] == [*("?qrp" if before is None else "?qrtp")]
    assert (sent.params.q, sent.params.r, sent.asked) == (np.float32(0.037), np.float32(11.3), state.params)
    assert sent.params.momentum == momentum_on_board(board.used["q"], np.float32(momentum))
    assert f"p0 = inf{f', momentum = {momentum:g}' if momentum else ''}" in values(sent)


@pytest.mark.parametrize(("at", "answer"), [("q", "# not understood; q VALUE"), ("r", "# hello"), ("p", "# hello")])
def test_a_command_that_fails_leaves_no_claim_of_what_the_board_uses(state, at, answer):
    board = Board({at: answer})
    session, told, connection = Session(state), [], BoardConnection(MagicMock(), board)
    state = replace(state, live=replace(state.live, board=board))
    view = BoardView(MagicMock(), session, MagicMock(), told.append, connection)
    with pytest.raises(BadDevice, match=f"the board did not .* '{at} "):
        view._send(state)
    after, _, failures = session.apply_requests()
    assert (after.sent, compared(after), failures, told) == (None, "", [], [])
