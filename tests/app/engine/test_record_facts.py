"""What is known of a whole record: the same whether it was looked at once or as it grew."""

from __future__ import annotations

import numpy as np
import pytest
from feed import Board

from kalscope import Recording
from kalscope_app.engine.filter_runs import Facts, RecordFacts, facts_of
from kalscope_app.session.changes import select_channel
from kalscope_app.session.live_changes import opened_live, refreshed
from kalscope_app.session.opening import opened


def record(time, values):
    return Recording(np.array(time, dtype=float), ("z",), ("",), np.array(values, dtype=float)[:, None], 1.0)


@pytest.mark.parametrize(
    ("time", "ascends"), [([0, 1, 2], True), ([0, 0, 0], True), ([0, 2, 1], False), ([5, 1, 2], False), ([7], True)]
)
def test_time_ascends_where_no_step_goes_back(time, ascends):
    assert facts_of(record(time, np.zeros(len(time))), "z").ascends is ascends


def test_clock_never_descends_and_is_the_time_where_that_does_not():
    rec = record([0, 3, 1, 2, 4], np.zeros(5))
    assert facts_of(rec, "z").clock(rec).tolist() == [0, 3, 3, 3, 4]
    assert Facts().clock(rec) is rec.time


@pytest.mark.parametrize("seen", range(7))
def test_what_was_seen_before_and_what_came_make_the_whole(seen):
    for time in ([0, 1, 2, 3, 4, 5], [0, 1, 2, 1, 4, 5], [1, 0, 2, 3, 4, 5]):
        rec = record(time, [np.nan, 1, np.nan, 2, 3, np.nan])
        head = record(time[:seen], rec.values[:seen, 0])
        assert facts_of(rec, "z", facts_of(head, "z"), seen) == facts_of(rec, "z")


def test_facts_stay_right_as_a_board_sends_more_drops_old_samples_or_restarts():
    board, facts = Board(), RecordFacts()
    state = refreshed(opened_live(board.id, "x"), board.send(50).snapshot())

    def check(state):
        assert facts.of(state) == facts_of(state.recording, state.channel)
        return state

    for turn in range(6):
        board.send(20 * turn, seed=turn)
        board.values[len(board.values) - turn :] = np.nan
        board.first = 15 * (turn // 2)
        state = check(refreshed(state, board.snapshot()))
    assert facts.of(state).missing > 0
    state = check(select_channel("b")(state))
    board.generation, board.values, board.first = 1, board.values[:30], 0
    check(refreshed(state, board.snapshot()))


def test_facts_of_another_recording_are_computed_from_its_own_samples():
    facts = RecordFacts()
    first = opened(record([0, 1, 2], [np.nan, 1, 2]))
    other = opened(record([0, 2, 1, 3], [1, 1, 2, 3]))
    assert facts.of(first) == Facts(ascends=True, missing=1)
    assert facts.of(other) == Facts(ascends=False, missing=0)
    assert facts.of(first.with_view(window=(0.0, 1.0))) == Facts(ascends=True, missing=1)
