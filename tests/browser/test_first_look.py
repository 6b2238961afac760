"""What a page shows first: one layout at every load, few controls, the starting values; hints and help."""

from __future__ import annotations

import numpy as np
import pytest
from tests.browser.screen import LEAVE, Screen, filtered
from tests.support.effort import FUZZ

from kalscope import kalman_filter, open_source
from kalscope.estimation.request import starting_params

pytestmark = pytest.mark.browser
DEMO = open_source("demo").values[:, 0]
Q, R, P0 = "process noise q", "measurement noise r", "initial variance p0"

WATCH_LAYOUT = """(() => { const panels = window.panels = new Set(), charts = window.charts = new Set();
    const boxes = (query) => JSON.stringify([...document.querySelectorAll(query)]
        .filter(one => one.checkVisibility({ visibilityProperty: true }))
        .map(one => Object.values(one.getBoundingClientRect().toJSON()).map(Math.round)));
    const look = () => {
        panels.add(boxes('[data-dock-region]')); charts.add(boxes('[data-dock-region=right] .uplot'));
        requestAnimationFrame(look); };
    requestAnimationFrame(look); })();"""
"""Notes, at every picture that a page draws, where its panels and its charts are."""


def layout(screen):
    """The one layout that a page has had since its first picture."""
    screen.wait_for_fit()
    screen.page.wait_for_timeout(500)  # nothing is waited for: nothing must come
    seen = [screen.page.evaluate(f"[...{name}].filter(one => one !== '[]')") for name in ("panels", "charts")]
    assert list(map(len, seen)) == [1, 1], seen
    return seen


def test_every_load_shows_the_same_values_in_one_layout_and_no_page_overwrites_what_another_types(start, browser):
    screen = start("demo", own=True, script=WATCH_LAYOUT)
    assert np.array_equal(screen.line("raw")[1], DEMO)
    screen.wait_for_line("filtered", filtered(DEMO))
    first = layout(screen)
    screen.type(Q, "7")
    screen.wait_for_line("filtered", filtered(DEMO, q=7))
    for _ in range(1 if FUZZ == 1 else 15):
        screen.page.reload(wait_until="commit")
        screen.ready()
        screen.wait_for_line("filtered", filtered(DEMO, q=7))
        screen.wait_for_value(Q, "7")
        assert layout(screen) == first
    with Screen(browser, screen.url, script=WATCH_LAYOUT, width=1280, height=720) as second:
        assert layout(second) != first
        second.wait_for_value(Q, "7")
        second.retype(Q, "1e")
        screen.type(Q, "8")
        screen.type(R, "6")
        second.wait_for_value(R, "6")
        for one in (screen, second):
            one.wait_for_line("filtered", filtered(DEMO, q=8, r=6))
        assert second.text_box(Q).input_value() == "1e"
        second.page.keyboard.type("-3")
        second.page.keyboard.press("Enter")
        screen.page.set_viewport_size({"width": 1920, "height": 1080})
        for one in (screen, second):
            one.wait_for_line("filtered", filtered(DEMO, q=0.001, r=6))
            one.wait_for_value(Q, "0.001")
            one.wait_for_fit()


IN_SIGHT = """() => { const seen = (one) => { const box = one.getBoundingClientRect();
        return one.checkVisibility({ visibilityProperty: true }) && box.height > 1 && box.width > 1 && box.top >= 0
            && box.bottom <= innerHeight; };
    const controls = 'input:not([type=hidden]), textarea, button, [role=slider], [role=button], [role=tablist]';
    return [...document.querySelectorAll(controls)].filter(seen).map(one => one.ariaLabel || one.textContent); }"""
"""The controls that a user sees; a strip of tabs is one."""


