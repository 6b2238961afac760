"""Journeys of a user through the real dashboard, each against numbers computed here."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from effort import FUZZ
from program import command
from screen import FIND, Screen
from waiting import PATIENCE, wait_until

from kalscope import estimate, kalman_filter, open_source, ratio_for, starting_params, steady_state
from kalscope.common.text import lag_text
from kalscope.estimation.request import Noise, Request, find_parameters
from kalscope.estimation.still import find_still_stretch
from kalscope.papers.reproduction import list_experiments, open_experiment
from kalscope_app.views.charts import DARK, LIGHT, range_text
from kalscope_app.views.source import experiment_label

pytestmark = pytest.mark.browser
DEMO = open_source("demo").values[:, 0]


def filtered(z, **params):
    return kalman_filter(z, replace(starting_params(z), **params)).x


WATCH_LAYOUT = """(() => { const panels = window.panels = new Set(), charts = window.charts = new Set();
    const boxes = (query) => JSON.stringify([...document.querySelectorAll(query)]
        .filter(one => one.checkVisibility({ visibilityProperty: true }))
        .map(one => Object.values(one.getBoundingClientRect().toJSON()).map(Math.round)));
    const look = () => { panels.add(boxes('[data-dock-region]')); charts.add(boxes('.uplot'));
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
    screen.type("process noise q", "7")
    screen.wait_for_line("filtered", filtered(DEMO, q=7))
    for _ in range(1 if FUZZ == 1 else 15):
        screen.page.reload(wait_until="commit")
        screen.ready()
        screen.wait_for_line("filtered", filtered(DEMO, q=7))
        screen.wait_for_value("process noise q", "7")
        assert layout(screen) == first
    with Screen(browser, screen.url, script=WATCH_LAYOUT, width=1280, height=720) as second:
        assert layout(second) != first
        second.wait_for_value("process noise q", "7")
        screen.type("process noise q", "8")
        for one in (screen, second):
            one.wait_for_line("filtered", filtered(DEMO, q=8))
        screen.page.set_viewport_size({"width": 1920, "height": 1080})
        for one in (screen, second):
            one.wait_for_fit()


def test_first_look_shows_the_demo_at_its_starting_values_and_a_typed_start_the_matlab_appendix(start):
    screen = start("demo")
    _, raw = screen.line("raw")
    assert np.array_equal(raw, DEMO)
    screen.wait_for_line("filtered", filtered(DEMO))
    result = kalman_filter(DEMO, starting_params(DEMO))
    _, innovation = screen.line("innovation")
    assert np.array_equal(innovation[1:], result.innovation[1:])
    _, high = screen.line("+2√p")
    assert np.allclose(high, result.x + 2 * np.sqrt(result.p), rtol=1e-12)
    screen.page.get_by_text("Resulting filter", exact=True).click()
    for words in ("lag 12.4 ms · noise", "lag (delay)", "12.4 ms", "5.65 dB"):
        screen.page.get_by_text(words).first.wait_for()
    screen.wait_for_fit()
    screen.shot("first-look")

    screen.wait_for_value("initial variance p0", "automatic")
    screen.page.get_by_text("Start and outliers", exact=True).click()
    screen.type("initial variance p0", "0")
    screen.type("initial estimate x0", "0")
    screen.type("measurement noise r", "100")
    screen.type("process noise q", "1")
    screen.wait_for_line("filtered", filtered(DEMO, q=1, r=100, p0=0, x0=0))
    low, high = screen.range("y")
    assert low > 200  # the wild start at 0 leaves the picture; the range follows the signal
    assert high < 800
    screen.shot("start-by-value")
    screen.slider("p0").focus()
    screen.page.keyboard.press("End")
    p0 = 10.0 ** float(screen.slider("p0").get_attribute("aria-valuemax"))
    screen.wait_for_line("filtered", filtered(DEMO, q=1, r=100, p0=p0, x0=0))
    screen.type("initial variance p0", "automatic")
    screen.wait_for_line("filtered", filtered(DEMO, q=1, r=100))


SIDEWAYS = """() => Math.max(...[...document.querySelectorAll(
    '[data-dock-region=left] .mantine-ScrollArea-viewport')].map(one => one.scrollWidth - one.clientWidth))"""
"""How far the control panel can be moved sideways, px."""


def drag_across(screen, first, last):
    """Drag over these shares of the signal chart's width."""
    over = screen.page.locator(".u-over").first.bounding_box()
    y = over["y"] + over["height"] / 2
    screen.page.mouse.move(over["x"] + first * over["width"], y)
    screen.page.mouse.down()
    screen.page.mouse.move(over["x"] + last * over["width"], y, steps=4)
    screen.page.mouse.up()


def test_tuning_by_keys_text_and_mouse_moves_the_curve_and_only_two_gestures_the_zoom(start):
    screen = start("demo")
    screen.wait_for_fit()
    over = screen.page.locator(".u-over").first.bounding_box()
    y = over["y"] + over["height"] / 2
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
    before = screen.text_box("process noise q").input_value()
    screen.page.keyboard.press("End")
    screen.wait_for_line("filtered", shown(q=1e6))
    assert before != "1000000"
    screen.wait_for_value("process noise q", "1000000")

    screen.type("process noise q", "1e-9")
    screen.wait_for_line("filtered", shown(q=1e-9))
    screen.type("measurement noise r", "2,5", enter=False)  # counts when typing rests
    screen.wait_for_line("filtered", shown(q=1e-9, r=2.5))

    screen.type("process noise q", "much")
    screen.notification("q must be a number such as 0.01 or 1e-9 (got 'much')").wait_for()
    screen.type("process noise q", "-1")
    screen.notification("q must be a finite variance from 0 to 1e300 (got -1.0)").wait_for()
    screen.wait_for_line("filtered", shown(q=1e-9, r=2.5))
    assert screen.range("x") == zoom
    screen.shot("tuned-and-zoomed")

    screen.page.get_by_role("button", name="Undo").click()
    screen.wait_for_line("filtered", shown(q=1e-9))
    screen.page.get_by_role("button", name="Redo").click()
    screen.wait_for_line("filtered", shown(q=1e-9, r=2.5))
    screen.page.get_by_role("button", name="Reset", exact=True).click()
    screen.wait_for_line("filtered", shown())
    screen.slider("q").focus()
    screen.page.keyboard.press("Control+z")
    screen.wait_for_line("filtered", shown(q=1e-9, r=2.5))
    screen.page.keyboard.press("Control+Shift+z")
    screen.wait_for_line("filtered", shown())
    assert screen.range("x") == zoom
    reset = screen.page.get_by_role("button", name="Reset view")
    assert reset.bounding_box()["width"] < 120
    for show_all in (lambda: screen.page.mouse.dblclick(over["x"] + 0.4 * over["width"], y), reset.click):
        show_all()
        screen.wait_for_line("filtered", filtered(DEMO))
        assert screen.range("x") == pytest.approx((0.0, end))
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


def test_a_figure_another_sample_its_channels_and_the_generator(start):
    screen = start("demo")
    screen.tab("Source")
    for name in ("generalized_figure_7", "noise_reducer_figure_6", "lis302dl_r_32"):
        experiment = next(one for one in list_experiments() if one.name == name)
        screen.choose("re-created figure", experiment_label(experiment))
        recording, filters = open_experiment(name)
        channel = recording.names[0]
        screen.wait_for_line("filtered", filters[channel].run(recording.channel(channel)).x)
        screen.tab("Tune")
        screen.shot(f"experiment-{name}")
        screen.tab("Source")
    screen.choose("sample", "Nile at Aswan")
    nile = open_source("sample:nile").values[:, 0]
    screen.wait_for_line("filtered", filtered(nile))
    assert screen.range("x") == pytest.approx((1871, 1970))
    screen.shot("nile")
    screen.choose("sample", "Resting LIS302DL (re-creation)")
    axes = open_source("sample:lis302dl")
    screen.wait_for_line("raw", axes.values[:, 0])
    screen.tab("Tune")
    screen.choose("channel", axes.names[2])
    screen.wait_for_line("raw", axes.values[:, 2])
    screen.type("process noise q", "7", enter=False)  # stays with its channel; the later gesture wins
    screen.pause()
    screen.choose("channel", axes.names[1])
    screen.wait_for_line("filtered", filtered(axes.values[:, 1]))
    screen.choose("channel", axes.names[2])
    screen.wait_for_line("filtered", filtered(axes.values[:, 2], q=7))
    screen.tab("Source")
    screen.page.get_by_text("Generate a signal").click()
    screen.choose("shape", "step")
    screen.type("noise σ", "0.2")
    screen.page.get_by_role("button", name="Generate", exact=True).click()
    made = open_source("synthetic:step?sigma=0.2")
    screen.wait_for_line("truth", made.truth[:, 0])
    screen.wait_for_line("filtered", filtered(made.values[:, 0]))
    screen.type("noise σ", "-3")
    screen.page.get_by_role("button", name="Generate", exact=True).click()
    screen.notification("sigma must").wait_for()
    screen.shot("generator")


BAD_FILES = {
    "empty.csv": (b"", "must"),
    "header.csv": (b"time,z\n", "must"),
    "letter.txt": (b"Dear reader,\nthis is a letter.\n", "must"),
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


def test_the_saved_file_reopens_the_same_filter_and_filters_alike_without_a_dashboard(start, tmp_path):
    screen = start("sample:nile")
    screen.type("process noise q", "1469.1")
    screen.type("measurement noise r", "15099")
    nile = open_source("sample:nile").values[:, 0]
    screen.wait_for_line("filtered", filtered(nile, q=1469.1, r=15099))
    screen.tab("Export")
    screen.type("tuning file", "../outside.toml")
    screen.page.get_by_role("button", name="Save tuning file").click()
    screen.notification("must").wait_for()
    screen.type("tuning file", "tuning.toml")
    screen.page.get_by_role("button", name="Save tuning file").click()
    screen.notification(re.compile("Saved")).wait_for()  # the refusal shows a path with "saved"
    screen.shot("export")
    assert not (tmp_path.parent / "outside.toml").exists()
    saved = tomllib.loads((tmp_path / "tuning.toml").read_text())
    channel = saved["channel"][0]
    assert (channel["q"], channel["r"], channel["p0"], channel["x0"]) == (1469.1, 15099.0, "diffuse", "first")

    for button, name in (("Download tuning file", "tuning.toml"), ("Download filtered CSV", "filtered.csv")):
        with screen.page.expect_download() as download:
            screen.page.get_by_role("button", name=button).click()
        assert download.value.suggested_filename == name
        download.value.save_as(tmp_path / f"downloaded-{name}")
    seen = np.genfromtxt(tmp_path / "downloaded-filtered.csv", delimiter=",", names=True)
    assert np.array_equal(seen["volume_filtered"], filtered(nile, q=1469.1, r=15099))

    with command("filter", "sample:nile", "--config", "tuning.toml", "-o", "out.csv", cwd=tmp_path) as headless:
        assert headless.wait(PATIENCE) == 0
    assert (tmp_path / "out.csv").read_bytes() == (tmp_path / "downloaded-filtered.csv").read_bytes()

    again = start("--config", "tuning.toml", own=True)
    again.wait_for_line("filtered", filtered(nile, q=1469.1, r=15099))
    again.wait_for_value("process noise q", "1469.1")


def test_many_samples_are_thinned_for_drawing_only_and_that_is_said(start):
    spec = "synthetic:random_walk?n=200000&sample_period=0.001"
    screen = start(spec)
    z = open_source(spec).values[:, 0]
    time, drawn = screen.line("filtered")
    assert len(time) <= 4000
    at = np.rint(time * 1000).astype(int)
    assert np.allclose(drawn, filtered(z)[at], rtol=0, atol=1e-12)
    screen.page.get_by_text("statistics use all").wait_for()
    drag_across(screen, 0.91, 0.99)
    screen.wait(f"() => ({FIND})('filtered')?.data[0][0] > 179")
    screen.shot("thinned-zoomed")


def test_a_phone_shows_the_signal_behind_the_controls_in_both_themes(start):
    screen = start("synthetic:sine?n=3000&sigma=0.2&seed=1", own=True, width=390, height=844)
    for theme, palette in (("light", LIGHT), ("dark", DARK)):
        if theme == "dark":
            screen.tab("View")
            screen.page.get_by_text("dark theme").click()
            screen.wait("() => document.documentElement.getAttribute('data-mantine-color-scheme') === 'dark'")
            screen.tab("Tune")
        orange = np.array([int(palette.filtered[i : i + 2], 16) for i in (1, 3, 5)])

        def is_drawn(rgb, orange=orange):
            """The line is above the controls, and there is no map beside them."""
            line = np.abs(rgb[:300] - orange).max(axis=2) < 40
            return np.ptp(rgb[600:800, 5:100], axis=(0, 1)).max() < 3 and line.sum() > 500

        screen.wait_for_picture(is_drawn)
        assert screen.page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
        screen.shot(f"390x844-{theme}")


def test_finding_q_and_r_shows_before_and_after_and_can_be_undone(start):
    screen = start("demo")
    screen.page.get_by_role("button", name="too slow").click()
    screen.page.get_by_text("Too slow: raise q").wait_for()
    screen.choose("goal", "best fit")
    screen.page.get_by_role("button", name="Apply", exact=True).click()
    best = estimate(DEMO).params
    screen.wait_for_line("filtered", filtered(DEMO, q=best.q, r=best.r, momentum=best.momentum))
    account = screen.page.get_by_text("Noise and movement can be separated").first
    account.wait_for(state="attached")
    assert not account.is_visible()
    screen.page.get_by_role("button", name="Resulting filter").click()
    account.wait_for()
    screen.page.get_by_role("button", name="Resulting filter").click()
    lag = lag_text(float(steady_state(best).lag_samples), 0.02)
    screen.page.get_by_text(f"Maximum likelihood: lag {lag} leaves").wait_for()
    screen.page.get_by_text("Before: 190 ms, 22 %.").wait_for()
    assert screen.page.evaluate(SIDEWAYS) <= 0
    screen.shot("found")
    screen.page.get_by_role("button", name="Undo").click()
    screen.wait_for_line("filtered", filtered(DEMO))

    screen.choose("goal", "maximum lag")
    screen.type("lag (ms)", "50")  # Enter applies
    r = estimate(DEMO, momentum=0.0).r
    screen.wait_for_line("filtered", filtered(DEMO, q=r * ratio_for(lag_s=0.05, sample_period=0.02), r=r))
    screen.page.get_by_text("50 ms").first.wait_for()

    screen.tab("View")
    screen.page.get_by_text("show smoother (offline bound)").click()
    screen.wait(f"() => ({FIND})('smoother')")
    screen.tab("Check")
    screen.shot("check")


def test_a_record_without_visible_noise_gets_a_verdict_and_its_still_stretch_is_offered(start, tmp_path):
    g = np.random.default_rng(3)
    moved = np.cumsum(np.convolve(g.normal(0, 30, 1205), np.ones(3), "valid")[:1200])
    moved[600:] = moved[599]
    z = np.round(moved + g.normal(0, 1, 1200), 3)
    text = "time (s),z\n" + "".join(f"{i / 10},{one}\n" for i, one in enumerate(z.tolist()))
    (tmp_path / "pause.csv").write_text(text)
    first, last = find_still_stretch(z)
    screen = start("pause.csv")
    before = screen.text_box("process noise q").input_value()
    screen.choose("goal", "best fit")
    screen.page.get_by_role("button", name="Apply", exact=True).click()
    screen.page.get_by_text("Nothing was changed").wait_for()
    assert screen.text_box("process noise q").input_value() == before
    screen.page.locator("div:has(> .kalscope-verdict) + div button").click()  # the reasons
    headline = screen.page.locator("strong", has_text="No noise can be identified").first
    headline.wait_for()
    screen.shot("verdict")
    screen.page.get_by_role("button", name=f"Use the still stretch {first / 10:g} to").click()
    found = find_parameters(z, Request(noise=Noise(still=(first, last)))).params
    screen.wait_for_line("filtered", kalman_filter(z, found).x, 1e-9)
    headline.wait_for(state="detached")
    screen.page.get_by_role("button", name="Undo").click()
    headline.wait_for()
    assert screen.text_box("process noise q").input_value() == before
    screen.choose("goal", "more …")
    screen.wait_for_value("method", "a still stretch, fit q")
    wait_until(lambda: screen.text_box("from (").input_value() == f"{first / 10:g}", "the beginning of the stretch")
    screen.wait_for_value("to (", f"{(last - 1) / 10:g}")


def test_what_the_reader_decided_can_be_decided_otherwise_and_missing_samples_are_drawn_as_gaps(start, tmp_path):
    log = tmp_path / "echo.csv"
    rows = [(i, 400 if i % 4 == 3 or 80 <= i < 120 else 20 + i % 7) for i in range(200)]
    log.write_text("time_ms,distance (cm)\n" + "".join(f"{60 * i},{z}\n" for i, z in rows))
    screen = start("echo.csv")
    screen.tab("Source")
    screen.page.get_by_text("It occurs 80 times").first.wait_for()  # asked, not assumed
    values = np.array([z for _, z in rows], dtype=float)
    screen.wait_for_line("raw", values)
    screen.page.get_by_text("Import options").click()
    screen.type("missing values", "400", enter=False)
    screen.pause()
    screen.page.get_by_role("button", name="Re-import").click()
    known = np.where(values == 400, np.nan, values)
    screen.wait_for_line("filtered", filtered(known), tolerance=1e-12)
    for label in ("raw", "innovation"):
        _, y = screen.line(label)
        assert np.array_equal(np.isfinite(y[1:]), np.isfinite(known[1:]))  # the first sample has no innovation
    screen.page.get_by_text("80 missing").wait_for()
    screen.shot("read-otherwise")
    log.write_text(log.read_text() + "12000,21\n")
    screen.page.get_by_role("button", name="Re-import").click()
    screen.page.get_by_text("201 samples").first.wait_for()
