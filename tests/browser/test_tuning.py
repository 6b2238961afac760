"""Sliders, text boxes, zoom, pins and channels: what the user sets is what the charts show."""

from __future__ import annotations

import itertools
import re

import pytest
from tests.browser.screen import FIND, filtered
from tests.support.effort import FUZZ

from kalscope import open_source
from kalscope_app.session.changes import select_channel, set_text, share_line
from kalscope_app.session.opening import opened
from kalscope_app.views.charts import range_text
from kalscope_app.views.widgets import typed

pytestmark = pytest.mark.browser
DEMO = open_source("demo").values[:, 0]
END = (len(DEMO) - 1) / 50  # s
Q, R = "process noise q", "measurement noise r"


def zoom_in(screen):
    """Drag over the second quarter of the signal chart, and wait for the window to follow."""
    over = screen.page.locator("[data-dock-region=right] .u-over").first.bounding_box()
    y = over["y"] + over["height"] / 2
    screen.page.mouse.move(over["x"] + 0.25 * over["width"], y)
    screen.page.mouse.down()
    screen.page.mouse.move(over["x"] + 0.5 * over["width"], y, steps=4)
    screen.page.mouse.up()
    screen.wait(f"() => ({FIND})('filtered')?.data[0].length < {len(DEMO) // 2}")


def test_tuning_by_keys_text_and_mouse_moves_the_curve_and_only_two_gestures_end_the_zoom(start):
    screen = start("demo")
    keyboard = screen.page.keyboard
    screen.wait_for_line("filtered", filtered(DEMO))  # the first answer
    screen.wait_for_fit()
    zoom_in(screen)
    zoom = screen.range("x")
    assert zoom == pytest.approx((0.25 * END, 0.5 * END), abs=0.2)
    screen.page.get_by_text(f"{range_text(*zoom)} s").wait_for()
    assert screen.range("x", "innovation") == pytest.approx(zoom)
    seen = slice(round(50 * zoom[0]), round(50 * zoom[1]) + 1)

    def wait_for(**values):
        screen.wait_for_line("filtered", filtered(DEMO, **values)[seen])

    screen.slider("q").focus()
    keyboard.press("End")
    wait_for(q=1e5)
    screen.wait_for_value(Q, "100000")
    screen.type(Q, "1e-9")
    wait_for(q=1e-9)
    screen.type(R, "2,5", enter=False)  # counts when typing rests
    wait_for(q=1e-9, r=2.5)
    screen.type(Q, "much")
    screen.wait_for_notice("q must be a number such as 0.01 or 1e-9 (got 'much')")
    screen.type(Q, "-1")
    screen.wait_for_notice("q must be a finite variance from 0 to 1e300 (got -1.0)")
    wait_for(q=1e-9, r=2.5)

    screen.press("Undo")
    wait_for(q=1e-9)
    screen.press("Redo")
    wait_for(q=1e-9, r=2.5)
    screen.open_more()
    screen.press("Reset")
    wait_for()
    screen.slider("q").focus()
    keyboard.press("Control+z")
    wait_for(q=1e-9, r=2.5)
    keyboard.press("Control+Shift+z")
    wait_for()
    assert screen.range("x") == zoom

    screen.page.get_by_role("slider", name="begin of the view").focus()
    keyboard.press("ArrowLeft")
    screen.wait(f"(low) => ({FIND})('filtered').data[0][0] < low", zoom[0])
    reset = screen.button("Reset view")
    for show_all in (screen.page.locator("[data-dock-region=right] .u-over").first.dblclick, reset.click):
        reset.wait_for()
        show_all()
        screen.wait_for_line("filtered", filtered(DEMO))
        assert screen.range("x") == pytest.approx((0.0, END))
        reset.wait_for(state="detached")
        zoom_in(screen)


NUMBERS = "47", "3,5", "8e-4", "0.83", "12", "2,7", "5e-9", "0.29", "64", "9,1", "1e-2", "0.55"
"""Texts as they are typed, short and long."""


