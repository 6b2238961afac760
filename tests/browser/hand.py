"""What a hand does on a page: every press of a button of the mouse, and every key."""

from __future__ import annotations

from tests.browser.screen import Screen

LISTEN = """() => { const first = !window.__hand;
    window.__hand = {clicks: 0, keys: 0};
    if (!first) return;
    addEventListener('pointerdown', (event) => { window.__hand.clicks += event.isTrusted; }, true);
    addEventListener('keydown', (event) => { window.__hand.keys += event.isTrusted; }, true); }"""

THINK_AND_POINT_S, PRESS_S, KEY_S = 1.35 + 1.1, 0.2, 0.28
"""The keystroke-level model: Card, Moran and Newell, The keystroke-level model for user performance time with
interactive systems, 1980. Seconds to decide on and point at something, to press the mouse, and for a key."""


class Hand:
    """Counts from now on what a user does on this page; a drag is one press."""

    def __init__(self, screen: Screen) -> None:
        self._page = screen.page
        self._page.evaluate(LISTEN)

    @property
    def clicks(self) -> int:
        """Presses of a button of the mouse."""
        return self._page.evaluate("window.__hand.clicks")

    @property
    def seconds(self) -> float:
        """Time that a practised user needs for it, without the program's own."""
        return self.clicks * (THINK_AND_POINT_S + PRESS_S) + self._page.evaluate("window.__hand.keys") * KEY_S

    def press(self, name: str, role: str = "button") -> None:
        """Press what has exactly this name."""
        self._page.get_by_role(role, name=name, exact=True).click()

    def choose(self, box: str, option: str) -> None:
        """Open a menu by its label and take an entry: two presses."""
        label = self._page.locator("label", has_text=box).first
        label.locator("xpath=ancestor::*[.//input][1]").locator("input").first.click()
        self.press(option, "option")

    def type(self, box: str, text: str) -> None:
        """Click into a box, replace its text and press Enter, key by key."""
        label = self._page.locator("label", has_text=box).first
        field = label.locator("xpath=ancestor::*[.//input][1]").locator("input").first
        field.click()
        field.press("ControlOrMeta+a")
        field.press_sequentially(text, delay=60)
        field.press("Enter")
