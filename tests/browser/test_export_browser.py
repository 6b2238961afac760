"""The tabs Compare, Noise and Export: what is compared, looked at, copied, downloaded and uploaded again."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest
from tests.browser.screen import FIND, NO_NOTIFICATION, filtered
from tests.support.program import command
from tests.support.waiting import PATIENCE

from kalscope import open_source, steady_state
from kalscope.analysis.alternatives import compare_alternatives
from kalscope.analysis.spectrum import allan_deviation
from kalscope.common.text import frequency
from kalscope.estimation.request import starting_params
from kalscope.export.registry import export_tuning
from kalscope.tuning.file import load_tuning, save_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning

pytestmark = pytest.mark.browser
Q, HOSTILE = "process noise q", "*/ #define <img src=x>"


def test_simpler_filters_are_compared_and_one_of_them_leaves_for_the_board_and_the_report(start):
    screen, demo = start("demo"), open_source("demo")
    z, params = demo.values[:, 0], starting_params(demo.values[:, 0])
    lag, noise = (compare_alternatives(z, params, match=match) for match in ("lag", "noise"))
    screen.wait_for_fit()
    screen.tab("Compare")
    screen.wait_for_line("yours", lag.present.curve)
    screen.wait_for_line("Moving average", lag.others[0].curve)
    screen.wait_for_text(lag.verdict.partition(". ")[0])
    screen.choose("matched by", "the same noise reduction")
    screen.choose("draw", "Median")
    screen.wait_for_line("Median", noise.others[2].curve)
    screen.wait_for_text("At equal noise reduction")
    screen.choose("draw", "all of them")
    screen.wait_for_line("One-euro", noise.others[4].curve)

    screen.tab("Noise")
    cutoff = frequency(steady_state(params, demo.sample_period).cutoff_hz)
    screen.page.get_by_text(f"Cut-off (−3 dB): {cutoff}").wait_for()
    assert screen.page.evaluate(f"() => ({FIND})('removed').scales.x.distr") == 3
    assert {"0.5", "1", "10"} <= set(screen.page.evaluate(f"() => ({FIND})('removed').axes[0]._values"))
    allan = allan_deviation(z, params, demo.sample_period)
    assert np.allclose(screen.line("recording"), (allan.tau, allan.deviation))

    screen.tab("Compare")
    screen.choose("matched by", "the same lag")
    screen.choose("draw", "One-euro")
    screen.wait_for_line("One-euro", lag.others[4].curve)
    screen.press("Export this one")
    screen.page.get_by_role("tab", name="Export", selected=True).wait_for()
    screen.wait_for_text("One-euro (cut-off")
    screen.page.get_by_text("runs now. The comparison is with the Kalman filter of q and r.").wait_for()
    screen.tab("Signal")
    screen.wait_for_line("filtered", lag.others[4].curve)
    screen.tab("Tune")
    screen.page.get_by_text("This filter has no q and r").wait_for()
    assert screen.page.get_by_text(Q).count() == 0
    screen.press("Back to the Kalman filter")
    screen.wait_for_line("filtered", filtered(z))
    screen.wait_for_text(Q)

    screen.tab("Export")
    html = screen.download("Download report").decode()
    assert demo.sha256 in html
    assert "At equal lag, nothing simpler" in html
    sheet = screen.context.new_page()
    sheet.set_content(html)
    assert sheet.pdf(prefer_css_page_size=True).count(b"/Type /Page\n") == 1  # one sheet of A4
    sheet.close()


def without_date(text):
    return [line for line in text.splitlines() if "Made by" not in line]


def test_code_looked_at_is_code_downloaded_and_a_tuning_file_filters_alike_and_comes_back(start, tmp_path):
    z = 512 + np.cumsum(np.random.default_rng(3).normal(0, 0.5, 600))
    rows = "".join(f"{i * 0.005:.3f},{value:.3f},{value / 100:.3f}\n" for i, value in enumerate(z))
    (tmp_path / "log.csv").write_text(f"t,{HOSTILE},volts\n{rows}")
    screen = start("log.csv", width=1280, height=720)
    first = screen.text_box(Q).input_value()
    screen.tab("Export")
    screen.download("Download tuning file", tmp_path / "tuning.toml")
    files = export_tuning(load_tuning(tmp_path / "tuning.toml"), "arduino", channel=HOSTILE, sample_period=0.01)
    expected = {name: without_date(text) for name, text in files.items()}
    screen.type("device sample period (s)", "0.01")
    screen.press("Preview code")
    window = screen.page.get_by_role("dialog")
    for name, lines in expected.items():
        screen.tab(name)
        box = window.locator("textarea:visible")
        assert without_date(box.input_value()) == lines
        place = box.bounding_box()
        assert place["width"] > 900, "too narrow to read code in"
        assert place["height"] > 300, "too low to read code in"
        screen.button("Close").wait_for()
    screen.wait(NO_NOTIFICATION)  # viser's of the download has a bar without a name
    assert screen.axe_findings() == []
    screen.press("Close")
    window.wait_for(state="detached")
    downloaded = screen.download("Download filtered CSV")
    with command("filter", "log.csv", "--config", "tuning.toml", "-o", "out.csv", cwd=tmp_path) as headless:
        assert headless.wait(PATIENCE) == 0
    assert (tmp_path / "out.csv").read_bytes() == downloaded
    with zipfile.ZipFile(io.BytesIO(screen.download("Download code"))) as archive:
        found = {name: without_date(archive.read(name).decode()) for name in archive.namelist()}
    assert found == {f"kalscope_filter/{name}": lines for name, lines in expected.items()}
    screen.choose("target", "JSON")
    screen.type("device sample period (s)", "often")
    screen.press("Preview code")
    screen.wait_for_notice("period must be a number")
    screen.type("device sample period (s)", "")
    screen.choose("target", "ESPHome sensor")
    screen.page.get_by_text("in standard deviations per second").wait_for()

    channels = (ChannelTuning(HOSTILE, "", 0.25, 4.0), ChannelTuning("volts", "", 1e-4, 2e-4))
    save_tuning(Tuning(channels, sample_period=0.01), tmp_path / "mine.toml")
    screen.tab("Source")
    screen.upload("Upload a file", tmp_path / "mine.toml")
    screen.wait_for_notice("Q was multiplied by 0.5")
    screen.tab("Tune")
    screen.wait_for_value(Q, "0.125")
    screen.press("Undo")
    screen.wait_for_value(Q, first)
