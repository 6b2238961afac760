"""The Export tab: choose, look, copy, download; and a refusal that can be read."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest
from tests.browser.axe import findings
from tests.support.waiting import wait_until

from kalscope.export.registry import export_tuning
from kalscope.tuning.file import load_tuning, save_tuning
from kalscope.tuning.tuning import ChannelTuning, Tuning

pytestmark = pytest.mark.browser

HOSTILE = "*/ #define <img src=x>"


@pytest.fixture
def screen(start, tmp_path):
    z = 512 + np.cumsum(np.random.default_rng(3).normal(0, 0.5, 600))
    rows = "".join(f"{i * 0.005:.3f},{value:.3f},{value / 100:.3f}\n" for i, value in enumerate(z))
    (tmp_path / "log.csv").write_text(f"t,{HOSTILE},volts\n{rows}")
    screen = start("log.csv", width=1280, height=720)
    screen.tab("Export")
    return screen


def button(screen, name):
    return screen.page.get_by_role("button", name=name, exact=True)


def without_date(text):
    return [line for line in text.splitlines() if "Made by" not in line]


def test_the_code_that_is_looked_at_is_the_code_that_is_downloaded(screen, tmp_path):
    screen.download("Download tuning file", tmp_path / "tuning.toml")
    tuning = load_tuning(tmp_path / "tuning.toml")
    expected = {
        name: without_date(text)
        for name, text in export_tuning(tuning, "arduino", channel=HOSTILE, sample_period=0.01).items()
    }
    screen.type("device sample period (s)", "0.01")
    button(screen, "Preview code").click()
    window = screen.page.get_by_role("dialog")
    for name, lines in expected.items():
        screen.page.get_by_role("tab", name=name, exact=True).click()
        box = window.locator("textarea:visible")
        assert without_date(box.input_value()) == lines
        place = box.bounding_box()
        assert place["width"] > 900, "too narrow to read code in"
        assert place["height"] > 300, "too low to read code in"
        button(screen, "Close").wait_for()
    screen.page.get_by_role("progressbar").wait_for(state="hidden")  # viser's of the download, without a name
    assert findings(screen.page) == []
    screen.shot("code-to-copy")
    button(screen, "Close").click()
    window.wait_for(state="detached")
    with zipfile.ZipFile(io.BytesIO(screen.download("Download code"))) as archive:
        found = {name: without_date(archive.read(name).decode()) for name in archive.namelist()}
    assert found == {f"kalscope_filter/{name}": lines for name, lines in expected.items()}


def test_a_tuning_file_is_uploaded_and_undone_and_a_refusal_is_told(screen, tmp_path):
    screen.tab("Tune")
    start = screen.text_box("process noise q").input_value()
    channels = (ChannelTuning(HOSTILE, "", 0.25, 4.0), ChannelTuning("volts", "", 1e-4, 2e-4))
    save_tuning(Tuning(channels, sample_period=0.01), tmp_path / "mine.toml")
    screen.tab("Source")
    screen.upload("Upload a file", tmp_path / "mine.toml")
    screen.notification("Q was multiplied by 0.5").wait_for()
    screen.tab("Tune")
    wait_until(lambda: screen.text_box("process noise q").input_value() == "0.125")
    button(screen, "Undo").click()
    wait_until(lambda: screen.text_box("process noise q").input_value() == start)

    screen.tab("Export")
    screen.choose("target", "JSON")
    screen.type("device sample period (s)", "often")
    button(screen, "Preview code").click()
    screen.notification("Period must be a number").wait_for()
    screen.shot("code-refused")
    screen.type("device sample period (s)", "")
    screen.choose("target", "ESPHome sensor")
    screen.page.get_by_text("in standard deviations per second").wait_for()
