"""A setting sent to one of two filters of a real Arduino program: it obeys bit for bit, the other goes on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.device.exported_sketch import exported
from tests.support.board import read_lines
from tests.support.waiting import wait_until

from kalscope.export.board import check_board
from kalscope.export.float32 import float32_params
from kalscope.sources.live.source import LiveSource
from kalscope.tuning.tuning import ChannelTuning
from kalscope_app.live import send_setting
from kalscope_app.session.changes import opened_live, refreshed, set_sent
from kalscope_app.studies.checks import compare_with_board


def grown(source, state, condition):
    """The state once enough samples have arrived."""

    def enough():
        nonlocal state
        state = refreshed(state, source.snapshot())
        return condition(state)

    wait_until(enough, pause=0.05)
    return state


def assert_obeys(state):
    check = compare_with_board(state)
    assert check.rows > 150
    assert check.different == 0


def test_a_board_that_runs_already_can_be_sent_to_though_it_has_told_no_names(start_board, workshop):
    firmware = exported(workshop, ChannelTuning("light", "counts", 0.5, 20.0), edits=())
    board = start_board(firmware, np.random.default_rng(8).integers(300, 700, 4000))
    read_lines(board.port, 3)  # its header has gone
    with LiveSource(board.port) as source:
        state = grown(source, opened_live(source, "board"), lambda state: len(state.recording) > 150)
        assert state.recording.names == ("value 1", "value 2")
        state = state.with_tuning(q=0.037, r=11.3)
        state = set_sent(send_setting(state, source))(state)
        assert state.board == "value 2"
        rows = state.sent.row + 200
        state = grown(source, state, lambda state: len(state.recording) > rows)
    assert_obeys(state)


@pytest.mark.parametrize(("before", "after"), [(0.0, 0.0), (20.0, 5.0)])
def test_only_the_channel_on_screen_gets_the_values_and_computes_what_we_do(start_board, workshop, before, after):
    light = ChannelTuning("light", "counts", 0.5, 20.0)
    temp = ChannelTuning("temp", "counts", 0.01, 9.0, 4.0, momentum=before)
    firmware = exported(workshop, light, temp, edits=())
    counts = np.random.default_rng(8).integers(300, 700, (4000, 2))
    board = start_board(firmware, counts, "--wait-open")
    with LiveSource(board.port) as source:
        state = grown(source, opened_live(source, "board"), lambda state: len(state.recording) > 150)
        assert state.recording.names == ("light", "light_filtered", "temp", "temp_filtered")
        state = replace(state, channel="temp").with_tuning(q=0.037, r=11.3, momentum=after)
        state = replace(state, sent=send_setting(state, source))
        rows = state.sent.row + 200
        state = grown(source, state, lambda state: len(state.recording) > rows)
    assert_obeys(state)
    column = state.recording.channel
    other = check_board(column("light"), column("light_filtered"), float32_params(light.params))
    assert (other.rows, other.different) == (len(state.recording), 0)
