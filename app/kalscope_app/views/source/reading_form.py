"""The form with the import options."""

from __future__ import annotations

from collections.abc import Callable

import viser

from kalscope.sources.grammar.read_options import ReadOptions, options_from_text
from kalscope_app.views.binding import on_user


class ReadingForm:
    """Options in place of what was detected; empty boxes are detected."""

    def __init__(self, gui: viser.GuiApi, read: Callable[[ReadOptions], None]) -> None:
        self._read = read
        self._delimiter = gui.add_dropdown(
            "delimiter",
            (FOUND, "comma", "semicolon", "tab", "bar", "space"),
            hint="The character between two cells.",
        )
        self._time = gui.add_text("time column", "", hint="Its name, its number from 1, or none.")
        self._unit = gui.add_dropdown(
            "time unit",
            (FOUND, "s", "ms", "us", "ns", "min", "h", "day", "year"),
            hint="The unit of a numeric time column.",
        )
        self._missing = gui.add_text(
            "missing values", "", hint="Values that mark a missing sample, separated by spaces, such as -200 400."
        )
        self._gaps = gui.add_dropdown("gaps in time", tuple(GAPS), hint="How long gaps are filtered.")
        button = gui.add_button("Re-import", hint="Also reads what was added to the file.")
        on_user(button.on_click, lambda _client: self._submit())

    def _submit(self) -> None:
        def chosen(text: str) -> str | None:
            return None if text.strip() in ("", FOUND) else text.strip()

        self._read(
            options_from_text(
                chosen(self._delimiter.value),
                chosen(self._time.value),
                chosen(self._unit.value),
                self._missing.value.split(),
                GAPS[self._gaps.value],
            )
        )


FOUND = "auto"
"""Detect it from the file."""


GAPS = {"as rows": "rows", "as missing samples": "missing", "as elapsed time": "dt"}
"""How long gaps in time are filtered."""
