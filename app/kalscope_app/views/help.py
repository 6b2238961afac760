"""The Help tab, and the first steps for new users."""

from __future__ import annotations

import threading
from contextlib import AbstractContextManager
from functools import partial
from typing import TYPE_CHECKING
from weakref import WeakSet

import viser

from kalscope_app.engine.jobs import Jobs
from kalscope_app.views.widgets import on_user
from kalscope_app.views.window import STEPS_BUTTON

if TYPE_CHECKING:
    from kalscope_app.program.user_settings import UserSettings


# The first steps: three sentences above the goal, which cover nothing. Each browser has its own.


FIRST_STEPS = (
    "**First steps.** Grey is the raw signal, orange the filtered one: less noise, but late.\n\n"
    "1. Enter the largest lag that you can accept and press **Apply**: of all filters within that lag you get "
    "the one that leaves the least noise.\n"
    "2. Adjust it: a larger **q** follows faster, a larger **r** smooths more; Ctrl+Z undoes.\n"
    "3. **Source** opens your file or a live board. **Export** writes the code."
)

DONE, LATER = "Got it", "Later"


class Tour:
    """Shows the first steps until they are put away, or when asked."""

    def __init__(self, settings: UserSettings, jobs: Jobs) -> None:
        self._settings, self._jobs = settings, jobs
        self._over = settings.tour_seen
        self._place: AbstractContextManager[object] | None = None
        self._building = threading.Lock()
        self._shown = WeakSet[viser.ClientHandle]()

    def put_into(self, place: AbstractContextManager[object]) -> None:
        """Args: the tab that shows them."""
        self._place = place

    def attach(self, client: viser.ClientHandle) -> None:
        """Show them in a new browser unless they were seen or put off."""
        if not self._over:
            self.show(client)

    def show(self, client: viser.ClientHandle) -> None:
        """Show them in one browser, above all else in their tab."""
        if self._place is None or client in self._shown:
            return
        self._shown.add(client)
        with self._building, self._place:  # two browsers may come at once, and viser enters a tab only once
            text = client.gui.add_markdown(FIRST_STEPS, order=-2.0)
            buttons = client.gui.add_button_group("", (DONE, LATER), order=-1.0)

        def put_away(_client: viser.ClientHandle) -> None:
            self._over = True
            self._shown.discard(client)
            text.remove()
            buttons.remove()
            if buttons.value == DONE:
                self._jobs.run(partial(self._settings.keep, tour_seen=True))

        on_user(buttons.on_click, put_away)


# The Help tab: keys and mouse on one card, and the first steps again.


KEYS = {
    "drag across a chart": "zoom in",
    "double-click a chart": "zoom out",
    "click a line's name": "hide or show it",
    "← → on a slider": "one step, 2.3 %",
    "Home, End on a slider": "minimum, maximum",
    "number, Enter": "exact value, such as 1e‑9",
    "Ctrl+Z": "undo",
    "Ctrl+Shift+Z, Ctrl+Y": "redo",
    "Ctrl+K": "every goal and button by its name",
    "drag a panel's edge": "make it wider",
}
"""Keys and mouse actions, and what they do."""


class HelpView:
    """A card and a button."""

    def __init__(self, gui: viser.GuiApi, tour: Tour) -> None:
        rows = "\n".join(f"| {what} | {does} |" for what, does in KEYS.items())
        gui.add_markdown(f"| keys and mouse | what it does |\n|---|---|\n{rows}\n\nOn a Mac: Cmd for Ctrl.")
        button = gui.add_button(STEPS_BUTTON, hint="In the Tune tab, above the goal.")
        on_user(button.on_click, tour.show)
        gui.add_markdown("Point at a control to read what it does.")
