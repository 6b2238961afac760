"""The first steps again, hints, commands, copying, and keys; the first run is in `test_journey.py`."""

from __future__ import annotations

import pytest
from tests.browser.axe import findings
from tests.browser.screen import LEAVE

pytestmark = pytest.mark.browser


def test_the_help_tab_leads_to_the_first_steps_and_hints_stand_under_the_mouse(start):
    screen = start("demo")
    screen.tab("Help")
    screen.page.get_by_text("Ctrl+Shift+Z, Ctrl+Y").wait_for()
    screen.page.get_by_role("button", name="Show the first steps").click()
    screen.page.get_by_role("button", name="Apply", exact=True).wait_for()  # it has led to the Tune tab
    screen.page.get_by_text("First steps.").wait_for()
    screen.page.get_by_role("button", name="Got it", exact=True).click()
    screen.page.get_by_text("First steps.").wait_for(state="detached")
    screen.slider("q").hover()
    screen.page.get_by_text("Drag, or click and use the arrow keys").wait_for()
    screen.tab("Export")
    screen.page.get_by_role("button", name="Command line").click()
    screen.page.get_by_role("button", name="Copy text").click()
    line = screen.page.locator("textarea:visible").first.input_value()
    screen.wait("(line) => getSelection().toString() === line", line)


def test_goals_and_actions_are_commands_and_every_heading_a_button_for_keys(start):
    screen = start("demo", width=1280, height=720)
    actions = screen.page.locator(".mantine-Spotlight-action")
    screen.choose("goal", "best fit")
    screen.page.evaluate(LEAVE)  # viser takes no hotkey out of a text box
    screen.page.keyboard.press("Control+k")
    for name in ("Map", "Reset view", "Connect", "Preview code", "Reset", "Undo", "Show the first steps"):
        actions.get_by_text(name, exact=True).wait_for()
    assert findings(screen.page) == []
    screen.page.locator("input.mantine-Spotlight-search").fill("lag")
    actions.get_by_text("Reset view", exact=True).wait_for(state="detached")  # only what was typed is listed
    actions.get_by_text("Goal: maximum lag").click()
    screen.wait_for_value("goal", "maximum lag")
    heading = screen.page.get_by_role("button", name="More settings")
    heading.focus()
    assert heading.get_attribute("aria-expanded") == "false"
    for key, opened in (("Enter", "true"), (" ", "false")):
        screen.page.keyboard.press(key)
        screen.wait("([at, value]) => at.ariaExpanded === value", [heading.element_handle(), opened])
    assert arrows_that_leave(screen, screen.slider("q")) == []
    screen.wait("() => document.querySelector('[role=status]').textContent === 'fits'")  # it is read out


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
