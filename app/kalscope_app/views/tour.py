"""The tour: five windows at most for who sees Kalscope first. Each browser has its own."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import viser

    from kalscope_app.engine.jobs import Jobs
    from kalscope_app.program.user_settings import UserSettings

STEPS = (
    (
        "Raw and filtered",
        "The pale line is what the sensor said, the orange one what the filter makes of it. The true value should "
        "lie in the band around it.\n\nDrag across a chart to zoom; a double click shows all again.",
    ),
    (
        "Two sliders decide",
        "**q** says how fast the true value wanders: larger follows faster. **r** says how noisy the sensor is: "
        "larger smooths more. Only their ratio shapes the curve; **p0** matters at the start alone.\n\n"
        "**What that means**, below the sliders, tells the lag and how much noise goes.",
    ),
    (
        "Or let them be found",
        "**Find q and r** asks the recording itself, or what you need: choose *least noise within a lag* and type "
        "50: of all settings that trail by 50 ms or less, that leaves least noise.\n\n"
        "**Does it fit?** says what to change. Ctrl+Z takes every step back.",
    ),
    (
        "Keep and compare",
        "**Pin this setting** keeps it as A, B, C … with a line in the chart. The tab **Compare** has all of them "
        "in one table. **Presets** are settings to begin with.",
    ),
    (
        "Your own signal, and out again",
        "**Source** opens a file of yours or makes a signal. **Export** writes the setting, the filtered signal, "
        "and one line that reopens all this.\n\n**Help** has the keys, and this tour.",
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
        """A browser has come: show the tour unless it was seen or put off."""
        if not self._over:
            self.show(client)

    def show(self, client: viser.ClientHandle, step: int = 0) -> None:
        """Show one window in one browser."""
        title, text = STEPS[step]
        last = step + 1 == len(STEPS)
        with client.gui.add_modal(f"{title} ({step + 1} of {len(STEPS)})") as window:
            client.gui.add_markdown(text)
            group = client.gui.add_button_group(
                "", (DONE,) if last else (NEXT, LATER, NEVER), hint="The tour is always there under Help."
            )
        group.on_click(partial(self._on_button, client, window, group, step))

    async def _on_button(
        self,
        client: viser.ClientHandle,
        window: Any,
        group: Any,
        step: int,
        _event: viser.GuiEvent[Any],
    ) -> None:
        window.close()
        if group.value == NEXT:
            self.show(client, step + 1)
            return
        self._over = True
        if group.value != LATER:
            self._jobs.run(self._settings.set_tour_seen)
