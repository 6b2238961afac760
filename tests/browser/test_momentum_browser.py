"""The momentum as a user tunes it: typed as a time, moved by its slider, looked at as velocity, and undone."""

from __future__ import annotations

import pytest
from screen import FIND
from waiting import wait_until

from kalscope import FilterParams, kalman_filter, open_source, starting_params
from kalscope_app.session.changes import momentum_at


@pytest.fixture
def demo():
    return open_source("demo")


def filtered(recording, momentum):
    """What the chart shows at the starting q and r."""
    z = recording.channel(recording.names[0])
    start = starting_params(z)
    return kalman_filter(z, FilterParams(start.q, start.r, momentum=momentum))


def test_momentum_is_typed_dragged_seen_as_velocity_and_undone(start, demo):
    screen = start("demo")
    screen.type("momentum", "0")
    screen.wait_for_line("filtered", filtered(demo, 0.0).x, 1e-9)
    screen.text_box("momentum").wait_for(state="detached")
    screen.page.get_by_text("Start and outliers", exact=True).click()
    screen.pause()
    screen.page.get_by_role("button", name="Add momentum").click()
    screen.text_box("momentum").wait_for()
    screen.wait_for_line("filtered", filtered(demo, float(screen.text_box("momentum").input_value())).x, 1e-9)

    screen.type("momentum", "240 ms")
    expected = filtered(demo, 12.0)
    screen.wait_for_line("filtered", expected.x, 1e-9)
    screen.wait_for_value("momentum", "12")
    screen.page.get_by_text("Resulting filter", exact=True).click()
    screen.page.get_by_text("keeps direction", exact=True).wait_for()
    screen.page.locator("label", has_text="τ = 240 ms").wait_for()

    screen.tab("View")
    screen.page.get_by_label("show velocity").click()
    screen.wait(f"() => ({FIND})('velocity (counts/s)')")
    screen.wait_for_line("velocity (counts/s)", expected.velocity / demo.sample_period, 1e-6)
    screen.shot("momentum")

    screen.tab("Tune")
    row = screen.page.locator("label", has_text="τ = 240 ms")
    thumb = screen.page.locator(f'[id="{row.get_attribute("for")}"] [role="slider"]')
    thumb.focus()
    screen.page.keyboard.press("ArrowRight")
    screen.wait_for_line("filtered", filtered(demo, momentum_at(1.12)).x, 1e-9)
    screen.page.keyboard.press("Home")
    screen.wait_for_line("filtered", filtered(demo, 0.0).x, 1e-9)
    screen.wait(f"() => !({FIND})('velocity (counts/s)')")
    screen.page.get_by_role("button", name="Undo").click()
    wait_until(lambda: screen.text_box("momentum").input_value() != "off", "the momentum before the last drag")
    screen.page.locator("label", has_text="τ off").wait_for(state="detached")
