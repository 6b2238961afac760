"""The tour: up to five windows for new users. Each browser has its own."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import viser

from kalscope_app.engine.jobs import Jobs
from kalscope_app.views.binding import on_user

if TYPE_CHECKING:
    from kalscope_app.program.user_settings import UserSettings

STEPS = (
    (
        "Raw and filtered",
        "The grey line is the raw signal, the orange one the filtered signal. The true value should lie in the "
        "band around it.\n\nDrag across a chart to zoom; double-click to zoom out.",
    ),
    (
        "Two sliders set the filter",
        "**q** is how fast the true value moves: larger follows faster. **r** is how noisy the sensor is: larger "
        "smooths more. Only their ratio shapes the curve; **p0** matters only at the start. **Momentum**, off at "
        "first, suits a signal that keeps its direction: less noise at the same lag, but steps overshoot.\n\n"
        "**Resulting filter**, below the sliders, shows the lag and the noise reduction.",
    ),
    (
        "Or let Kalscope find them",
        "**Find q and r** estimates them from the recording, or from your goal: choose *maximum lag* and type 50 "
        "for the setting with the least noise of all that lag by 50 ms or less.\n\n"
        "**Does it fit?** says what to change. Ctrl+Z undoes every step.",
    ),
    (
        "Keep and compare",
        "**Pin this setting** keeps it as A, B, C … with a line in the chart. The **Compare** tab lists all "
        "of them in one table. **Presets** are settings to start from.",
    ),
    (
        "Your own signal, and export",
        "**Source** opens your file or generates a signal. **Export** writes code, the setting and the filtered "
        "signal, and one command that reopens this session.\n\n**Help** lists the keys and shows this tour again.",
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
