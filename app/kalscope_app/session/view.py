"""How the open recording is shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

MAP_COLOURS: tuple[str, ...] = ("likelihood", "RMSE", "lag")
"""What the tuning map may be coloured by; RMSE where the truth is known."""


@dataclass(frozen=True)
class View:
    """How it is shown. It outlives the recording, and Undo does not change it."""

    dark: bool = False
    """Dark theme."""
    map_shown: bool = False
    """Whether the tuning map is shown where the window is wide enough."""
    map_colour: str = "likelihood"
    """What the tuning map is coloured by, one of MAP_COLOURS."""
    smoother: bool = False
    """Whether the best possible offline curve is drawn."""
    velocity: bool = False
    """Whether the velocity is drawn in place of the gain, where the filter has momentum."""
    gain_shown: bool = False
    """Whether the gain chart is drawn."""
    why_shown: bool = False
    """Whether the reasons for the verdict are shown."""
    match_by: Literal["lag", "noise"] = "lag"
    """What simpler filters are made equal in."""
    drawn_alternative: str = "Moving average"
    """The simpler filter that is drawn beside the present one; any other word draws all."""
    search_method: str = "maximum lag"
    """How q and r are searched, one of the search methods of the dashboard."""
    preset: str = ""
    """Title of the preset that is selected; "" = the first."""
    window: tuple[float, float] | None = None
    """First and last time on screen, s; None = the whole recording."""
    resets: int = 0
    """How often the view was reset: a new number makes the charts forget their zoom."""


AS_OPENED = View()
"""The view at first."""
