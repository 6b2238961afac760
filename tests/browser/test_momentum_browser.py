"""The momentum as a user tunes it: typed as a time, moved by its slider, looked at as velocity, and undone."""

from __future__ import annotations

import numpy as np
import pytest
from tests.browser.screen import FIND
from tests.support.waiting import wait_until

from kalscope import FilterParams, kalman_filter, open_source
from kalscope.estimation.request import Request, find_parameters, starting_params
from kalscope.estimation.settings import noise_left
from kalscope_app.session.changes import momentum_at
from kalscope_app.views.goal import MORE_FOLDER


@pytest.fixture
def demo():
    return open_source("demo")


def filtered(recording, momentum):
    """What the chart shows at the starting q and r."""
    z = recording.channel(recording.names[0])
    start = starting_params(z)
    return kalman_filter(z, FilterParams(start.q, start.r, momentum=momentum))


def test_a_click_on_what_each_lag_costs_takes_that_lag(start, demo):
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
    marks, now = screen.line("this filter")
    lag = float(marks[np.isfinite(now)][0])
    assert lag == pytest.approx(wanted, rel=0.05)
    chosen = Request(target={"lag_samples": lag / 20.0})
    z = demo.channel(demo.names[0])
    params = find_parameters(z, chosen).params
    screen.wait_for_line("filtered", kalman_filter(z, params).x, 1e-6)
    assert now[np.isfinite(now)] == pytest.approx(100.0 * noise_left(params), rel=1e-6)


def test_momentum_is_typed_dragged_seen_as_velocity_and_undone(start, demo):
    screen = start("demo")
    screen.page.get_by_role("button", name=MORE_FOLDER).click()
    screen.type("momentum", "off")  # it opens with one
    screen.wait_for_line("filtered", filtered(demo, 0.0).x, 1e-9)
    screen.page.get_by_role("button", name="Add momentum").click()
    screen.text_box("momentum").wait_for()
    screen.wait_for_line("filtered", filtered(demo, float(screen.text_box("momentum").input_value())).x, 1e-9)

    screen.type("momentum", "240 ms")
    expected = filtered(demo, 12.0)
    screen.wait_for_line("filtered", expected.x, 1e-9)
    screen.wait_for_value("momentum", "12")
    screen.page.get_by_text("keeps direction", exact=True).wait_for()

    screen.tab("View")
    screen.page.get_by_label("show velocity").click()
    screen.wait(f"() => ({FIND})('velocity (counts/s)')")
    screen.wait_for_line("velocity (counts/s)", expected.velocity / demo.sample_period, 1e-6)
    screen.shot("momentum")

    screen.tab("Tune")
    screen.page.get_by_role("slider", name="τ, 0 to 5").focus()
    screen.page.keyboard.press("ArrowRight")
    screen.wait_for_line("filtered", filtered(demo, momentum_at(1.12)).x, 1e-9)
    screen.page.keyboard.press("Home")
    screen.wait_for_line("filtered", filtered(demo, 0.0).x, 1e-9)
    screen.wait(f"() => !({FIND})('velocity (counts/s)')")
    screen.page.get_by_role("button", name="Undo").click()
    wait_until(lambda: screen.text_box("momentum").input_value() != "off", "the momentum before the last drag")
