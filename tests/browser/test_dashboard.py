"""Journeys of a user through the real dashboard, each against numbers computed here."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from tests.browser.screen import FIND, Screen
from tests.support.effort import FUZZ
from tests.support.program import command
from tests.support.waiting import PATIENCE

from kalscope import estimate, kalman_filter, open_source, steady_state
from kalscope.common.text import lag_text
from kalscope.estimation.request import Request, find_parameters, starting_params
from kalscope.papers.reproduction import list_experiments, open_experiment
from kalscope_app.views.charts import range_text
from kalscope_app.views.goal import MORE_FOLDER
from kalscope_app.views.source import experiment_label

pytestmark = pytest.mark.browser
DEMO = open_source("demo").values[:, 0]
Q, R, P0 = "process noise q", "measurement noise r", "initial variance p0"


def filtered(z, **params):
    return kalman_filter(z, replace(starting_params(z), **params)).x


WATCH_LAYOUT = """(() => { const panels = window.panels = new Set(), charts = window.charts = new Set();
    const boxes = (query) => JSON.stringify([...document.querySelectorAll(query)]
        .filter(one => one.checkVisibility({ visibilityProperty: true }))
        .map(one => Object.values(one.getBoundingClientRect().toJSON()).map(Math.round)));
    const look = () => {
        panels.add(boxes('[data-dock-region]')); charts.add(boxes('[data-dock-region=right] .uplot'));
        requestAnimationFrame(look); };
    requestAnimationFrame(look); })();"""
"""Notes, at every picture that a page draws, where its panels and its charts are."""


def layout(screen):
    """The one layout that a page has had since its first picture."""
    screen.wait_for_fit()
    screen.page.wait_for_timeout(500)  # nothing is waited for: nothing must come
    seen = [
        screen.page.evaluate(f"[...window.{name}].filter(one => one !== '[]')") for name in ("panels", "charts")
    ]
    assert list(map(len, seen)) == [1, 1], seen
    return seen


def test_every_load_shows_the_same_values_in_one_layout_from_its_first_picture_on(start, browser):
    screen = start("demo", own=True, script=WATCH_LAYOUT, width=1440, height=900)
    assert np.array_equal(screen.line("raw")[1], DEMO)
    screen.wait_for_line("filtered", filtered(DEMO))
    first = layout(screen)
    screen.type(Q, "7")
    screen.wait_for_line("filtered", filtered(DEMO, q=7))
    for _ in range(1 if FUZZ == 1 else 15):
        screen.page.reload(wait_until="commit")
        screen.ready()
        screen.wait_for_line("filtered", filtered(DEMO, q=7))
        screen.wait_for_value(Q, "7")
        assert layout(screen) == first
    with Screen(browser, screen.url, script=WATCH_LAYOUT, width=1280, height=720) as second:
        assert layout(second) != first
        second.wait_for_value(Q, "7")
        screen.type(Q, "8")
        for one in (screen, second):
            one.wait_for_line("filtered", filtered(DEMO, q=8))
        screen.page.set_viewport_size({"width": 1920, "height": 1080})
        for one in (screen, second):
            one.wait_for_fit()


IN_SIGHT = """() => { const seen = (one) => { const box = one.getBoundingClientRect();
        return one.checkVisibility({ visibilityProperty: true }) && box.height > 1 && box.width > 1 && box.top >= 0
            && box.bottom <= innerHeight; };
    const controls = 'input:not([type=hidden]), textarea, button, [role=slider], [role=button], [role=tablist]';
    return [...document.querySelectorAll(controls)].filter(seen).map(one => one.ariaLabel || one.textContent); }"""
"""The controls that a user sees; a strip of tabs is one."""


def test_the_first_screen_has_at_most_eighteen_controls_and_a_parameter_in_each_row(start, tmp_path):
    calm = np.column_stack([np.arange(40), np.sin(np.arange(40) / 5), np.sin(np.arange(40) / 6)])
    rows = "".join(f"{i},{a:.6f},{b:.6f}\n" for i, a, b in calm)
    (log := tmp_path / "log.csv").write_text(f"time,near,far\n{rows}50,-999,-999\n61,-999,-999\n")
    sources = ("demo", "Map", 0), ("sample:tank_level", "channel", 1), (str(log), "Read -999 as missing", 1)
    for source, name, several in sources:
        screen = start(source, width=1440, height=900)
        screen.wait_for_fit()
        screen.wait(f"(name) => ({IN_SIGHT})().includes(name)", name)  # the names come last
        screen.wait(f"() => ({IN_SIGHT})().some((name) => name.startsWith('log₁₀ q'))")
        controls = screen.page.evaluate(IN_SIGHT)
        assert len(controls) <= 18, controls
        assert "Redo" not in controls  # nothing was undone
        assert screen.page.get_by_role("tab", name="Channels").is_visible() is bool(several)
    screen = start("demo", width=1280, height=720)
    screen.type("lag (ms)", "50")
    result = screen.page.get_by_text("Before: 12.4 ms")
    result.wait_for()
    rows = [(screen.text_box(name), screen.slider(name.split()[-1])) for name in (Q, R, P0)]
    for box, slider in ((box.bounding_box(), slider.bounding_box()) for box, slider in rows):
        assert result.bounding_box()["y"] < slider["y"] < 720
        assert box["x"] + box["width"] < slider["x"]
        assert box["y"] < slider["y"] < box["y"] + box["height"]
    assert screen.page.locator("label", has_text=R).bounding_box()["height"] < 24  # on one line


def test_first_look_shows_the_demo_at_its_starting_values_and_a_start_by_value(start):
    screen = start("demo")
    assert np.array_equal(screen.line("raw")[1], DEMO)
    screen.wait_for_line("filtered", filtered(DEMO))
    result = kalman_filter(DEMO, starting_params(DEMO))
    assert np.array_equal(screen.line("innovation")[1][1:], result.innovation[1:])
    assert np.allclose(screen.line("+2√p")[1], result.x + 2 * np.sqrt(result.p), rtol=1e-12)
    for words in ("12.4 ms", "noise left (−5.65 dB)"):
        screen.page.get_by_text(words).first.wait_for()
    screen.wait_for_fit()
    screen.page.get_by_role("button", name=MORE_FOLDER).click()
    for words in ("4.85 Hz", "0.358", "15 samples"):
        screen.page.get_by_text(words).first.wait_for()
    screen.type(P0, "0")
    screen.type("initial estimate x0", "0")
    screen.type(R, "100")
    screen.type(Q, "1")
    screen.wait_for_line("filtered", filtered(DEMO, q=1, r=100, p0=0, x0=0))
    low, high = screen.range("y")
    assert 200 < low < high < 800  # the wild start at 0 leaves the picture; the range follows the signal
    screen.shot("start-by-value")
    screen.slider("p0").focus()
    screen.page.keyboard.press("End")
    screen.wait_for_line("filtered", filtered(DEMO, q=1, r=100))
    screen.wait_for_value(P0, "automatic")


SIDEWAYS = """() => Math.max(...[...document.querySelectorAll(
    '[data-dock-region=left] .mantine-ScrollArea-viewport')].map(one => one.scrollWidth - one.clientWidth))"""
"""How far the control panel can be moved sideways, px."""


def drag_across(screen, first, last):
    """Drag over these shares of the signal chart's width."""
    over = screen.page.locator("[data-dock-region=right] .u-over").first.bounding_box()
    y = over["y"] + over["height"] / 2
    screen.page.mouse.move(over["x"] + first * over["width"], y)
    screen.page.mouse.down()
    screen.page.mouse.move(over["x"] + last * over["width"], y, steps=4)
    screen.page.mouse.up()