@pytest.mark.slow
def test_every_typed_number_counts_and_escape_brings_back_what_the_filter_uses(start):
    """However fast it is typed, and ended with Enter, by leaving the box, or not at all."""
    screen, used = start("demo", width=1090, height=720), {}
    ends, delays, labels = map(itertools.cycle, (("Enter", "Tab", None), (20, 60, 90, 130), (Q, Q, R, Q, R)))
    for text, key, delay, label in zip(NUMBERS * (1 if FUZZ == 1 else 5), ends, delays, labels, strict=False):
        screen.retype(label, text, delay)
        if key:
            screen.page.keyboard.press(key)
        used["q" if label == Q else "r"] = value = float(text.replace(",", "."))
        screen.wait_for_line("filtered", filtered(DEMO, **used))
        screen.wait_for_value(label, typed(value))

    screen.page.keyboard.press("Tab")  # Escape brings back what was there when the box was entered
    before = screen.text_box(Q).input_value()
    screen.retype(Q, "77")
    screen.page.keyboard.press("Escape")
    screen.wait_for_value(Q, before)
    screen.page.keyboard.press("Tab")
    screen.retype(Q, "78")
    screen.wait_for_line("filtered", filtered(DEMO, **used | {"q": 78.0}))  # after the pause for a complete number
    screen.page.keyboard.press("Escape")
    screen.wait_for_line("filtered", filtered(DEMO, **used))
    screen.wait_for_value(Q, before)


def test_settings_are_pinned_used_and_deleted(start):
    screen = start("demo")
    for name, q in (("A", "0.05"), ("B", "500")):
        screen.type(Q, q)
        screen.wait_for_line("filtered", filtered(DEMO, q=float(q)))
        screen.press("Pin")
        screen.wait_for_line(name, filtered(DEMO, q=float(q)), tolerance=1e-9)
    screen.type(Q, "7")
    screen.wait_for_line("filtered", filtered(DEMO, q=7))
    screen.tab("Compare")
    screen.page.get_by_role("cell", name=re.compile("^■ B$")).wait_for()
    screen.page.get_by_role("cell", name="current", exact=True).wait_for()
    screen.choose("setting", "A")
    screen.press("Use")
    screen.wait_for_line("filtered", filtered(DEMO, q=0.05))
    screen.press("Delete")
    screen.wait(f"() => !({FIND})('A') && ({FIND})('B')")
    screen.slider("q").focus()
    screen.page.keyboard.press("Control+z")
    screen.wait(f"() => ({FIND})('A')")
    screen.page.keyboard.press("Control+y")
    screen.wait(f"() => !({FIND})('A')")


def test_a_channel_keeps_its_values_the_line_reopens_them_and_channels_are_tuned_together(start):
    screen, axes = start("sample:lis302dl"), open_source("sample:lis302dl").values
    screen.choose("channel", "z")
    screen.wait_for_line("raw", axes[:, 2])
    screen.type(Q, "7", enter=False)  # stays with its channel; the later gesture wins
    screen.choose("channel", "y")
    screen.wait_for_line("filtered", filtered(axes[:, 1]))
    screen.choose("channel", "z")
    screen.wait_for_line("filtered", filtered(axes[:, 2], q=7))
    screen.type("initial variance p0", "2")
    screen.wait_for_line("filtered", filtered(axes[:, 2], q=7, p0=2))
    screen.tab("Export")
    state = opened(open_source("sample:lis302dl"))
    for change in (select_channel("z"), set_text("q", "7"), set_text("p0", "2")):
        state = change(state)
    reopens = "(line) => [...document.querySelectorAll('textarea')].some(box => box.value === line)"
    screen.wait(reopens, share_line(state).line)  # it follows the chart; `test_share.py` reopens such lines

    screen.tab("Tune")
    screen.choose("channel", "x")
    screen.wait_for_line("raw", axes[:, 0])
    screen.tab("Channels")
    screen.choose("apply to", "all: same q and r")
    screen.type(Q, "0.5")
    screen.page.get_by_role("row", name=re.compile(r"^2 y 0\.500")).wait_for()
