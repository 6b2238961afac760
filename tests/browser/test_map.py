"""The tuning map as the user works with it: what the mouse does to the filtered curve; it fits every window."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from PIL import Image
from tests.browser.screen import pixels
from tests.support.waiting import wait_until

from kalscope import kalman_filter, open_source
from kalscope.estimation.request import starting_params
from kalscope_app.engine.filter_runs import Cache
from kalscope_app.session.opening import opened
from kalscope_app.studies.tuning_map import MapFrame, compute_map
from kalscope_app.views.map import draw_map_picture
from kalscope_app.views.window import LEFT_WIDTH

pytestmark = pytest.mark.browser
LONG = "synthetic:random_walk?n=40000&sample_period=0.001"

CANVAS = """() => { const box = [...document.querySelectorAll('canvas')]
    .filter(canvas => !canvas.closest('.uplot'))
    .map(canvas => canvas.getBoundingClientRect()).sort((a, b) => b.width * b.height - a.width * a.height)[0];
    return [box.left, box.top, box.width, box.height]; }"""


class MapScreen:
    """A page whose canvas holds the map of `source`."""

    def __init__(self, screen, source):
        self.screen = screen
        self.state = opened(open_source(source))
        self.map = compute_map(self.state, Cache())
        self.frame, self.size = self.map.frame, (MapFrame.width, MapFrame.height)
        self.picture = cache(lambda dark: draw_map_picture(self.state.with_view(dark=dark), self.map))
        if not self.button("Hide map").count():
            self.press("Map")
        self.wait(f"() => ({CANVAS})()[2] > 200")
        self.wait_for_map()

    def __getattr__(self, name):
        """What the page has."""
        return getattr(self.screen, name)

    def wait_for_map(self):
        """Until the map is drawn and fits its canvas: the picture comes after the charts."""
        self.wait_for_fit()
        self.wait_for_picture(self.is_drawn)

    def look(self):
        """The pixels of the page without the pointer."""
        self.page.mouse.move(2, 2)
        return pixels(self.page.screenshot())

    def is_drawn(self, rgb):
        """Whether these pixels are those of the picture in the theme of the page, but for the mark."""
        scheme = self.page.evaluate("() => document.documentElement.dataset.mantineColorScheme")
        whole = Image.fromarray(self.picture(scheme == "dark"))
        (left, top), (right, bottom) = (np.rint(self.on_page(*at)).astype(int) for at in ((0, 0), self.size))
        expected = np.asarray(whole.resize((right - left, bottom - top), Image.Resampling.BOX)).astype(int)
        return np.abs(rgb[top:bottom, left:right] - expected).mean() < 4

    def at(self, q, r):
        """Page pixel of a pair."""
        return self.on_page(*self.frame.pixel((np.log10(q), np.log10(r))))

    def on_page(self, x, y):
        """Page pixel of a pixel of the picture, which is shrunk to fit into the middle of the canvas."""
        left, top, width, height = self.page.evaluate(CANVAS)
        scale = min(width / self.size[0], height / self.size[1])
        x, y = scale * (x - 0.5 * self.size[0]), scale * (y - 0.5 * self.size[1])
        return left + 0.5 * width + x, top + 0.5 * height + y


def test_dragging_the_point_tunes_live_as_one_gesture_and_the_last_value_of_a_dragged_slider_wins(start):
    screen = MapScreen(start(LONG), LONG)
    z = open_source(LONG).values[:, 0]
    time, _ = screen.line("filtered")
    drawn = np.rint(time / time[-1] * (len(z) - 1)).astype(int)
    first = starting_params(z)
    q, r = first.q, first.r

    def wait_for(q, r, decades=1e-6):
        wait_until(lambda: is_filter_of(q, r, decades), f"the filter of about {q:.3g} and {r:.3g}", pause=0.1)

    def is_filter_of(q, r, decades=1e-6):
        """Whether about this pair stands in the boxes, and the curve is the filter of it."""
        now = screen.q_and_r()
        expected = kalman_filter(z, replace(first, q=now[0], r=now[1])).x[drawn]
        near = pytest.approx(np.log10([q, r]), abs=decades)
        # A line has fewer points until a control has rested, hence the comparison by shape as well.
        return np.log10(now) == near and screen.line("filtered")[1] == pytest.approx(expected, rel=0, abs=1e-4)

    wait_for(q, r)
    beside = np.array([6, -5])  # a drag that begins near the mark takes hold of it, as it is
    x, y = screen.at(q, r) + beside
    to_x, to_y = screen.at(100 * q, r / 30) + beside
    screen.page.mouse.move(x, y)
    screen.page.mouse.down()
    for step in range(1, 17):
        screen.page.mouse.move(x + (to_x - x) * step / 16, y + (to_y - y) * step / 16)
        if step == 8:
            wait_for(10 * q, r / 30**0.5, 0.1)
            screen.page.wait_for_timeout(1500)  # a rest with the button held does not end the gesture
    screen.page.mouse.up()
    wait_for(100 * q, r / 30, 0.05)
    screen.press("Undo")
    wait_for(q, r)

    thumb = screen.slider("q")
    for way in (1, -1):
        box = thumb.bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        screen.page.mouse.move(x, y)
        screen.page.mouse.down()
        for step in range(12):
            screen.page.mouse.move(x + way * 3 * step, y)
        screen.page.mouse.up()

        def is_at_the_end(end=box["x"] + way * 33):
            q = float(f"{10.0 ** float(thumb.get_attribute('aria-valuenow')):.2e}")
            return abs(thumb.bounding_box()["x"] - end) < 3 and is_filter_of(q, r)

        wait_until(is_at_the_end, "the last value of the drag", pause=0.1)


def test_the_map_fits_its_canvas_in_both_themes_and_at_three_sizes_and_is_magnified_and_moved(start):
    screen = MapScreen(start("demo", width=1920, height=1080), "demo")
    for width, height in ((1920, 1080), (1280, 720), (1600, 900)):
        if height == 900:
            screen.darken()
        screen.page.set_viewport_size({"width": width, "height": height})
        screen.tab("Tune")
        screen.wait_for_map()
        left, _, across, _ = screen.page.evaluate(CANVAS)
        assert 335 <= across <= 545
        assert left == pytest.approx(LEFT_WIDTH, abs=8)
        chart = screen.page.locator("[data-dock-region=right] .uplot").first.bounding_box()
        assert chart["width"] >= across - 25

    screen.tab("View")
    q, r = 10.0, 1000.0
    x, y = screen.at(q, r)
    mouse = screen.page.mouse

    def turn_wheel(way):
        mouse.move(x, y)
        for _ in range(5):
            mouse.wheel(0, way * 300)

    turn_wheel(-1)
    wait_until(lambda: not screen.is_drawn(screen.look()), "the map magnified", pause=0.2)
    mouse.click(x, y)  # what is under the mouse stays there; the mouse is told in whole pixels
    wait_until(lambda: screen.q_and_r() == pytest.approx([q, r], rel=0.06), "the pair under the mouse", pause=0.1)
    magnified = screen.look()
    mouse.move(x, y)
    mouse.down(button="right")
    mouse.move(x + 60, y + 40, steps=4)
    mouse.up(button="right")
    wait_until(lambda: np.abs(screen.look() - magnified).mean() > 0.5, "the map moved", pause=0.2)
    assert screen.q_and_r() == pytest.approx([q, r], rel=0.06)
    turn_wheel(1)
    screen.wait_for_picture(screen.is_drawn)
    screen.page.set_viewport_size({"width": 1090, "height": 800})  # too narrow for it
    screen.wait(f"() => ({CANVAS})()[2] < 200")
    screen.wait_for_fit()
    screen.button("Hide map").wait_for(state="hidden")
    screen.page.set_viewport_size({"width": 1280, "height": 800})
    screen.wait(f"() => ({CANVAS})()[2] > 200")
    screen.press("Hide map")
    screen.wait(f"() => ({CANVAS})()[2] < 200")