def test_tuning_by_keys_text_and_mouse_moves_the_curve_and_only_two_gestures_the_zoom(start):
    screen = start("demo")
    screen.wait_for_line("filtered", filtered(DEMO))  # the first answer
    screen.wait_for_fit()
    drag_across(screen, 0.25, 0.5)
    screen.wait(f"() => ({FIND})('filtered')?.data[0].length < {len(DEMO) // 2}")  # the window follows the zoom
    zoom = screen.range("x")
    end = (len(DEMO) - 1) / 50
    assert zoom == pytest.approx((0.25 * end, 0.5 * end), abs=0.2)
    screen.page.get_by_text(f"{range_text(*zoom)} s").wait_for()
    seen = slice(round(50 * zoom[0]), round(50 * zoom[1]) + 1)

    def shown(**values):
        return filtered(DEMO, **values)[seen]

    assert screen.range("x", "innovation") == pytest.approx(zoom)

    screen.slider("q").focus()
    screen.page.keyboard.press("End")
    screen.wait_for_line("filtered", shown(q=1e5))
    screen.wait_for_value(Q, "100000")

    screen.type(Q, "1e-9")
    screen.wait_for_line("filtered", shown(q=1e-9))
    screen.type(R, "2,5", enter=False)  # counts when typing rests
    screen.wait_for_line("filtered", shown(q=1e-9, r=2.5))

    screen.type(Q, "much")
    screen.notification("q must be a number such as 0.01 or 1e-9 (got 'much')").wait_for()
    screen.type(Q, "-1")
    screen.notification("q must be a finite variance from 0 to 1e300 (got -1.0)").wait_for()
    screen.wait_for_line("filtered", shown(q=1e-9, r=2.5))
    assert screen.range("x") == zoom
    screen.shot("tuned-and-zoomed")

    screen.page.get_by_role("button", name="Undo").click()
    screen.wait_for_line("filtered", shown(q=1e-9))
    screen.page.get_by_role("button", name="Redo").click()
    screen.wait_for_line("filtered", shown(q=1e-9, r=2.5))
    screen.page.get_by_role("button", name=MORE_FOLDER).click()
    screen.page.get_by_role("button", name="Reset", exact=True).click()
    screen.wait_for_line("filtered", shown())
    screen.slider("q").focus()
    screen.page.keyboard.press("Control+z")
    screen.wait_for_line("filtered", shown(q=1e-9, r=2.5))
    screen.page.keyboard.press("Control+Shift+z")
    screen.wait_for_line("filtered", shown())
    assert screen.range("x") == zoom