def test_the_first_screen_has_the_demo_at_its_starting_values_and_at_most_eighteen_controls(start, tmp_path):
    calm = np.column_stack([np.arange(40), np.sin(np.arange(40) / 5), np.sin(np.arange(40) / 6)])
    rows = "".join(f"{i},{a:.6f},{b:.6f}\n" for i, a, b in calm)
    (tmp_path / "log.csv").write_text(f"time,near,far\n{rows}50,-200,-200\n61,-200,-200\n")
    for source, name in (("sample:tank_level", "channel"), ("log.csv", "Read -200 as missing"), ("demo", "Map")):
        screen = start(source)
        screen.wait_for_fit()
        screen.wait(f"(name) => ({IN_SIGHT})().includes(name)", name)  # the names come last
        screen.wait(f"() => ({IN_SIGHT})().some((name) => name.startsWith('log₁₀ q'))")
        screen.wait(f"() => ({IN_SIGHT})().length <= 18")  # a notice has a button as well, while it shows
        assert "Redo" not in screen.page.evaluate(IN_SIGHT)  # nothing was undone
        assert screen.page.get_by_role("tab", name="Channels").is_visible() is (source != "demo")
    result = kalman_filter(DEMO, starting_params(DEMO))
    assert np.array_equal(screen.line("raw")[1], DEMO)
    screen.wait_for_line("filtered", result.x)
    assert np.array_equal(screen.line("innovation")[1][1:], result.innovation[1:])
    assert np.allclose(screen.line("+2√p")[1], result.x + 2 * np.sqrt(result.p), rtol=1e-12)
    for words in ("12.4 ms", "noise left (−5.65 dB)"):
        screen.wait_for_text(words)

    screen.page.set_viewport_size({"width": 1280, "height": 720})
    screen.type("lag (ms)", "50")
    result = screen.page.get_by_text("Before: 12.4 ms")
    result.wait_for()
    rows = [(screen.text_box(name), screen.slider(name.split()[-1])) for name in (Q, R, P0)]
    for box, slider in ((box.bounding_box(), slider.bounding_box()) for box, slider in rows):
        assert result.bounding_box()["y"] < slider["y"] < 720
        assert box["x"] + box["width"] < slider["x"]
        assert box["y"] < slider["y"] < box["y"] + box["height"]
    assert screen.page.locator("label", has_text=R).bounding_box()["height"] < 24  # on one line

    screen.press("Undo")
    screen.open_more()
    for words in ("4.85 Hz", "0.358", "15 samples"):
        screen.wait_for_text(words)
    for name, text in ((P0, "0"), ("initial estimate x0", "0"), (R, "100"), (Q, "1")):
        screen.type(name, text)
    screen.wait_for_line("filtered", filtered(DEMO, q=1, r=100, p0=0, x0=0))
    low, high = screen.range("y")
    assert 200 < low < high < 800  # the wild start at 0 leaves the picture; the range follows the signal
    screen.slider("p0").focus()
    screen.page.keyboard.press("End")
    screen.wait_for_line("filtered", filtered(DEMO, q=1, r=100))
    screen.wait_for_value(P0, "automatic")


def test_help_hints_commands_and_headings_lead_to_every_action(start):
    screen = start("demo")
    screen.tab("Help")
    screen.page.get_by_text("Ctrl+Shift+Z, Ctrl+Y").wait_for()
    screen.press("Show the first steps")
    screen.button("Apply").wait_for()  # it has led to the Tune tab
    screen.page.get_by_text("First steps.").wait_for()
    screen.press("Got it")
    screen.page.get_by_text("First steps.").wait_for(state="detached")
    screen.slider("q").hover()
    screen.page.get_by_text("Drag, or click and use the arrow keys").wait_for()

    actions = screen.page.locator(".mantine-Spotlight-action")
    screen.choose("goal", "best fit")
    screen.tab("Export")
    screen.page.evaluate(LEAVE)  # viser takes no hotkey out of a text box
    screen.page.keyboard.press("Control+k")
    for name in ("Map", "Reset view", "Connect", "Preview code", "Reset", "Undo", "Show the first steps"):
        actions.get_by_text(name, exact=True).wait_for()
    assert screen.axe_findings() == []
    screen.page.locator("input.mantine-Spotlight-search").fill("lag")
    actions.get_by_text("Reset view", exact=True).wait_for(state="detached")  # only what was typed is listed
    actions.get_by_text("Goal: maximum lag").click()
    screen.wait_for_value("goal", "maximum lag")  # it has led to the Tune tab
    heading = screen.page.get_by_role("button", name="More settings")
    heading.focus()
    assert heading.get_attribute("aria-expanded") == "false"
    for key, opened in (("Enter", "true"), (" ", "false")):
        screen.page.keyboard.press(key)
        screen.wait("([at, value]) => at.ariaExpanded === value", [heading.element_handle(), opened])
    screen.page.evaluate("() => { window.heard = []; addEventListener('keydown', e => heard.push(e.key)) }")
    slider = screen.slider("q")
    before = slider.get_attribute("aria-valuenow")
    slider.focus()
    screen.page.keyboard.press("ArrowRight")  # viser would turn its camera
    screen.page.keyboard.press("Shift")
    screen.wait("([at, before]) => at.ariaValueNow !== before", [slider.element_handle(), before])
    screen.wait("() => heard.join() === 'Shift'")
    screen.wait("() => document.querySelector('[role=status]').textContent === 'fits'")  # it is read out

    screen.tab("Export")
    screen.press("Command line")
    screen.press("Copy text")
    line = screen.page.locator("textarea:visible").first.input_value()
    screen.wait("(line) => getSelection().toString() === line", line)
