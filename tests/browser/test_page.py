"""The page that anyone can open, from a file, in both browsers: its filter is that of the core."""

from __future__ import annotations

import math
import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from kalscope import FilterParams, Recording, estimate, kalman_filter, open_source, steady_state
from kalscope.export.page import make_page
from kalscope.tuning.tuning import ChannelTuning

pytestmark = pytest.mark.browser
RUN = """() => ({
  z: Array.from(kalscope.channel().z, String),
  x: Array.from(kalscope.filtered(kalscope.channel().z, kalscope.params()), String),
  settled: kalscope.settled(kalscope.params()),
})"""
SAMPLES = ("nile", "hot_water", "flex_finger", "tank_level", "ldr_pwm", "lis302dl")


@pytest.fixture(params=["browser", "firefox"])
def visit(request, tmp_path):
    """Open a page of text as a file; what it reports as an error fails the test."""
    context = request.getfixturevalue(request.param).new_context(viewport={"width": 390, "height": 844})
    tab, errors = context.new_page(), []
    tab.on("pageerror", lambda error: errors.append(str(error)))
    tab.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)

    def open_page(text):
        (tmp_path / "page.html").write_text(text, encoding="utf-8")
        tab.goto((tmp_path / "page.html").as_uri())
        return tab

    yield open_page
    context.close()
    assert not errors


def page_of(z, params, *names):
    names = names or ("flex",)
    recording = replace(Recording.of_samples(z), names=names, sample_period=0.02, time=0.02 * np.arange(len(z)))
    return make_page(recording, [ChannelTuning.of_params(name, "counts", params, "") for name in names])


def says(tab, words):
    tab.locator("#message", has_text=words).wait_for()


def test_its_filter_lag_and_noise_are_those_of_the_core(visit):
    z = np.round(open_source("demo").values[:, 0], 2)
    z[[0, 7, 8]] = np.nan
    one = {"q": 3.7, "r": 211.3}
    for params in (
        FilterParams(**one),
        FilterParams(**one, p0=5.0, gate=9.0),
        FilterParams(**one, p0=5.0, x0=300.0),
        FilterParams(**one, momentum=8.66),
        FilterParams(**one, momentum=400.0, p0=2.0),
        FilterParams(q=1e-9, r=1.0, momentum=30.0),
    ):
        tab = visit(page_of(z, params))
        tab.wait_for_function("() => document.querySelector('.u-over')")
        shown = tab.evaluate(RUN)
        np.testing.assert_array_equal(np.array(shown["z"], float), z)
        expected, x = kalman_filter(z, params).x, np.array(shown["x"], float)
        if params.momentum:  # Math.exp of a browser may differ in the last digit
            np.testing.assert_allclose(x, expected, rtol=1e-12)
        else:
            np.testing.assert_array_equal(x, expected)
        steady = steady_state(params)
        assert shown["settled"]["lag"] == pytest.approx(steady.lag_samples, rel=1e-9)
        assert -20.0 * np.log10(shown["settled"]["noise"]) == pytest.approx(steady.noise_reduction_db, rel=1e-9)


def test_a_slider_a_goal_and_the_keyboard_change_the_filter_and_reset_takes_it_back(visit):
    tab = visit(page_of(open_source("demo").values[:, 0], FilterParams(q=3.0, r=300.0)))
    lag = tab.locator("#lag")
    tab.wait_for_function("() => document.querySelector('#lag').textContent")
    before = lag.inner_text()
    tab.focus("#q-slider")
    tab.keyboard.press("ArrowLeft")
    tab.wait_for_function(f"() => document.querySelector('#lag').textContent !== '{before}'")
    assert tab.evaluate("kalscope.params().q") == pytest.approx(3.0 * 10**-0.05)
    tab.fill("#max-lag", "50")
    tab.keyboard.press("Enter")
    tab.wait_for_function("() => document.querySelector('#lag').textContent === '50 ms'")
    tab.locator("#r-box").select_text()
    tab.keyboard.type("-1")
    tab.keyboard.press("Enter")
    says(tab, "measurement noise r must be a number above 0 (got -1)")
    tab.click("#reset")
    tab.wait_for_function(f"() => document.querySelector('#lag').textContent === '{before}'")