def test_a_zoom_is_moved_by_keys_and_ended_by_two_gestures(start):
    screen = start("demo")
    screen.wait_for_fit()
    end = (len(DEMO) - 1) / 50
    drag_across(screen, 0.25, 0.5)
    screen.wait(f"() => ({FIND})('filtered')?.data[0].length < {len(DEMO) // 2}")
    first = screen.range("x")[0]
    screen.page.get_by_role("slider", name="begin of the view").focus()
    screen.page.keyboard.press("ArrowLeft")
    screen.wait(f"(low) => ({FIND})('filtered').data[0][0] < low", first)
    reset = screen.page.get_by_role("button", name="Reset view")
    for show_all in (screen.page.locator("[data-dock-region=right] .u-over").first.dblclick, reset.click):
        reset.wait_for()
        show_all()
        screen.wait_for_line("filtered", filtered(DEMO))
        assert screen.range("x") == pytest.approx((0.0, end))
        reset.wait_for(state="detached")
        drag_across(screen, 0.25, 0.5)
        screen.wait(f"() => ({FIND})('filtered')?.data[0].length < {len(DEMO) // 2}")


def test_the_last_value_of_a_drag_wins(start):
    screen = start("synthetic:random_walk?n=40000&sample_period=0.001")
    z = open_source("synthetic:random_walk?n=40000&sample_period=0.001").values[:, 0]
    time, _ = screen.line("filtered")
    drawn = np.rint(time / time[-1] * (len(z) - 1)).astype(int)
    assert len(drawn) <= 4000
    thumb = screen.slider("q")
    for turn in range(2):
        box = thumb.bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        screen.page.mouse.move(x, y)
        screen.page.mouse.down()
        for step in range(12):
            screen.page.mouse.move(x + (-1) ** turn * 3 * step, y)
        screen.page.mouse.up()
        exponent = float(thumb.get_attribute("aria-valuenow"))
        q = float(f"{10.0**exponent:.2e}")
        screen.wait_for_line("filtered", filtered(z, q=q)[drawn], tolerance=1e-12)


