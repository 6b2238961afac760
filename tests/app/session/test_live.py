"""A live board in the State: what follows, what stands still, what the user tuned stays; the filter goes on."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from tests.app.recordings import Board

from kalscope import BadSetting, Recording, kalman_filter
from kalscope.estimation.request import starting_params
from kalscope.filtering.classic import Chain, OneEuro
from kalscope.tuning.tuning import ChannelTuning, Tuning
from kalscope_app.engine.engine import Engine, Part
from kalscope_app.engine.filter_runs import FilterRuns
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session import changes
from kalscope_app.session.changes import apply_options, live_window, opened_live, refreshed, set_span, set_text
from kalscope_app.session.opening import opened
from kalscope_app.session.session import Session, redo, undo
from kalscope_app.session.state import ConnectionState


@pytest.fixture
def board():
    return Board()


def opened_board(board, tuning=None):
    return refreshed(opened_live(board.id, "x", tuning=tuning), board.snapshot())


def grown(board, count, state):
    return refreshed(state, board.send(count).snapshot())


def test_starting_values_are_measured_on_the_first_samples_and_then_stay(board):
    empty = opened_board(board)
    assert np.isnan(empty.recording.values).all()
    early = grown(board, 20, empty)
    settled = grown(board, changes.START_SAMPLES - 20, early)
    state = grown(board, 5000, settled)
    assert early.starts != settled.starts == state.starts
    assert changes.reset_parameters(set_text("q", "7")(state)).tunings == settled.starts
    head = board.values[: changes.START_SAMPLES, 0]
    assert state.starts[0].r == pytest.approx(np.var(np.diff(head)) / 2, rel=0.05)


def test_a_topic_that_is_new_later_is_measured_by_itself_and_the_record_goes_on(board):
    state = before = set_text("r", "9")(opened_board(board.send(500)))
    board.send(changes.START_SAMPLES)
    late = np.where(np.arange(len(board.values)) < 500, np.nan, 10 * board.values[:, 0])
    board.names, board.values, board.generation = ("a", "b", "late"), np.column_stack([board.values, late]), 1
    state = refreshed(state, board.snapshot())
    assert (len(state.recording), state.channel, state.tuning.r) == (500 + changes.START_SAMPLES, "a", 9.0)
    assert state.starts[2].params == starting_params(late[500:])
    assert state.tunings[:2] == before.tunings


def test_the_window_follows_until_the_person_looks_back(board):
    state = set_span("1 s")(opened_board(board.send(1000)))
    assert live_window(state) == (pytest.approx(8.99), pytest.approx(9.99))
    state = grown(board, 100, state)
    assert live_window(state) == (pytest.approx(9.99), pytest.approx(10.99))
    back = grown(board, 100, changes.set_window(2.0, 4.0)(state))
    assert (live_window(back), len(back.recording), back.live.following) == ((2.0, 4.0), 1200, False)
    again = refreshed(changes.follow(back), board.snapshot())
    assert live_window(again) == (pytest.approx(10.99), pytest.approx(11.99))


@pytest.mark.slow
def test_the_filter_of_a_growing_record_equals_the_filter_of_the_whole(board):
    opened, chains = opened_board(board.send(200)), (Chain(5), Chain(3, OneEuro(0.02, 0.7, 0.1)))
    chosen = [opened, *(changes.use_chain(chain)(opened) for chain in chains)]
    runs = [FilterRuns() for _ in chosen]
    for count, first in ((1, 0), (50, 0), (3000, 0), (7, 0), (10, 1000)):
        board.first = first  # older samples leave memory: the filter goes on from what it knew
        board.send(count)
        for state, kept in zip(chosen, runs, strict=True):
            now = refreshed(state, board.snapshot())
            frame = compute_frame(set_span("all")(now), runs=kept)
            whole = now.filter.run(board.values[:, 0])
            np.testing.assert_array_equal(frame.filtered, whole.x[first:][frame.drawn.indices])
            assert np.isfinite(frame.steady.lag_samples)


def test_undo_takes_back_the_tuning_and_leaves_the_samples(board):
    session = Session(opened_board(board.send(500)), board)
    before = session.apply_requests()[0].tuning.q
    for text in ("2", "3"):
        session.request(set_text("q", text))
        board.send(100)
        assert session.apply_requests()[0].tuning.q == float(text)
    session.request(undo)
    state, _, failures = session.apply_requests()
    assert (state.tuning.q, len(state.recording), failures) == (2.0, 700, [])
    for step, q in (undo, before), (redo, 2.0):
        session.request(step)
        assert session.apply_requests()[0].tuning.q == q
    assert not any(len(kept.recording) > 2 for kept in session._history.past)


def test_later_requests_of_the_turn_that_returns_to_a_board_see_its_samples(board):
    session = Session(opened_board(board.send(500)), board)
    session.apply_requests()
    session.request(set_text("q", "7"))
    other = Recording(np.arange(50.0), ("z",), ("",), np.zeros((50, 1)), 1.0)
    session.request(lambda state: opened(other, state))
    session.apply_requests()
    seen = []
    for change in (undo, undo, redo):
        session.request(change)
        session.with_state(seen.append)
    state, _, failures = session.apply_requests()
    assert [len(at.recording) for at in (*seen, state)] == [500] * 4
    assert (state.tuning.q, failures) == (7.0, [])


def test_the_boards_own_filter_is_drawn_and_compared():
    board = Board(("raw", "filtered"))
    state = opened_board(board.send(300))
    assert (state.channel, state.board) == ("raw", "filtered")
    state = set_span("all")(state)
    own = kalman_filter(board.values[:, 0], state.params).x
    board.values[:, 1] = own
    board.values[200, 1] += 0.25
    frame = compute_frame(state)
    assert frame.board_difference == pytest.approx(0.25)
    np.testing.assert_array_equal(frame.board, board.values[:, 1][frame.drawn.indices])
    assert compute_frame(changes.set_board_channel(None)(state)).board is None


def test_a_silent_board_is_drawn_again_only_when_its_status_changes(board, monkeypatch):
    for name in ("SETTLING", "STATUS_INTERVAL"):
        monkeypatch.setattr(f"kalscope_app.engine.engine.{name}", 0.0)
    frames = []

    def show(frame, parts):
        frames.extend([frame] if Part.SIGNAL in parts else [])

    engine = Engine(Session(opened_board(board.send(500)), board), show, pytest.fail)
    status = SimpleNamespace(word="disconnected, waiting", hint="", recording=None)
    for connection, count in (board.state(), 1), (ConnectionState(True, False, status), 2):
        board.state = lambda _board=None, connection=connection: connection
        for _ in range(5):
            engine._turn()
        assert len(frames) == count
    assert frames[-1].connection.status is status


def test_what_the_command_line_asked_for_waits_until_the_channels_are_known(board):
    with pytest.raises(BadSetting):  # what no channel could have is refused at once
        apply_options(opened_board(board), "b", None, q="-1")
    state = grown(board, 20, apply_options(opened_board(board), "b", None, q="1", r="2", gate="9"))
    assert state.channel == "a"
    state = grown(board, 500, state)
    tuning = state.tuning
    assert (state.channel, tuning.q, tuning.r, tuning.gate) == ("b", 1.0, 2.0, 9.0)
    assert grown(board, 500, set_text("q", "5")(state)).tuning.q == 5.0


@pytest.mark.slow
def test_a_tuning_of_another_sample_rate_is_rescaled_but_not_for_a_measured_percent():
    for period, q in (0.01, 3.0), (0.0102, 3.0), (0.02, 1.5):
        tuning = Tuning((ChannelTuning("b", "", 3.0, 4.0, None, None, "by hand"),), sample_period=period)
        state = grown(board := Board(), 500, opened_board(board, tuning=tuning))
        assert state.tunings[1].q == pytest.approx(q)
