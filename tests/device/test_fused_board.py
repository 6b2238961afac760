"""Two sensors on a simulated Uno, 100 rows a second: the fused line is that of all rows, and a sensor drops out."""

from __future__ import annotations

import numpy as np
import pytest
from board import SKETCHES
from waiting import wait_until as wait_for

from kalscope import estimate_fusion, fuse
from kalscope.sources.live.source import LiveSource
from kalscope_app.engine.filter_runs import FilterRuns
from kalscope_app.engine.frame import compute_frame
from kalscope_app.session.changes import (
    apply_estimate,
    candidates,
    opened_live,
    refreshed,
    set_span,
    set_taking_part,
)

pytestmark = pytest.mark.device
SKETCH = SKETCHES / "kalscope_stream/kalscope_stream.ino"
TWO_CHANNELS = (r'\{"A0", A0\},\n    // \{"A1", A1\},', '{"near", A0}, {"far", A1},')
RATE = (r"(?<=SAMPLES_PER_SECOND = )200", "100")


def test_two_sensors_of_a_board_are_fused_as_they_come_in(start_board, workshop):
    g = np.random.default_rng(6)
    level = 500.0 + 200.0 * np.sin(0.02 * np.arange(300))
    counts = np.rint(level[:, None] + g.normal(size=(300, 2)) * [4.0, 12.0] + [0.0, 20.0]).astype(int)
    until = ("--seconds", 3)  # a recording of thousands of rows would be drawn from some of them
    board = start_board(workshop.sketch(SKETCH, TWO_CHANNELS, RATE), counts, "--speed", "1", "--wait-open", *until)
    with LiveSource(board.port) as live:
        wait_for(lambda: live.status().accepted >= 150)
        state = refreshed(opened_live(live, "x"), live.snapshot())
        assert candidates(state) == ("near", "far")
        found = estimate_fusion(state.recording.values, names=("near", "far"))
        state, runs = apply_estimate(state.recording, ("near", "far"), found)(state), FilterRuns()
        for rows in (160, 200, 240):
            wait_for(lambda rows=rows: live.status().accepted >= rows)
            state = refreshed(state, live.snapshot())
            assert np.array_equal(line_of(state, runs), fuse(state.recording.values, found.params).x)
        assert live.status().rejected == 0
    assert found.offset[1] - found.offset[0] == pytest.approx(20.0, abs=5.0)
    assert state.fusion.shares["near"] > 0.7
    alone = set_taking_part("far", False)(state)
    assert np.array_equal(line_of(alone, runs), fuse(state.recording.values[:, :1], found.params.only([0])).x)


def line_of(state, runs):
    return compute_frame(set_span("all")(state), runs=runs).filtered