def test_a_figure_another_sample_its_channels_and_a_generated_signal(start):
    screen = start("demo")
    screen.tab("Source")
    experiment = next(one for one in list_experiments() if one.name == "generalized_figure_7")
    screen.choose("sample or figure", experiment_label(experiment))
    recording, filters = open_experiment(experiment.name)
    channel = recording.names[0]
    screen.wait_for_line("filtered", filters[channel].run(recording.channel(channel)).x)
    screen.choose("sample or figure", "Nile at Aswan")
    nile = open_source("sample:nile").values[:, 0]
    screen.wait_for_line("filtered", filtered(nile))
    assert screen.range("x") == pytest.approx((1871, 1970))
    screen.shot("nile")
    screen.choose("sample or figure", "Resting LIS302DL (re-creation)")
    axes = open_source("sample:lis302dl")
    screen.wait_for_line("raw", axes.values[:, 0])
    screen.tab("Tune")
    screen.choose("channel", axes.names[2])
    screen.wait_for_line("raw", axes.values[:, 2])
    screen.type(Q, "7", enter=False)  # stays with its channel; the later gesture wins
    screen.pause()
    screen.choose("channel", axes.names[1])
    screen.wait_for_line("filtered", filtered(axes.values[:, 1]))
    screen.choose("channel", axes.names[2])
    screen.wait_for_line("filtered", filtered(axes.values[:, 2], q=7))
    screen.tab("Source")
    screen.type("path", "synthetic:step?n=500&sigma=0.2")
    made = open_source("synthetic:step?n=500&sigma=0.2")
    screen.wait_for_line("truth", made.truth[:, 0])
    screen.wait_for_line("filtered", filtered(made.values[:, 0]))
    screen.type("path", "synthetic:step?sigma=-3")
    screen.notification("sigma must").wait_for()
    screen.shot("generator")


BAD_FILES = {
    "empty.csv": (b"", "must"),
    "picture.png": (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + bytes(range(256)) * 4, "must"),
}


def test_an_upload_is_read_and_a_bad_one_is_refused_in_words(start, tmp_path):
    screen = start("demo")
    good = tmp_path / "my <img src=x onerror=alert(1)> sensor.csv"
    good.write_text("time,temp <b>\n" + "".join(f"{i / 10},{i % 7}\n" for i in range(50)))
    screen.tab("Source")
    button = screen.page.get_by_role("button", name="Upload a file", disabled=False)
    for name, (content, words) in BAD_FILES.items():
        (tmp_path / name).write_bytes(content)
        button.locator("xpath=preceding-sibling::input").set_input_files(tmp_path / name)
        screen.notification(re.compile(f"{name} {words}")).wait_for()
    screen.shot("bad-uploads")
    screen.upload("Upload a file", good)
    screen.wait_for_line("raw", np.arange(50) % 7)
    assert screen.page.locator("img[src=x]").count() == 0
    screen.shot("upload")


def test_the_tuning_file_reopens_the_same_filter_and_filters_alike_without_a_dashboard(start, tmp_path):
    screen = start("sample:nile")
    screen.type(Q, "1469.1")
    screen.type(R, "15099")
    nile = open_source("sample:nile").values[:, 0]
    screen.wait_for_line("filtered", filtered(nile, q=1469.1, r=15099))
    screen.tab("Export")
    screen.shot("export")
    screen.download("Download tuning file", tmp_path / "tuning.toml")
    downloaded = screen.download("Download filtered CSV")
    with command("filter", "sample:nile", "--config", "tuning.toml", "-o", "out.csv", cwd=tmp_path) as headless:
        assert headless.wait(PATIENCE) == 0
    assert (tmp_path / "out.csv").read_bytes() == downloaded

    again = start("--config", "tuning.toml", own=True)
    again.wait_for_line("filtered", filtered(nile, q=1469.1, r=15099))
    again.wait_for_value(Q, "1469.1")


