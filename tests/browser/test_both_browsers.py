"""The main journey of a user in Firefox, without WebGL; the other tests take each of its steps in Chromium."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.browser.screen import FIND, Screen, dashboard, filtered
from tests.support.line_sender import line_sender
from tests.support.waiting import wait_until

from kalscope import open_source, steady_state
from kalscope.common.text import lag_text
from kalscope.estimation.request import starting_params
from kalscope_app.views.charts import DARK

pytestmark = pytest.mark.browser
DEMO = open_source("demo")


def test_the_main_journey_from_the_link_to_a_phone(firefox, tmp_path):
    with dashboard("demo", cwd=tmp_path) as url, Screen(firefox, url, width=1280, height=720) as screen:
        z = DEMO.values[:, 0]
        np.testing.assert_array_equal(screen.line("raw")[1], z)
        screen.wait_for_line("filtered", filtered(z))
        move_the_slider_of_q(screen, z)
        open_a_file_and_a_channel(screen, tmp_path / "log.csv")
        watch_a_board(screen)
        turn_into_a_phone(screen)


def move_the_slider_of_q(screen, z):
    """Drag it; the numbers of the header follow, and Undo takes it back."""
    thumb = screen.slider("q").bounding_box()
    x, y = thumb["x"] + thumb["width"] / 2, thumb["y"] + thumb["height"] / 2
    before = screen.text_box("process noise q").input_value()
    screen.page.mouse.move(x, y)
    screen.page.mouse.down()
    screen.page.mouse.move(x + 25, y)  # in one step: no place between
    screen.page.mouse.up()
    q = float(f"{10.0 ** wait_until(lambda: where_it_ended(screen, 10 * float(before)), pause=0.1):.2e}")
    screen.wait_for_line("filtered", filtered(z, q=q), tolerance=1e-9)
    lag = float(steady_state(replace(starting_params(z), q=q)).lag_samples)
    screen.wait_for_text(lag_text(lag, DEMO.sample_period))
    screen.press("Undo")
    screen.wait_for_value("process noise q", before)
    screen.wait_for_line("filtered", filtered(z))


def where_it_ended(screen, least):
    """The place of the slider, once it is above that of q = `least`: a page shows a drag a moment after its end."""
    place = float(screen.slider("q").get_attribute("aria-valuenow"))
    return place if 10.0**place > least else 0.0


def open_a_file_and_a_channel(screen, log):
    near, far = np.round(np.cumsum(np.random.default_rng(5).normal(0, 1, (2, 400)), axis=1), 3)
    rows = "".join(f"{i / 100:.2f},{a},{b}\n" for i, (a, b) in enumerate(zip(near, far, strict=True)))
    log.write_text(f"time_s,near,far\n{rows}")
    screen.tab("Source")
    screen.type("path", "log.csv")
    screen.wait_for_line("raw", near)
    screen.choose("channel", "far")
    screen.wait_for_line("raw", far)
    screen.wait_for_line("filtered", filtered(far))


def watch_a_board(screen):
    with line_sender(200.0) as address:
        screen.tab("Source")
        screen.type("port", address, enter=False)  # a menu, which would forget it
        screen.press("Connect")
        screen.wait(f"() => ({FIND})('raw')?.data[1].filter(Boolean).length > 100")
        screen.press("Disconnect")
        screen.button("Connect").wait_for()


def turn_into_a_phone(screen):
    """The signal stands behind the controls, in the dark theme too."""
    screen.darken()
    screen.page.set_viewport_size({"width": 390, "height": 844})
    orange = np.array([int(DARK.filtered[i : i + 2], 16) for i in (1, 3, 5)])
    screen.wait_for_picture(lambda rgb: (np.abs(rgb[:300] - orange).max(axis=2) < 40).sum() > 300)
    assert screen.page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
    assert screen.axe_findings() == []
