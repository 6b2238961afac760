"""The Help tab, and the tour for new users."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import viser

from kalscope_app.engine.jobs import Jobs
from kalscope_app.views.widgets import on_user

if TYPE_CHECKING:
    from kalscope_app.program.user_settings import UserSettings


# The tour: three windows for new users, the goal first. Each browser has its own.


STEPS = (
    (
        "How much lag can you accept?",
        "Grey is the raw signal, orange the filtered one: less noise, but late.\n\n"
        "With the goal *maximum lag*, enter the largest lag that you can accept and press **Apply**: of all "
        "filters within that lag you get the one that leaves the least noise.",
    ),
    (
        "Then adjust it",
        "The lines at the top give the lag, the noise and whether the filter fits; click that word for the reasons."
        "\n\nA larger **q** follows faster, a larger **r** smooths more. **Pin** keeps a setting, Ctrl+Z undoes.",
    ),
    (
        "Your signal, your device",
        "**Source** opens your file or a live board. **Export** writes the code.\n\n"
        "**Help** lists the keys and shows this tour again.",
    ),
)
"""Title and text of each window."""

NEXT, LATER, NEVER, DONE = "Next", "Later", "Do not show again", "Done"


class Tour:
    """Shows the windows one after the other, on the first run or when asked."""

    def __init__(self, settings: UserSettings, jobs: Jobs) -> None:
        self._settings, self._jobs = settings, jobs
        self._over = settings.tour_seen

    def attach(self, client: viser.ClientHandle) -> None:
        """Show the tour in a new browser unless it was seen or put off."""
        if not self._over:
            self.show(client)

    def show(self, client: viser.ClientHandle, step: int = 0) -> None:
        """Show one window in one browser."""
        title, text = STEPS[step]
        last = step + 1 == len(STEPS)
        with client.gui.add_modal(f"{title} ({step + 1} of {len(STEPS)})") as window:
            client.gui.add_markdown(text)
            group = client.gui.add_button_group(
                "", (DONE,) if last else (NEXT, LATER, NEVER), hint="The Help tab shows the tour again."
            )
        on_user(group.on_click, lambda _client: self._go_on(client, window.close, group.value, step))

    def _go_on(self, client: viser.ClientHandle, close: Callable[[], None], choice: str, step: int) -> None:
        close()
        if choice == NEXT:
            self.show(client, step + 1)
            return
        self._over = True
        if choice != LATER:
            self._jobs.run(partial(self._settings.keep, tour_seen=True))


# The Help tab: keys and mouse on one card, and the tour.


KEYS = (
    ("drag across a chart", "zoom in"),
    ("double-click a chart", "zoom out"),
    ("click a line's name", "hide or show it"),
    ("← → on a slider", "one step, 2.3 %"),
    ("Home, End on a slider", "minimum, maximum"),
    ("number, Enter", "exact value, such as 1e‑9"),
    ("Ctrl+Z", "undo"),
    ("Ctrl+Shift+Z, Ctrl+Y", "redo"),
    ("Ctrl+K", "every button by its name"),
    ("drag a panel's edge", "make it wider"),
)
"""Keys and mouse actions, and what they do."""


class HelpView:
    """A card and a button."""

    def __init__(self, gui: viser.GuiApi, tour: Tour) -> None:
        gui.add_markdown(card())
        button = gui.add_button("Show the tour", hint="Three short windows.")
        on_user(button.on_click, tour.show)
        gui.add_markdown("Point at a control to read what it does.")


def card() -> str:
    """The keys as markdown."""
    rows = "\n".join(f"| {what} | {does} |" for what, does in KEYS)
    return f"| keys and mouse | what it does |\n|---|---|\n{rows}\n\nOn a Mac: Cmd for Ctrl."
