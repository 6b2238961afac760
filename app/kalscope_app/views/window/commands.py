"""The command palette, Ctrl+K: every button, checkbox and button of a row, by its label."""

from __future__ import annotations

from typing import Any

import viser

from kalscope_app.guard.viser_private import commands_of, is_on_screen, press, widgets_of
from kalscope_app.views.binding import put

WITHOUT = {"", "…", "Cancel"}
"""Widgets that have no name of their own, or show only while something runs."""


class Commands:
    """One command for each; made last, when all widgets are there."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._gui = gui
        self._commands: list[tuple[Any, viser.CommandHandle]] = []
        taken = {*WITHOUT, *commands_of(gui)}
        for widget in widgets_of(gui):
            if isinstance(widget, viser.GuiButtonGroupHandle):
                for name in widget.options:
                    if name not in taken:
                        self._add(gui, name, widget, name)
            elif isinstance(widget, viser.GuiCheckboxHandle | viser.GuiButtonHandle) and widget.label not in taken:
                self._add(gui, widget.label, widget)

    def _add(self, gui: viser.GuiApi, label: str, widget: Any, value: str | None = None) -> None:
        command = gui.add_command(f"{label[:1].upper()}{label[1:]}", description=widget.hint)

        async def trigger(event: viser.CommandEvent) -> None:
            if event.client is None or not is_on_screen(gui, widget):
                return
            if value is not None:
                widget.value = value
            elif isinstance(widget, viser.GuiCheckboxHandle):
                widget.value = not widget.value
            await press(widget, event.client)

        command.on_trigger(trigger)
        self._commands.append((widget, command))

    def show(self) -> None:
        """Follow the names of the buttons, and what is on screen."""
        for widget, command in self._commands:
            put(command, disabled=not is_on_screen(self._gui, widget))
            if isinstance(widget, viser.GuiButtonHandle):
                put(command, label=widget.label)