@pytest.mark.parametrize("visit", ["firefox"], indirect=True)  # Chromium without a compiler: ten times slower
def test_a_pasted_table_is_fitted_as_the_core_fits_it(visit):
    tab = visit(make_page())
    for name in SAMPLES:
        recording = open_source(f"sample:{name}")
        header = ",".join(("time (s)", *recording.names))
        rows = np.column_stack([recording.time, recording.values]).tolist()
        lines = [",".join("" if math.isnan(cell) else repr(cell) for cell in row) for row in rows]
        tab.fill("#paste", "\n".join([header, *lines]))
        tab.click("#read")
        names = tab.evaluate("kalscope.opened().channels.map((one) => one.name)")
        assert len(names) == len(recording.names)
        for i in range(len(names)):
            expected = estimate(recording.values[:, i], momentum=0, robust=False)
            fit = tab.evaluate("(i) => kalscope.bestFit(kalscope.opened().channels[i].z)", i)
            if fit is None:
                assert expected.q == 0.0 or expected.r < 1e-3 * expected.q, name
            else:
                assert (fit["q"], fit["r"]) == pytest.approx((expected.q, expected.r), rel=1e-4), name


TABLES = {
    "t;a;b\n0;1,5;2\n1;2,5;3\n2;3,5;4\n": (["a", "b"], [1.5, 2.5, 3.5]),
    "# log\n512 7\n514 9\n511 8\n": (["column 1", "column 2"], [512, 514, 511]),
    "flex (counts)\n1\nnan\n3\n": (["flex"], [1, None, 3]),
    "time (ms)\taccel\n0\t1\n20\t\n40\t3\n": (["accel"], [1, None, 3]),
}


def test_simple_tables_are_read_and_others_are_refused_with_what_they_must_be(browser):
    with browser.new_context() as context:
        tab = context.new_page()
        tab.set_content(make_page())
        read = "(text) => kalscope.readTable(text).channels.map(({ name, z }) => [name, Array.from(z)])"
        for text, (names, first) in TABLES.items():
            channels = tab.evaluate(read, text)
            assert [name for name, _ in channels] == names
            assert [None if math.isnan(z) else z for z in channels[0][1]] == first
        tab.fill("#paste", "<b>no</b> table\nat all, here\n")
        tab.click("#read")
        says(tab, "must have a row for each sample")


def test_hostile_names_and_numbers_neither_run_nor_break_the_page(visit):
    name = "</script><img src=x onerror=alert(1)>${q}\n*/ \\"
    z = np.array([[1e308, np.nan], [-1e308, np.nan], [3.0, np.nan], [np.nan, np.nan]] * 10)
    tab = visit(page_of(z, FilterParams(q=1e-300, r=1e300), name, "empty"))
    tab.wait_for_function("() => document.querySelector('.u-over')")
    tab.select_option("#channel", "1")
    says(tab, "empty has no samples")
    assert tab.locator("img").count() == 0
    assert re.search(r"^// Kalman filter of .*$", tab.inner_text("#text"), re.MULTILINE)


C_MAIN = '#include <stdio.h>\nint main() { double z; while (scanf("%lf", &z) == 1) printf("%.17g\\n", kalman(z)); }'


def test_the_code_that_is_copied_is_the_same_filter(browser, tmp_path):
    z = open_source("demo").values[:200, 0].copy()
    z[[3, 50]] = np.nan
    with browser.new_context() as context:
        tab = context.new_page()
        for params in ({}, {"momentum": 8.0, "gate": 2.0}, {"p0": 5.0, "gate": 0.5}, {"p0": 5.0, "x0": 300.0}):
            one = FilterParams(q=30.0, r=300.0, **params)
            tab.set_content(page_of(z, one))
            tab.wait_for_function("() => document.querySelector('.u-over')")
            copied = "(language) => kalscope.codeOf(language, kalscope.params(), 'x', 0.02)"
            expected, names = kalman_filter(z, one).x, {}
            exec(tab.evaluate(copied, "Python"), names)
            np.testing.assert_allclose([names["kalman"](one) for one in z.tolist()], expected, rtol=1e-11)
            (tmp_path / "main.c").write_text(tab.evaluate(copied, "C") + C_MAIN)
            run("gcc", "-O0", "-o", "main", "main.c", "-lm", cwd=tmp_path)
            out = run(tmp_path / "main", input="\n".join(map(repr, z.tolist()))).stdout
            np.testing.assert_allclose(np.array(out.split(), float), expected, rtol=1e-11)


def run(*command, **options):
    return subprocess.run(command, check=True, capture_output=True, text=True, **options)
