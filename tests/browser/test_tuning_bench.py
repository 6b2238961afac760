"""Pinned settings, several channels and the line that reopens it, in a real browser."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from tests.browser.screen import FIND
from tests.support.waiting import wait_until

from kalscope import denoise, kalman_filter, open_source
from kalscope.estimation.request import starting_params
from kalscope_app.session.changes import select_channel, set_text, share_line
from kalscope_app.session.opening import opened
from kalscope_app.studies.comparisons import HALF_LANE

pytestmark = pytest.mark.browser
DEMO = open_source("demo").values[:, 0]


def filtered(z, **params):
    return kalman_filter(z, replace(starting_params(z), **params)).x


def rows(screen):
    """First cells of the table in sight."""
    cells = screen.page.locator("table:visible tbody tr td:first-child").all_inner_texts()
    return [cell.replace("■", "").strip() for cell in cells]


def test_settings_are_pinned_used_and_deleted(start):
    screen = start("demo", width=1280, height=720)
    page, pin = screen.page, screen.page.get_by_role("button", name="Pin", exact=True)
    for name, q in (("A", "0.05"), ("B", "500")):
        screen.type("process noise q", q)
        screen.wait_for_line("filtered", filtered(DEMO, q=float(q)))
        pin.click()
        screen.wait_for_line(name, filtered(DEMO, q=float(q)), tolerance=1e-9)
    screen.type("process noise q", "7")
    screen.wait_for_line("filtered", filtered(DEMO, q=7))
    screen.shot("pinned-light")
    screen.tab("View")
    page.get_by_text("dark theme").click()
    screen.wait("() => document.documentElement.dataset.mantineColorScheme === 'dark'")
    screen.tab("Tune")
    screen.tab("Compare")
    page.get_by_role("cell", name=re.compile("^■ B$")).wait_for()
    screen.wait("() => document.querySelectorAll('table').length > 0")
    page.get_by_role("cell", name="current", exact=True).wait_for()
    screen.choose("setting", "A")
    screen.shot("compare-dark")
    page.get_by_role("button", name="Use", exact=True).click()
    screen.wait_for_line("filtered", filtered(DEMO, q=0.05))
    page.get_by_role("button", name="Delete", exact=True).click()
    screen.wait(f"() => !({FIND})('A') && ({FIND})('B')")
    screen.slider("q").focus()
    page.keyboard.press("Control+z")
    screen.wait(f"() => ({FIND})('A')")
    page.keyboard.press("Control+y")
    screen.wait(f"() => !({FIND})('A')")


def lane(z, params, number):
    """A filtered lane as it must be drawn."""
    middle, half = (z.max() + z.min()) / 2, (z.max() - z.min()) / 2
    return number - HALF_LANE * np.clip((denoise(z, params) - middle) / half, -1, 1)


def test_the_line_on_screen_is_of_what_is_on_screen_and_channels_are_tuned_together(start):
    screen = start("sample:lis302dl", width=1280, height=720)
    axes = open_source("sample:lis302dl").values
    screen.choose("channel", "y")
    screen.type("process noise q", "0.03")
    screen.type("initial variance p0", "2")
    screen.wait_for_line("filtered", filtered(axes[:, 1], q=0.03, p0=2))
    screen.tab("Export")
    boxes = screen.page.locator("textarea")
    state = opened(open_source("sample:lis302dl"))
    for change in (select_channel("y"), set_text("q", "0.03"), set_text("p0", "2")):
        state = change(state)
    # It follows the chart. `test_share.py` reopens such lines.
    texts = "(boxes) => boxes.map(box => box.value)"
    wait_until(lambda: share_line(state).line in boxes.evaluate_all(texts), "the line on screen")
    screen.shot("share")

    screen.tab("Tune")
    screen.choose("channel", "x")
    screen.wait_for_line("raw", axes[:, 0])
    screen.tab("Channels")
    screen.choose("apply to", "all: same q and r")
    screen.type("process noise q", "0.5")
    params = replace(starting_params(axes[:, 0]), q=0.5)
    at = drawn(screen, "3", axes)
    screen.wait_for_line("3", lane(axes[:, 2], params, 3)[at], tolerance=1e-6)
    screen.page.get_by_role("row", name=re.compile(r"^3 z 0\.500")).wait_for()
    screen.shot("channels")


def drawn(screen, label, axes):
    """Which samples the lanes show, by their times at 100 Hz."""
    screen.wait(f"() => ({FIND})('{label}')")
    time, _ = screen.line(label)
    at = np.rint(time * 100).astype(int)
    assert at[-1] == len(axes) - 1
    return at
