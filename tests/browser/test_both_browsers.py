"""The main journey of a user in Firefox, without WebGL; in `make soak` in Chromium too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.browser.axe import findings
from tests.browser.screen import FIND, Screen, dashboard
from tests.support.effort import FUZZ
from tests.support.line_sender import line_sender
from tests.support.waiting import wait_until

from kalscope import kalman_filter, open_source, steady_state
from kalscope.common.text import lag_text
from kalscope.estimation.request import starting_params
from kalscope_app.views.charts import DARK

pytestmark = pytest.mark.browser
DEMO = open_source("demo")
BROWSERS = ("firefox",) if FUZZ == 1 else ("firefox", "chromium")
"""The other tests take each step of the journey in Chromium."""


@pytest.fixture(params=BROWSERS)
def screen(request, tmp_path):
    """The demo at the printed link in one of the browsers."""
    with dashboard("demo", cwd=tmp_path) as url:
        browser = request.getfixturevalue("browser" if request.param == "chromium" else "firefox")
        with Screen(browser, url, width=1280, height=720) as page:
            page.name = request.param
            yield page


def press(screen, name):
    screen.page.get_by_role("button", name=name, exact=True).click()


def filtered(z, **changed):
    return kalman_filter(z, replace(starting_params(z), **changed)).x


def test_the_main_journey_from_the_link_to_a_phone(screen, tmp_path):
    z = DEMO.values[:, 0]
    np.testing.assert_array_equal(screen.line("raw")[1], z)
    screen.wait_for_line("filtered", filtered(z))
    screen.shot(f"{screen.name}-1-demo")
    move_the_slider_of_q(screen, z)
    names, columns = write_log(tmp_path / "log.csv")
    open_the_file_and_a_channel(screen, names, columns)
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
    screen.page.get_by_text(lag_text(lag, DEMO.sample_period)).first.wait_for()
    screen.shot(f"{screen.name}-2-slider")
    press(screen, "Undo")
    screen.wait_for_value("process noise q", before)
    screen.wait_for_line("filtered", filtered(z))


def where_it_ended(screen, least):
    """The place of the slider, once it is above that of q = `least`: a page shows a drag a moment after its end."""
    place = float(screen.slider("q").get_attribute("aria-valuenow"))
    return place if 10.0**place > least else 0.0


def write_log(path):
    """A log of two channels: their names and values."""
    rng = np.random.default_rng(5)
    names, columns = ("near", "far"), np.round(np.cumsum(rng.normal(0, 1, (2, 400)), axis=1), 3)
    rows = (f"{i / 100:.2f},{a},{b}\n" for i, (a, b) in enumerate(columns.T.tolist()))
    path.write_text(f"time_s,{','.join(names)}\n{''.join(rows)}")
    return names, columns


def open_the_file_and_a_channel(screen, names, columns):
    screen.tab("Source")
    screen.type("path", "log.csv")
    screen.wait_for_line("raw", columns[0])
    screen.choose("channel", names[1])
    screen.wait_for_line("raw", columns[1])
    screen.wait_for_line("filtered", filtered(columns[1]))


def watch_a_board(screen):
    with line_sender(200.0) as address:
        screen.tab("Source")
        screen.type("port", address, enter=False)  # a menu, which would forget it
        press(screen, "Connect")
        screen.wait(f"() => ({FIND})('raw')?.data[1].filter(Boolean).length > 100")
        screen.shot(f"{screen.name}-4-live")
        press(screen, "Disconnect")
        screen.page.get_by_role("button", name="Connect", exact=True).wait_for()


def turn_into_a_phone(screen):
    """The signal stands behind the controls, in the dark theme too."""
    screen.tab("View")
    screen.page.get_by_text("dark theme").click()
    screen.wait("() => document.documentElement.dataset.mantineColorScheme === 'dark'")
    screen.page.set_viewport_size({"width": 390, "height": 844})
    orange = np.array([int(DARK.filtered[i : i + 2], 16) for i in (1, 3, 5)])
    screen.wait_for_picture(lambda rgb: (np.abs(rgb[:300] - orange).max(axis=2) < 40).sum() > 300)
    assert screen.page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
    assert findings(screen.page) == []
    screen.shot(f"{screen.name}-5-phone")
