"""The folder "Export code": choose, look, copy, save, download; and a refusal that can be read."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest
from axe import findings
from waiting import wait_until

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


def close_window(screen):
    window = screen.page.get_by_role("dialog")
    window.get_by_role("button", name="Close").click()
    window.wait_for(state="detached")


def without_date(text):
    return [line for line in text.splitlines() if "Made by" not in line]


def test_the_code_that_is_looked_at_is_the_code_that_is_saved_and_downloaded(screen, tmp_path):
    button(screen, "Save tuning file").click()
    screen.notification("Saved").wait_for()
    tuning = load_tuning(tmp_path / "tuning.toml")
    expected = {
        name: without_date(text)
        for name, text in export_tuning(tuning, "arduino", channel=HOSTILE, sample_period=0.01).items()
    }
    screen.type("device sample period (s)", "0.01")
    button(screen, "Preview code").click()
    for name, lines in expected.items():
        screen.page.get_by_role("tab", name=name, exact=True).click()
        box = screen.page.get_by_role("dialog").locator("textarea:visible")
        assert without_date(box.input_value()) == lines
        place = box.bounding_box()
        assert place["width"] > 900, "too narrow to read code in"
        assert place["height"] > 300, "too low to read code in"
        screen.page.get_by_role("button", name="Close").wait_for()
    assert findings(screen.page) == []
    screen.shot("code-to-copy")
    close_window(screen)

    screen.type("folder", "firmware")
    button(screen, "Save to the folder").click()
    screen.notification("KalscopeFilter.h").wait_for()
    sketch = tmp_path / "firmware" / "kalscope_filter"
    assert {path.name: without_date(path.read_text()) for path in sketch.iterdir()} == expected
    with screen.page.expect_download() as download:
        button(screen, "Download").click()
    assert download.value.suggested_filename == "kalscope_filter.zip"
    with zipfile.ZipFile(io.BytesIO(download.value.path().read_bytes())) as archive:
        found = {name: without_date(archive.read(name).decode()) for name in archive.namelist()}
    assert found == {f"kalscope_filter/{name}": lines for name, lines in expected.items()}


def test_a_second_save_asks_before_it_overwrites(screen, tmp_path):
    button(screen, "Save to the folder").click()
    screen.notification("Saved KalscopeFilter.h, kalscope_filter.ino in export/kalscope_filter").wait_for()
    header = tmp_path / "export" / "kalscope_filter" / "KalscopeFilter.h"
    whole = without_date(header.read_text())
    header.write_text("mine")
    button(screen, "Save to the folder").click()
    screen.page.get_by_role("dialog").get_by_text("These files exist in export").wait_for()
    screen.shot("code-overwrite")
    button(screen, "Choose another folder").click()
    screen.page.get_by_role("dialog").wait_for(state="detached")
    assert header.read_text() == "mine"
    button(screen, "Save to the folder").click()
    button(screen, "Overwrite").click()
    screen.page.get_by_role("dialog").wait_for(state="detached")
    wait_until(lambda: without_date(header.read_text()) == whole)

    path = tmp_path / "kept.toml"
    screen.type("tuning file", path.name)
    other = Tuning((ChannelTuning("other", "", 1.0, 2.0),))
    save_tuning(other, path)
    button(screen, "Save tuning file").click()
    button(screen, "Choose another name").click()
    screen.page.get_by_role("dialog").wait_for(state="detached")
    assert load_tuning(path).channels[0].name == "other"
    button(screen, "Save tuning file").click()
    button(screen, "Overwrite").click()
    wait_until(lambda: load_tuning(path).channels[0].name == HOSTILE)
    save_tuning(other, path)
    button(screen, "Save tuning file").click()  # its own file by now
    wait_until(lambda: load_tuning(path).channels[0].name == HOSTILE)


def test_a_tuning_file_is_uploaded_and_undone_and_a_refusal_is_told(screen, tmp_path):
    screen.tab("Tune")
    start = screen.text_box("process noise q").input_value()
    channels = (ChannelTuning(HOSTILE, "", 0.25, 4.0), ChannelTuning("volts", "", 1e-4, 2e-4))
    save_tuning(Tuning(channels, sample_period=0.01), tmp_path / "mine.toml")
    screen.tab("Export")
    screen.upload("Upload tuning file", tmp_path / "mine.toml")
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
