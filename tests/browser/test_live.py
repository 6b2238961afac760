"""A real Arduino program in a simulated Uno, its port, the program, a real Chromium: out comes what went in."""

from __future__ import annotations

import numpy as np
import pytest
from tests.browser.screen import FIND
from tests.support.board import SKETCHES
from tests.support.waiting import wait_until

from kalscope import FilterParams, kalman_filter, open_source

pytestmark = [pytest.mark.browser, pytest.mark.device]
STREAM = SKETCHES / "kalscope_stream/kalscope_stream.ino"
Q, R = "process noise q", "measurement noise r"


def test_a_board_shows_every_count_is_tuned_recorded_and_waited_for_and_its_recording_keeps_the_tuning(
    start, start_board, workshop, tmp_path
):
    sketch = workshop.sketch(STREAM, (r"(?<=SAMPLES_PER_SECOND = )200", "300"))
    board = start_board(sketch, np.arange(1024))
    screen = start("demo")
    screen.tab("Source")
    screen.choose("port", "Other address …")
    screen.type("address", board.port)
    screen.press("Connect")
    screen.button("Disconnect").wait_for()
    screen.choose("shows the last", "5 s")
    screen.wait(f"""() => {{ const [x, y] = ({FIND})('raw')?.data ?? [[], []];
        return x.at(-1) - x[0] < 5.5 && y.filter(value => value > 1).length > 100; }}""")
    seen = set()

    def all_counts_seen():  # a loaded machine's board is slow, and 5 s of it may hold fewer than all
        _, raw = screen.line("raw")
        assert np.array_equal(np.diff(raw) % 1024, np.ones(len(raw) - 1)), "a sample is missing, doubled or wrong"
        seen.update(raw)
        return len(seen) == 1024

    wait_until(all_counts_seen, "every count of the converter", pause=0.5)
    screen.tab("Tune")
    screen.press("Pause")
    screen.wait("() => [...document.querySelectorAll('label')].some(l => l.textContent === 'live, paused')")
    all_counts_seen()
    _, raw = screen.line("raw")
    screen.type(Q, "0.5")
    screen.type(R, "50")
    expected = kalman_filter(raw, FilterParams(0.5, 50.0)).x  # the screen's filter began earlier
    last = "chart.data[chart.series.findIndex(one => one.label === 'filtered')].at(-1)"
    screen.wait(
        f"(x) => {{ const chart = ({FIND})('filtered'); return Math.abs({last} - x) < 1e-6; }}", expected[-1]
    )
    np.testing.assert_allclose(screen.line("filtered")[1][600:], expected[600:], atol=1e-6)
    screen.press("Live")
    screen.wait(f"(newest) => ({FIND})('raw').data[1].at(-1) !== newest", raw[-1])

    screen.tab("Source")
    board.unplug()
    screen.wait_for_text("disconnected, waiting")
    start_board(sketch, np.arange(1024))
    screen.page.get_by_text("connected", exact=True).first.wait_for()
    screen.page.get_by_text("reconnects: 1").wait_for()

    recording = tmp_path / "recording.csv"
    screen.press("Record")
    screen.button("Stop recording").wait_for()
    wait_until(lambda: recording.exists() and recording.read_text().count("\n") > 200, "a recording of 200 lines")
    screen.press("Stop recording")
    screen.press("Open the recording")
    screen.wait_for_text("recording.csv")
    screen.tab("Tune")
    screen.wait_for_line(
        "filtered", kalman_filter(open_source(str(recording)).values[:, 0], FilterParams(0.5, 50.0)).x
    )
    assert screen.q_and_r() == [0.5, 50.0]
