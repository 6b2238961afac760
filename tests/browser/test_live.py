"""A real Arduino program in a simulated Uno, its port, the program, a real Chromium: out comes what went in."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from tests.browser.screen import FIND, Screen, dashboard
from tests.support.board import SKETCHES
from tests.support.waiting import wait_until

from kalscope import FilterParams, kalman_filter
from kalscope.export.registry import export_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning

pytestmark = [pytest.mark.browser, pytest.mark.device]
STREAM = SKETCHES / "kalscope_stream/kalscope_stream.ino"


@pytest.fixture
def open_live(browser, tmp_path):
    """Open the dashboard on a port."""
    with contextlib.ExitStack() as running:

        def begin(port):
            url = running.enter_context(dashboard(f"serial:{port}@115200", cwd=tmp_path))
            return running.enter_context(Screen(browser, url))

        yield begin


def wait_for_samples(screen, count):
    screen.wait(
        f"""(count) => {{ const chart = ({FIND})('raw');
        return chart && chart.data[0].length >= count && chart.data[1].some(value => value > 1); }}""",
        count,
    )


def test_the_chart_shows_every_count_of_the_converter_and_a_board_that_goes_and_comes_back_is_waited_for(
    open_live, start_board, workshop
):
    sketch = workshop.sketch(STREAM, (r"(?<=SAMPLES_PER_SECOND = )200", "300"))
    board = start_board(sketch, np.arange(1024))
    screen = open_live(board.port)
    screen.choose("shows the last", "5 s")
    wait_for_samples(screen, 100)
    screen.wait(f"() => {{ const x = ({FIND})('raw').data[0]; return x.at(-1) - x[0] < 5.5; }}")
    seen = set()

    def all_counts_seen():  # a loaded machine's board is slow, and 5 s of it may hold fewer than all
        _, raw = screen.line("raw")
        assert np.array_equal(np.diff(raw) % 1024, np.ones(len(raw) - 1)), "a sample is missing, doubled or wrong"
        seen.update(raw)
        return len(seen) == 1024

    wait_until(all_counts_seen, "every count of the converter", pause=0.5)
    screen.page.get_by_role("button", name="Pause", exact=True).click()
    screen.wait("() => [...document.querySelectorAll('label')].some(l => l.textContent === 'live, paused')")
    all_counts_seen()
    _, raw = screen.line("raw")
    screen.shot("live-paused")

    screen.type("process noise q", "0.5")
    screen.type("measurement noise r", "50")
    expected = kalman_filter(raw, FilterParams(0.5, 50.0)).x  # the screen's filter began earlier
    at = "chart.data[chart.series.findIndex(one => one.label === 'filtered')].at(-1)"
    screen.wait(
        f"(last) => {{ const chart = ({FIND})('filtered'); return Math.abs({at} - last) < 1e-6; }}", expected[-1]
    )
    np.testing.assert_allclose(screen.line("filtered")[1][600:], expected[600:], atol=1e-6)
    screen.page.get_by_role("button", name="Live", exact=True).click()
    screen.wait(f"(newest) => ({FIND})('raw').data[1].at(-1) !== newest", raw[-1])
    screen.shot("live")

    board.unplug()
    screen.page.get_by_text("disconnected, waiting").first.wait_for()
    screen.shot("live-unplugged")
    start_board(sketch, np.arange(1024))
    screen.page.get_by_text("connected", exact=True).first.wait_for()
    screen.tab("Source")
    screen.page.get_by_text("reconnects: 1").wait_for()
    screen.shot("live-board-folder")


def test_what_is_sent_to_the_board_is_what_it_computes(open_live, start_board, workshop, tmp_path):
    tuning = Tuning(
        channels=(ChannelTuning("light", "counts", 0.5, 20.0, None, None, "by hand"),), sample_period=0.005
    )
    for name, text in export_tuning(tuning, "arduino").items():
        (tmp_path / name).write_text(text)
    firmware = workshop.sketch(tmp_path / "kalscope_filter.ino", include=[tmp_path])
    counts = np.random.default_rng(8).integers(300, 700, 4000)
    board = start_board(firmware, counts, "--reset-on-open")
    screen = open_live(board.port)
    wait_for_samples(screen, 100)
    screen.wait(f'() => !!({FIND})("board\'s filter")')
    screen.type("process noise q", "0.037")
    screen.type("measurement noise r", "11.3")
    screen.tab("Export")
    screen.page.get_by_role("button", name="Send q, r and p0").click()
    screen.page.get_by_text("The board now uses q = 0.037, r = 11.3, p0 = inf").wait_for()
    screen.page.get_by_text("Equal bit for bit").wait_for()
    screen.page.get_by_role("button", name="Let the board measure r").click()
    screen.page.locator("p", has_text="The sketch on this board cannot measure by itself").wait_for()
    screen.tab("Tune")
    screen.type("process noise q", "0.5")
    screen.tab("Export")
    screen.page.get_by_text(
        "rows since the board took q = 0.037, r = 11.3, p0 = inf. The current values have not been sent."
    ).wait_for()
    screen.shot("sent-to-the-board")
