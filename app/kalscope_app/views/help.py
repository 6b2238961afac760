"""The Help tab, and the first steps for new users."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import viser

from kalscope_app.engine.jobs import Jobs
from kalscope_app.views.widgets import add_button, table_of
from kalscope_app.views.window import STEPS_BUTTON

if TYPE_CHECKING:
    from kalscope_app.program.user_settings import UserSettings


# The first steps: three sentences above the goal, which cover nothing.


FIRST_STEPS = (
    "**First steps.** Grey is the raw signal, orange the filtered one: less noise, but late.\n\n"
    "1. Enter the largest lag that you can accept and press **Apply**: of all filters within that lag you get "
    "the one that leaves the least noise.\n"
    "2. Adjust it: a larger **q** follows faster, a larger **r** smooths more; Ctrl+Z undoes.\n"
    "3. **Source** opens your file or a live board. **Export** writes the code."
)


class FirstSteps:
    """They stand there until they are put away, and again when asked."""

    def __init__(self, gui: viser.GuiApi, settings: UserSettings, jobs: Jobs) -> None:
        self._text = gui.add_markdown(FIRST_STEPS)

        def put_away(_client: viser.ClientHandle) -> None:
            self.show(visible=False)
            jobs.run(partial(settings.keep, tour_seen=True))

        self._done = add_button(gui, "Got it", "The Help tab shows them again.", put_away)
        self.show(visible=not settings.has("tour_seen"))

    def show(self, *, visible: bool = True) -> None:
        """Show or hide them."""
        self._text.visible = self._done.visible = visible


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


def add_help(gui: viser.GuiApi, steps: FirstSteps) -> None:
    """The Help tab: a card and a button."""
    rows = [{"keys and mouse": what, "what it does": does} for what, does in KEYS.items()]
    gui.add_markdown(f"{table_of(rows)}\n\nOn a Mac: Cmd for Ctrl.")
    add_button(gui, STEPS_BUTTON, "In the Tune tab, above the goal.", lambda _client: steps.show())
    gui.add_markdown("Point at a control to read what it does.")
