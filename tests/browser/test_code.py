"""The folder "Export code": choose, look, copy, save, download; and a refusal that can be read."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest
from screen import Screen, dashboard

from kalscope.export.registry import export_tuning
from kalscope.tuning.tuning import load_tuning

pytestmark = pytest.mark.browser

HOSTILE = "*/ #define <img src=x>"


@pytest.fixture
def screen(browser, tmp_path):
    z = 512 + np.cumsum(np.random.default_rng(3).normal(0, 0.5, 600))
    rows = "".join(f"{i * 0.005:.3f},{value:.3f},{value / 100:.3f}\n" for i, value in enumerate(z))
    (tmp_path / "log.csv").write_text(f"t,{HOSTILE},volts\n{rows}")
    with (
        dashboard("log.csv", cwd=tmp_path) as url,
        Screen(browser, url, width=1280, height=720) as screen,
    ):
        screen.tab("Export")
        yield screen


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
        assert screen.page.get_by_role("button", name="Close").is_visible()
    screen.shot("code-to-copy")
    close_window(screen)

    screen.type("folder", "firmware")
    button(screen, "Save to the folder").click()
    screen.notification("KalscopeFilter.h").wait_for()
    saved = {path.name: without_date(path.read_text()) for path in (tmp_path / "firmware").iterdir()}
    assert saved == expected
    button(screen, "Save to the folder").click()
    screen.notification("the folder must not hold these files yet").wait_for()
    with screen.page.expect_download() as download:
        button(screen, "Download").click()
    assert download.value.suggested_filename == "kalscope-arduino.zip"
    with zipfile.ZipFile(io.BytesIO(download.value.path().read_bytes())) as archive:
        assert {name: without_date(archive.read(name).decode()) for name in archive.namelist()} == expected


def test_a_library_that_is_another_filter_is_refused_in_a_window_that_waits(screen):
    screen.choose("target", "SimpleKalmanFilter")
    screen.page.get_by_text("Refused: SimpleKalmanFilter is a different filter.").wait_for()
    button(screen, "Save to the folder").click()
    screen.page.get_by_role("dialog").get_by_text("its q multiplies the size of the last step").wait_for()
    screen.shot("code-refused")
    close_window(screen)
    screen.choose("target", "Python")
    button(screen, "Preview code").click()
    screen.page.get_by_role("tab", name="with_kalscope.py").wait_for()
    close_window(screen)
