"""What three users want, from the first page on, with every press counted. Each reads only what is on screen."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.browser.hand import Hand
from tests.browser.screen import FIND, Screen, dashboard
from tests.support.waiting import wait_until

from kalscope import FilterParams, kalman_filter, open_source
from kalscope.estimation.request import Request, find_parameters
from kalscope_app.program.user_settings import UserSettings
from kalscope_app.views.goal import MORE_FOLDER

pytestmark = pytest.mark.browser
DEMO = open_source("demo")


@pytest.fixture
def first_run(browser, tmp_path):
    """The page of a new user, with the tour."""
    with (
        dashboard("demo", cwd=tmp_path, first_run=True) as url,
        Screen(browser, url, width=1280, height=720) as screen,
    ):
        yield screen


def in_window(screen, *places):
    """Whether all of these are in sight without scrolling."""
    page = screen.page.viewport_size
    boxes = [place.bounding_box() for place in places]
    return all(
        box["x"] >= 0 and box["y"] >= 0 and box["x"] + box["width"] <= page["width"]
        and box["y"] + box["height"] <= page["height"]
        for box in boxes
    )  # fmt: skip


@pytest.mark.device
def test_a_maximum_lag_becomes_a_sketch_that_compiles_in_at_most_six_clicks(first_run, workshop, tmp_path):
    screen, hand, page = first_run, Hand(first_run), first_run.page
    page.get_by_text("First steps.").wait_for()
    assert in_window(screen, page.get_by_role("button", name="Apply", exact=True))  # nothing covers it
    screen.shot("journey-a-1-first-steps")
    hand.press("Got it")
    assert screen.text_box("goal").input_value() == "maximum lag"
    screen.text_box("lag (ms)").fill("50")
    page.get_by_text("12.4 ms").first.wait_for()

    hand.press("Apply")
    z = DEMO.values[:, 0]
    asked = find_parameters(z, Request(target={"lag_s": 0.05}), sample_period=DEMO.sample_period).params
    screen.wait_for_line("filtered", kalman_filter(z, asked).x)
    result = page.get_by_text("of the noise").first
    result.wait_for()
    controls = [screen.slider(name) for name in ("q", "r", "p0")]
    chart = page.locator("[data-dock-region=right] .uplot").first
    assert in_window(screen, screen.text_box("goal"), result, *controls, chart)
    screen.shot("journey-a-3-the-goal-is-met")

    hand.press("Export", "tab")
    with page.expect_download() as download:
        hand.press("Download code")
    screen.shot("journey-a-4-downloaded")
    shutil.unpack_archive(download.value.path(), tmp_path / "export", "zip")
    (sketch,) = (tmp_path / "export").rglob("*.ino")
    assert workshop.sketch(sketch).flash > 0
    header = "".join(file.read_text() for file in sketch.parent.glob("*.h"))
    assert "lag behind a ramp 2.5 samples = 0.05 s" in header
    assert hand.clicks <= 6
    assert hand.seconds <= 60

    wait_until(lambda: UserSettings(tmp_path / "config").has("tour_seen"), "the tour put away")
    page.reload()
    screen.ready()
    assert page.get_by_text("First steps.").count() == 0


@pytest.mark.device
def test_a_board_is_tuned_and_recorded_and_the_recording_keeps_the_tuning(
    start, start_board, stream_sketch, tmp_path
):
    counts = np.rint(512 + 200 * np.sin(np.arange(1024) / 40)).astype(int)
    board = start_board(stream_sketch, counts)
    screen = start("demo", width=1440, height=900)
    hand, page = Hand(screen), screen.page
    hand.press("Source", "tab")
    hand.choose("port", "Other address …")
    hand.type("address", board.port)
    hand.press("Connect")
    page.get_by_role("button", name="Disconnect", exact=True).wait_for()
    screen.wait(f"() => ({FIND})('raw')?.data[1].filter(value => value > 1).length > 200")
    screen.shot("journey-b-1-connected")

    hand.press("Tune", "tab")
    hand.type("lag (ms)", "20")
    page.get_by_text("of the noise").first.wait_for()
    hand.press("Pin")
    screen.wait(f"() => !!({FIND})('A')")
    hand.type("measurement noise r", "50")
    screen.shot("journey-b-2-tuned-and-pinned")
    kept = [screen.text_box(box).input_value() for box in ("process noise q", "measurement noise r")]
    assert kept[1] == "50"

    hand.press("Source", "tab")
    hand.press("Record")
    stop = page.get_by_role("button", name="Stop recording", exact=True)
    stop.wait_for()
    wait_until(lambda: recorded(tmp_path) > 200, "a recording of 200 lines")
    hand.press("Stop recording")
    hand.press("Open the recording")
    page.get_by_text("recording.csv").first.wait_for()
    screen.wait(f"(count) => ({FIND})('raw').data[0].length === count", len(opened(tmp_path)))
    hand.press("Tune", "tab")
    assert [screen.text_box(box).input_value() for box in ("process noise q", "measurement noise r")] == kept
    z = opened(tmp_path).values[:, 0]
    page.get_by_role("button", name=MORE_FOLDER).click()
    page.get_by_text("lag (delay)", exact=True).wait_for()  # the folder is open
    moving = page.get_by_text("keeps direction", exact=True).count()
    tau = float(screen.text_box("momentum").input_value()) if moving else 0.0
    screen.wait_for_line("filtered", kalman_filter(z, FilterParams(*map(float, kept), momentum=tau)).x, 1e-5)
    screen.wait(f"() => !!({FIND})('A')")
    screen.shot("journey-b-3-the-recording-keeps-them")
    assert hand.clicks <= 16


def recorded(folder: Path) -> int:
    """Lines of the recording so far."""
    file = folder / "recording.csv"
    return len(file.read_text().splitlines()) if file.exists() else 0


def opened(folder: Path):
    return open_source(str(folder / "recording.csv"))
