"""The form that says how a file is to be read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kalscope.sources.lines.read_options import ReadOptions, options_from_text

if TYPE_CHECKING:
    from collections.abc import Callable

    import viser


class ReadingForm:
    """What the sniffer decided can be decided otherwise; empty boxes leave it to the sniffer."""

    def __init__(self, gui: viser.GuiApi, read: Callable[[ReadOptions], None]) -> None:
        self._read = read
        self._delimiter = gui.add_dropdown(
            "delimiter", (FOUND, "comma", "semicolon", "tab", "bar", "space"), hint="The mark between two cells."
        )
        self._time = gui.add_text("time column", "", hint="Its name, its number from 1, or none.")
        self._unit = gui.add_dropdown(
            "time unit",
            (FOUND, "s", "ms", "us", "ns", "min", "h", "day", "year"),
            hint="What one step of a numeric time column is.",
        )
        self._missing = gui.add_text(
            "missing values", "", hint="Values that mean: no sample, with spaces between, such as -200 400."
        )
        self._gaps = gui.add_dropdown("gaps in time", tuple(GAPS), hint="How long gaps are filtered.")
        gui.add_button("Read again", hint="Also takes in what was added to the file.").on_click(self._on_read)

    async def _on_read(self, _event: viser.GuiEvent[Any]) -> None:
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


FOUND = "as found"
"""Leave a choice to the sniffer."""


GAPS = {"as rows": "rows", "as missing samples": "missing", "as elapsed time": "dt"}
"""What long gaps in time become."""
