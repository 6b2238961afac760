"""The tabs Compare, Spectrum and Allan and the report, as the user sees them."""

from __future__ import annotations

import numpy as np
import pytest
from tests.browser.screen import FIND

from kalscope import kalman_filter, open_source, steady_state
from kalscope.analysis.alternatives import compare_alternatives
from kalscope.analysis.spectrum import allan_deviation
from kalscope.common.text import frequency
from kalscope.estimation.request import starting_params

pytestmark = pytest.mark.browser


def test_simpler_filters_spectrum_and_allan_deviation(start):
    screen = start("demo")
    demo = open_source("demo")
    z = demo.values[:, 0]
    params = starting_params(z)
    found = {match: compare_alternatives(z, params, match=match) for match in ("lag", "noise")}

    screen.wait_for_fit()
    screen.tab("Compare")
    screen.wait_for_line("yours", found["lag"].present.curve)
    screen.wait_for_line("Moving average", found["lag"].others[0].curve)
    screen.page.get_by_text(found["lag"].verdict.partition(". ")[0]).first.wait_for()
    screen.choose("matched by", "the same noise reduction")
    screen.choose("draw", "Median")
    screen.wait_for_line("Median", found["noise"].others[2].curve)
    screen.page.get_by_text("At equal noise reduction").first.wait_for()
    screen.choose("draw", "all of them")
    screen.wait_for_line("One-euro", found["noise"].others[4].curve)
    screen.shot("compare-all")

    screen.tab("Noise")
    cutoff = frequency(steady_state(params, demo.sample_period).cutoff_hz)
    screen.page.get_by_text(f"Cut-off (−3 dB): {cutoff}").wait_for()
    assert screen.page.evaluate(f"() => ({FIND})('removed').scales.x.distr") == 3
    ticks = screen.page.evaluate(f"() => ({FIND})('removed').axes[0]._values")
    assert {"0.5", "1", "10"} <= set(ticks)
    screen.shot("noise-light")
    allan = allan_deviation(z, params, demo.sample_period)
    x, y = screen.line("recording")
    assert np.allclose(x, allan.tau)
    assert np.allclose(y, allan.deviation)


def test_a_filter_of_compare_leaves_for_the_board_and_the_kalman_filter_comes_back(start):
    screen = start("demo")
    demo = open_source("demo")
    params = starting_params(demo.values[:, 0])
    alternative = {one.name: one for one in compare_alternatives(demo.values[:, 0], params).others}
    euro = alternative["One-euro"]

    screen.wait_for_line("filtered", kalman_filter(demo.values[:, 0], params).x)
    screen.tab("Compare")
    screen.choose("draw", "One-euro")
    screen.wait_for_line("One-euro", euro.curve)
    assert screen.page.get_by_role("button", name="Settings of this one").is_visible()
    screen.choose("draw", "Exponential")
    screen.wait_for_line("Exponential", alternative["Exponential"].curve)
    screen.page.get_by_role("button", name="Settings of this one").click()
    screen.page.get_by_role("tab", name="Home Assistant lowpass").click()
    shown = screen.page.get_by_role("textbox", name="Home Assistant lowpass")
    screen.shot("settings")
    assert "time_constant: " in shown.input_value()
    screen.page.get_by_role("button", name="Close").click()
    screen.choose("draw", "One-euro")
    screen.wait_for_line("One-euro", euro.curve)
    screen.page.get_by_role("button", name="Export this one").click()
    screen.page.get_by_role("tab", name="Export", selected=True).wait_for()
    screen.page.get_by_text("One-euro (cut-off").first.wait_for()
    screen.page.get_by_text("runs now. The comparison is with the Kalman filter of q and r.").wait_for()
    screen.tab("Signal")
    screen.wait_for_line("filtered", euro.curve)
    screen.tab("Tune")
    screen.page.get_by_text("This filter has no q and r").wait_for()
    assert screen.page.get_by_text("process noise q").count() == 0
    screen.page.get_by_role("button", name="Back to the Kalman filter").click()
    screen.wait_for_line("filtered", kalman_filter(demo.values[:, 0], params).x)
    screen.page.get_by_text("process noise q").first.wait_for()


def test_the_report_is_one_sheet_of_paper(start):
    screen = start("demo")
    screen.tab("Export")
    with screen.page.expect_download() as page:
        screen.page.get_by_role("button", name="Download report").click()
    html = page.value.path().read_text(encoding="utf-8")
    assert open_source("demo").sha256 in html
    assert "At equal lag, nothing simpler" in html
    sheet = screen.context.new_page()
    sheet.set_content(html)
    assert sheet.pdf(prefer_css_page_size=True).count(b"/Type /Page\n") == 1  # one sheet of A4
    sheet.close()
