"""The main journey by keys alone: nothing here touches the mouse, and controls are found by the names that a screen
reader says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.browser.screen import filtered

from kalscope import open_source, steady_state
from kalscope.common.text import lag_text
from kalscope.estimation.request import starting_params
from kalscope.tuning.file import load_tuning

pytestmark = pytest.mark.browser
DEMO = open_source("demo")

FOCUSED = """() => { const at = document.activeElement;
    return [at.role ?? at.tagName.toLowerCase(), at.ariaLabel || at.textContent]; }"""
"""Role and name of what has the focus."""

HIGHLIGHTED = (
    """() => document.getElementById(document.activeElement.getAttribute('aria-activedescendant'))?.textContent"""
)
"""The entry of an open menu that Enter takes."""

MAX_STEPS = 100
"""Presses of Tab by which every control is reached."""


class Keys:
    """The keyboard of a page."""

    def __init__(self, page):
        self._page, self.press, self.type = page, page.keyboard.press, page.keyboard.type

    def go_to(self, *wanted):
        """Press Tab until the control of this role and name has the focus; how often."""
        passed = []
        for _ in range(MAX_STEPS):
            self.press("Tab")
            passed.append(tuple(self._page.evaluate(FOCUSED)))
            if passed[-1] == wanted:
                return len(passed)
        raise AssertionError(f"Tab must reach {wanted} (got {passed})")

    def open_tab(self, name, present):
        """Go to the tab that is open, and along the strip."""
        self.go_to("tab", present)
        self._press_until("ArrowRight", "document.activeElement.textContent", name)

    def choose(self, menu, option):
        """Open a menu, and go down to an entry."""
        self.go_to("combobox", menu)
        self.press("ArrowDown")
        self._page.get_by_role("option", name=option, exact=True).wait_for()
        self._press_until("ArrowDown", HIGHLIGHTED, option)
        self.press("Enter")

    def _press_until(self, key, script, wanted):
        for _ in range(9):
            if self._page.evaluate(script) == wanted:
                return
            self.press(key)
        raise AssertionError(f"{key} must reach {wanted}")

    def command(self, name):
        """Run what the command palette finds first under a name."""
        self.press("Control+k")
        self._page.locator("input.mantine-Spotlight-search:focus").wait_for()
        self.type(name)
        first = self._page.locator(".mantine-Spotlight-action").first
        first.get_by_text(name, exact=True).wait_for()
        self.press("Enter")
        first.wait_for(state="detached")


def test_a_signal_is_tuned_opened_and_exported_without_a_mouse(start, tmp_path):
    screen = start("demo")
    keys, z = Keys(screen.page), DEMO.values[:, 0]
    keys.go_to("button", "Map")
    assert keys.go_to("button", "Apply") == 4  # one stop for the tabs, then goal and value
    keys.go_to("slider", "log₁₀ q")
    for _ in range(8):
        keys.press("ArrowRight")
    q = float(f"{10.0 ** float(screen.slider('q').get_attribute('aria-valuenow')):.2e}")
    screen.wait_for_line("filtered", filtered(z, q=q), tolerance=1e-9)
    lag = float(steady_state(replace(starting_params(z), q=q)).lag_samples)
    screen.page.get_by_text(lag_text(lag, DEMO.sample_period)).first.wait_for()
    keys.press("Control+z")
    screen.wait_for_line("filtered", filtered(z))

    values = np.round(np.cumsum(np.random.default_rng(2).normal(0, 1, (300, 2)), axis=0), 3)
    rows = "".join(f"{i / 10},{a},{b}\n" for i, (a, b) in enumerate(values.tolist()))
    (tmp_path / "log.csv").write_text(f"time_s,near,far\n{rows}")
    keys.open_tab("Source", present="Tune")
    keys.go_to("input", "path")
    keys.type("log.csv")
    keys.press("Enter")
    screen.wait_for_line("raw", values[:, 0])
    keys.choose("channel", "far")
    screen.wait_for_line("raw", values[:, 1])

    keys.press("Tab")  # viser takes no hotkey out of a text box
    keys.command("Preview code")
    dialog = screen.page.get_by_role("dialog")
    dialog.get_by_role("button", name="Close").wait_for()
    keys.go_to("button", "Close")
    keys.press("Enter")
    dialog.wait_for(state="detached")
    keys.open_tab("Export", present="Source")
    keys.go_to("button", "Download tuning file")
    with screen.page.expect_download() as download:
        keys.press("Enter")
    download.value.save_as(tmp_path / "tuning.toml")
    assert {channel.name for channel in load_tuning(tmp_path / "tuning.toml").channels} == {"near", "far"}