def test_finding_q_and_r_shows_before_and_after_and_can_be_undone(start):
    screen = start("demo")
    slow = replace(starting_params(DEMO), q=3.0)
    screen.type(Q, "3")
    screen.page.get_by_role("button", name="too slow").click()
    screen.page.get_by_text("Too slow: raise q").wait_for()
    screen.choose("goal", "best fit")
    screen.page.get_by_role("button", name="Apply", exact=True).click()
    best = estimate(DEMO).params
    screen.wait_for_line("filtered", filtered(DEMO, q=best.q, r=best.r, momentum=best.momentum))
    screen.page.get_by_role("button", name=MORE_FOLDER).click()
    screen.page.get_by_text("Noise and movement can be separated").first.wait_for()
    lag = lag_text(float(steady_state(best).lag_samples), 0.02)
    screen.page.get_by_text(f"Maximum likelihood: lag {lag} leaves").wait_for()
    screen.page.get_by_text(f"Before: {lag_text(float(steady_state(slow).lag_samples), 0.02)}").wait_for()
    assert screen.page.evaluate(SIDEWAYS) <= 0
    screen.shot("found")
    screen.page.get_by_role("button", name="Undo").click()
    screen.wait_for_line("filtered", filtered(DEMO, q=3.0))

    screen.choose("goal", "maximum lag")
    screen.type("lag (ms)", "50")  # Enter applies
    met = find_parameters(DEMO, Request(target={"lag_s": 0.05}), sample_period=0.02).params
    screen.wait_for_line("filtered", kalman_filter(DEMO, met).x)
    screen.page.get_by_text("50 ms").first.wait_for()

    screen.tab("View")
    screen.page.get_by_text("show smoother (offline bound)").click()
    screen.wait(f"() => ({FIND})('smoother')")
    screen.tab("Check")
    screen.shot("check")


def test_a_question_about_the_file_is_answered_by_its_button_and_missing_samples_are_gaps(start, tmp_path):
    log = tmp_path / "echo.csv"
    rows = [(i, 400 if i % 6 == 3 or 80 <= i < 100 else 20 + i % 30) for i in range(200)]
    log.write_text("time_ms,distance (cm)\n" + "".join(f"{60 * i},{z}\n" for i, z in rows))
    screen = start("echo.csv", width=1440, height=900)
    values = np.array([z for _, z in rows], dtype=float)
    screen.wait_for_line("raw", values)
    question = screen.page.locator("p", has_text="Is 400 a missing value? It occurs 49 times")
    question.wait_for()
    screen.wait_for_fit()
    screen.shot("question")
    screen.page.get_by_role("button", name="Read 400 as missing").click()
    known = np.where(values == 400, np.nan, values)
    screen.wait_for_line("filtered", filtered(known), tolerance=1e-12)
    screen.wait(f"() => ({FIND})('raw').data[1].some(Number.isNaN)")
    for label in ("raw", "innovation"):
        _, y = screen.line(label)
        assert np.array_equal(np.isfinite(y[1:]), np.isfinite(known[1:]))  # the first sample has no innovation
    screen.page.get_by_text("200 samples · 49 missing").wait_for()
    question.wait_for(state="detached")
    screen.tab("Source")
    screen.wait_for_value("import options", "--missing 400")
    log.write_text(log.read_text() + "12000,21\n")
    screen.page.get_by_role("button", name="Re-import").click()
    screen.page.get_by_text("201 samples").first.wait_for()
    screen.type("import options", "--speed 3", enter=False)
    screen.page.get_by_role("button", name="Re-import").click()
    screen.notification("import options must be some of --delimiter").wait_for()
