"""A real Arduino program behind a live source: exact values, nothing lost, unplugged and plugged in again."""

from __future__ import annotations

import numpy as np
import pytest
from board import FLAT_OUT, SKETCHES
from waiting import PATIENCE
from waiting import wait_until as wait_for

from kalscope.sources.live import lines
from kalscope.sources.live.source import LiveSource

pytestmark = pytest.mark.device
SKETCH = SKETCHES / "kalscope_stream/kalscope_stream.ino"
RATE = (r"(?<=SAMPLES_PER_SECOND = )200", "900")


@pytest.fixture
def never_reset(monkeypatch):
    """A simulator that stalls inside a line looks, soon after the opening, like a board that was reset there."""
    monkeypatch.setattr(lines, "_SILENCE", PATIENCE)


@pytest.mark.usefixtures("never_reset")
def test_all_1024_counts_arrive_exactly_under_the_name_the_board_gives(start_board, workshop):
    counts = np.random.default_rng(5).permutation(1024)
    board = start_board(workshop.sketch(SKETCH, RATE), counts, *FLAT_OUT)
    with LiveSource(board.port) as live:
        wait_for(lambda: live.status().accepted >= 1024)
        recording, status = live.snapshot().recording, live.status()
    assert recording.names == ("A0",)
    np.testing.assert_array_equal(recording.values[:1024, 0], counts)
    assert status.rejected == 0
    assert status.received == status.accepted + status.dropped


def test_pulling_the_plug_and_plugging_in_again_is_one_gap(start_board, stream_sketch):
    board = start_board(stream_sketch, 512, "--speed", "1", "--wait-open")
    with LiveSource(board.port) as live:
        wait_for(lambda: live.status().accepted >= 100)
        board.unplug()
        wait_for(lambda: live.status().word == "disconnected, waiting")
        before = live.status().accepted
        start_board(stream_sketch, 700, "--speed", "1", "--wait-open")
        wait_for(lambda: live.status().accepted >= before + 100)
        recording, status = live.snapshot().recording, live.status()
    (gap,) = np.flatnonzero(np.isnan(recording.values[:, 0]))
    assert set(recording.values[:gap, 0]) == {512.0}
    assert set(recording.values[gap + 1 :, 0]) == {700.0}
    assert (np.diff(recording.time) > 0).all()
    assert status.reconnects == 1
    assert status.hint == ""


def test_the_reset_button_makes_no_new_generation(start_board, stream_sketch):
    board = start_board(stream_sketch, 512, "--speed", "1", "--wait-open")
    with LiveSource(board.port) as live:
        wait_for(lambda: live.status().accepted >= 50)
        first = live.snapshot()
        board.reset()
        before = live.status().accepted
        wait_for(lambda: live.status().accepted >= before + 100)
        later, status = live.snapshot(), live.status()
    assert later.generation == first.generation
    assert set(later.recording.values[:, 0]) == {512.0}
    assert status.reconnects == 0
