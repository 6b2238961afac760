"""The Help tab: keys and mouse on one card, and the tour."""

from __future__ import annotations

import viser

from kalscope_app.views.binding import on_user
from kalscope_app.views.tour import Tour

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
