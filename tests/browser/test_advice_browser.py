"""A goal, momentum, and what the verdict advises: taken by a button, seen in the charts, and undone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.browser.screen import FIND, filtered
from tests.support.waiting import wait_until

from kalscope import FilterParams, estimate, kalman_filter, open_source, steady_state
from kalscope.common.text import lag_text
from kalscope.estimation.request import Request, find_parameters, starting_params
from kalscope.estimation.settings import noise_left
from kalscope_app.session.changes import momentum_at

pytestmark = pytest.mark.browser
PERIOD = 0.02  # s, of the demo
DEMO = open_source("demo").values[:, 0]
SPIKY = "synthetic:random_walk?n=3000&sample_period=0.01&sigma=0.2&outliers=0.01&outlier_size=4"
SIDEWAYS = """() => Math.max(...[...document.querySelectorAll(
    '[data-dock-region=left] .mantine-ScrollArea-viewport')].map(one => one.scrollWidth - one.clientWidth))"""
"""How far the control panel can be moved sideways, px."""


def test_a_goal_shows_before_and_after_and_can_be_undone(start):
    screen = start("demo")
    slow = replace(starting_params(DEMO), q=3.0)
    screen.type("process noise q", "3")
    screen.press("too slow")
    screen.page.get_by_text("Too slow: raise q").wait_for()
    screen.choose("goal", "best fit")
    screen.press("Apply")
    best = estimate(DEMO).params
    screen.wait_for_line("filtered", filtered(DEMO, q=best.q, r=best.r, momentum=best.momentum))
    screen.open_more()
    screen.wait_for_text("Noise and movement can be separated")
    before, after = (lag_text(float(steady_state(one).lag_samples), PERIOD) for one in (slow, best))
    screen.page.get_by_text(f"Maximum likelihood: lag {after} leaves").wait_for()
    screen.page.get_by_text(f"Before: {before}").wait_for()
    assert screen.page.evaluate(SIDEWAYS) <= 0
    screen.press("Undo")
    screen.wait_for_line("filtered", filtered(DEMO, q=3.0))

    screen.choose("goal", "maximum lag")
    screen.type("lag (ms)", "50")  # Enter applies
    met = find_parameters(DEMO, Request(target={"lag_s": 0.05}), sample_period=PERIOD).params
    screen.wait_for_line("filtered", kalman_filter(DEMO, met).x)
    screen.wait_for_text("50 ms")
    screen.tab("View")
    screen.page.get_by_text("show smoother (offline bound)").click()
    screen.wait(f"() => ({FIND})('smoother')")


def test_a_click_takes_a_lag_and_momentum_is_typed_dragged_and_seen_as_velocity(start):
    screen = start("demo")
    screen.page.get_by_text("What each lag costs without momentum.").wait_for()  # it opens with one
    x, _ = screen.line("noise left")
    wanted = float(np.exp(np.log(x[[0, -1]]) @ [0.4, 0.6]))  # ms
    at, top = screen.page.evaluate(
        f"""(x) => {{ const chart = ({FIND})('noise left'), box = chart.over.getBoundingClientRect();
        return [box.left + chart.valToPos(x, 'x'), box.top + box.height / 2]; }}""",
        wanted,
    )
    screen.page.mouse.click(at, top)
    screen.page.get_by_text("What each lag costs.").wait_for()  # at this lag momentum would not help

    def marked():
        """Lag and noise left of the filter on screen, ms and %."""
        marks, now = screen.line("this filter")
        return marks[np.isfinite(now)][0], now[np.isfinite(now)][0]

    wait_until(lambda: marked()[0] == pytest.approx(wanted, rel=0.05), "the mark at the lag")
    lag, left = marked()
    params = find_parameters(DEMO, Request(target={"lag_samples": lag / 20.0})).params
    screen.wait_for_line("filtered", kalman_filter(DEMO, params).x, 1e-6)
    assert left == pytest.approx(100.0 * noise_left(params), rel=1e-6)
    screen.press("Undo")

    screen.open_more()
    screen.type("momentum", "off")
    screen.wait_for_line("filtered", filtered(DEMO, momentum=0.0), 1e-9)
    screen.press("Add momentum")
    screen.wait_for_text("keeps direction")
    screen.type("momentum", "240 ms")
    moving = kalman_filter(DEMO, replace(starting_params(DEMO), momentum=12.0))
    screen.wait_for_line("filtered", moving.x, 1e-9)
    screen.wait_for_value("momentum", "12")
    screen.tab("View")
    screen.page.get_by_label("show velocity").click()
    screen.wait(f"() => ({FIND})('velocity (counts/s)')")
    screen.wait_for_line("velocity (counts/s)", moving.velocity / PERIOD, 1e-6)
    screen.tab("Tune")
    screen.page.get_by_role("slider", name="τ, 0 to 5").focus()
    screen.page.keyboard.press("ArrowRight")
    screen.wait_for_line("filtered", filtered(DEMO, momentum=momentum_at(1.12)), 1e-9)
    screen.page.keyboard.press("Home")
    screen.wait_for_line("filtered", filtered(DEMO, momentum=0.0), 1e-9)
    screen.wait(f"() => !({FIND})('velocity (counts/s)')")


def test_advice_is_taken_by_its_button_and_spikes_are_marked(start):
    screen, z = start(SPIKY), open_source(SPIKY).values[:, 0]
    best = estimate(z)
    screen.open_more()
    screen.type("outlier gate", "off")  # it opens with one
    screen.press("spikes")  # the verdict; the reasons stay open
    screen.press("Switch the gate on (4 σ)")
    screen.wait_for_value("outlier gate", "4")
    screen.wait_for_line("filtered", filtered(z, gate=16.0), 1e-9)
    screen.choose("goal", "best fit")
    screen.press("Apply")
    aside = f"set aside ({best.outliers.sum()})"
    screen.wait(f"(name) => ({FIND})(name)", aside)
    assert np.array_equal(np.isfinite(screen.line(aside)[1]), best.outliers)
    screen.wait_for_line("filtered", kalman_filter(z, best.params).x, 1e-9)
    screen.wait_for_value("outlier gate", "4")
    screen.wait_for_text(f"{best.outliers.sum()} of 3\u202f000 samples are spikes")
    screen.wait_for_text("The filter fits")
    screen.press("Undo")
    screen.wait(f"(name) => !({FIND})(name)", aside)


def test_two_speeds_are_added_from_the_verdict_seen_dragged_and_undone(start, tmp_path):
    rng = np.random.default_rng(3)
    x = np.cumsum((rng.random(900) < 0.01) * rng.normal(0.0, 15.0, 900))
    z = np.round(x + rng.normal(size=900), 4)
    rows = "".join(f"{i / 100},{one}\n" for i, one in enumerate(z.tolist()))
    (tmp_path / "steps.csv").write_text(f"t_s,level\n{rows}")
    screen = start("steps.csv")
    screen.press("no filter needed")
    screen.press("Add two speeds")
    params = estimate(z, two_speeds=True).params
    expected = kalman_filter(z, params)
    screen.wait_for_line("filtered", expected.x, 1e-9)
    screen.wait_for_line("probability of moving", expected.moving, 1e-9)
    screen.wait_for_text("Two speeds explain this record clearly better than one.")
    screen.open_more()
    screen.page.get_by_role("slider", name="log₁₀ fast").focus()
    screen.page.keyboard.press("Home")
    screen.wait_for_line("filtered", kalman_filter(z, FilterParams(params.q, params.r)).x, 1e-9)
    screen.wait(f"() => !({FIND})('probability of moving')")
    for _ in range(2):
        screen.press("Undo")
    screen.button("no filter needed").wait_for()
