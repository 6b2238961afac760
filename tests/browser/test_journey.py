"""What a new user wants first, from the first page on, with every press counted: code for a board, at a lag."""

from __future__ import annotations

import shutil

import pytest
from tests.browser.screen import Screen, dashboard
from tests.support.waiting import PATIENCE, wait_until

from kalscope import kalman_filter, open_source
from kalscope.estimation.request import Request, find_parameters
from kalscope_app.program.user_settings import UserSettings

pytestmark = [pytest.mark.browser, pytest.mark.device]
COUNT = "window.clicks = 0; addEventListener('pointerdown', (event) => { clicks += event.isTrusted; }, true);"


def must_be_in_sight(*places):
    """All of them whole, without scrolling."""
    from playwright.sync_api import expect  # absent where these tests are skipped

    for place in places:
        expect(place).to_be_in_viewport(ratio=1, timeout=1000 * PATIENCE)


def test_a_maximum_lag_becomes_a_sketch_that_compiles_in_at_most_six_clicks(browser, workshop, tmp_path):
    with (
        dashboard("demo", cwd=tmp_path, first_run=True) as url,
        Screen(browser, url, width=1280, height=720, script=COUNT) as screen,
    ):
        screen.page.get_by_text("First steps.").wait_for()
        must_be_in_sight(screen.button("Apply"))  # nothing covers it
        screen.button("Got it").click()
        assert screen.text_box("goal").input_value() == "maximum lag"
        screen.text_box("lag (ms)").fill("50")
        screen.wait_for_text("12.4 ms")

        screen.button("Apply").click()
        demo = open_source("demo")
        z, request = demo.values[:, 0], Request(target={"lag_s": 0.05})
        met = find_parameters(z, request, sample_period=demo.sample_period).params
        screen.wait_for_line("filtered", kalman_filter(z, met).x)
        result = screen.page.get_by_text("of the noise").first
        result.wait_for()
        controls = [screen.slider(name) for name in ("q", "r", "p0")]
        chart = screen.page.locator("[data-dock-region=right] .uplot").first
        must_be_in_sight(screen.text_box("goal"), result, *controls, chart)

        screen.tab("Export")
        screen.download("Download code", tmp_path / "code.zip")
        assert screen.page.evaluate("clicks") <= 6
        shutil.unpack_archive(tmp_path / "code.zip", tmp_path / "export")
        (sketch,) = (tmp_path / "export").rglob("*.ino")
        assert workshop.sketch(sketch).flash > 0
        header = "".join(file.read_text() for file in sketch.parent.glob("*.h"))
        assert "lag behind a ramp 2.5 samples = 0.05 s" in header

        wait_until(lambda: UserSettings(tmp_path / "config").has("tour_seen"), "the tour put away")
        screen.page.reload()
        screen.ready()
        assert screen.page.get_by_text("First steps.").count() == 0
