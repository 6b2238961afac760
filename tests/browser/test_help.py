"""The tour shown again, the key card, hints, commands and keys; the first run is in `test_journey.py`."""

from __future__ import annotations

import re

import pytest
from axe import findings

from kalscope_app.views.help import STEPS

pytestmark = pytest.mark.browser


def test_the_help_tab_shows_the_tour_again_and_hints_stand_under_the_mouse(start):
    screen = start("demo")
    screen.tab("Help")
    screen.page.get_by_text("Ctrl+Shift+Z, Ctrl+Y").wait_for()
    screen.shot("help")
    dialog = screen.page.get_by_role("dialog")
    assert dialog.count() == 0
    screen.page.get_by_role("button", name="Show the tour").click()
    screen.page.get_by_text(re.compile(rf"^{STEPS[0][0]}")).wait_for()
    dialog.get_by_role("button", name="Later", exact=True).click()
    dialog.wait_for(state="detached")
    screen.tab("Tune")
    screen.slider("q").hover()
    screen.page.get_by_text("Drag, or click and use the arrow keys").wait_for()


def test_every_action_is_a_command_and_every_heading_a_button_for_keys(start):
    screen = start("demo", width=1280, height=720)
    actions = screen.page.locator(".mantine-Spotlight-action")
    screen.page.keyboard.press("Control+k")
    for name in ("Map", "Reset view", "Connect", "Preview code", "Reset", "Undo", "Show the tour"):
        actions.get_by_text(name, exact=True).wait_for()
    screen.page.keyboard.press("Escape")
    actions.first.wait_for(state="detached")
    screen.page.keyboard.press("Control+k")
    screen.page.locator("input.mantine-Spotlight-search").fill("dark theme")
    actions.get_by_text("Reset view", exact=True).wait_for(state="detached")  # only what was typed is listed
    assert findings(screen.page) == []
    screen.shot("commands")
    screen.page.keyboard.press("Enter")
    screen.wait("() => document.documentElement.dataset.mantineColorScheme === 'dark'")
    actions.first.wait_for(state="detached")
    screen.page.keyboard.press("Control+k")
    actions.get_by_text("Map", exact=True).click()
    actions.first.wait_for(state="detached")  # the palette lists "Hide map" too, until it is closed
    screen.page.get_by_role("button", name="Hide map").wait_for()
    heading = screen.page.get_by_role("button", name="Resulting filter")
    heading.focus()
    assert heading.get_attribute("aria-expanded") == "false"
    for key, opened in (("Enter", "true"), (" ", "false")):
        screen.page.keyboard.press(key)
        screen.wait("([at, value]) => at.ariaExpanded === value", [heading.element_handle(), opened])
    assert arrows_that_leave(screen, screen.slider("q")) == []
    assert screen.slider("q").get_attribute("aria-label")


def arrows_that_leave(screen, slider):
    """The keys of a move of the slider that are heard outside of it, where viser would turn its camera."""
    screen.page.evaluate(
        "() => { window.heard = []; document.addEventListener('keydown', e => heard.push(e.key)) }"
    )
    before = slider.get_attribute("aria-valuenow")
    slider.focus()
    screen.page.keyboard.press("ArrowRight")
    screen.page.keyboard.press("Shift")
    screen.wait("() => heard.includes('Shift')")
    assert slider.get_attribute("aria-valuenow") != before
    return screen.page.evaluate("() => heard.filter(key => key !== 'Shift')")
