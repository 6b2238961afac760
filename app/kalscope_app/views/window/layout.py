"""Panels, their widths and heights, and the theme. The sums are pure; only `Panels` knows viser."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import viser
    from numpy.typing import NDArray

LEFT_WIDTH = 345
"""Width of the control panel, px."""

CANVAS_WIDTH = 120
"""Width of the 3D canvas between the panels without the map, px: the least that viser keeps."""

MAP_WIDTHS = (380, 520)
"""Least and greatest width of the tuning map, px."""

MAP_SHARE = 0.36
"""Share of the window beside the control panel that the map takes, within these widths."""

FIRST_RIGHT_WIDTH = 420
"""Width of the chart panel until a browser has told how large it is, px: leaves canvas to measure by."""

PROBE = 120
"""Width by which the chart panel grows to measure a window, px."""

PHONE_WIDTH = 576
"""Up to this width viser stacks the panels in one sheet, px."""

LEAST_HEIGHT = 250
"""A window that is measured lower than this was measured wrongly, px."""

WIDEST_SHAPE = 5.0
"""A window that is measured wider than this, width : height, was measured wrongly."""

CHROME_HEIGHT = 246
"""Height in px of what stands around the three charts: tab bar, heading, range, legends and gaps."""


@dataclass(frozen=True)
class Sizes:
    """Sizes that fill one window, px."""

    right_width: int
    canvas_width: int
    signal_height: int
    innovation_height: int
    gain_height: int
    window_height: int


def canvas_width_for(window_width: float, *, map_shown: bool) -> int:
    """Width of the canvas, px: room for the map, as long as the charts keep at least as much."""
    free = round(window_width) - LEFT_WIDTH
    wide = min(max(round(MAP_SHARE * free), MAP_WIDTHS[0]), MAP_WIDTHS[1])
    return wide if map_shown and free - wide >= wide else CANVAS_WIDTH


def sizes_for(window_width: float, window_height: float, *, map_shown: bool = True) -> Sizes:
    """Panel width and chart heights that fill a window and need no scrolling from 720 px of height on."""
    canvas = canvas_width_for(window_width, map_shown=map_shown)
    right = max(300, round(window_width) - LEFT_WIDTH - canvas)
    free = max(400, round(window_height) - CHROME_HEIGHT)
    innovation, gain = max(120, round(0.24 * free)), max(100, round(0.18 * free))
    return Sizes(right, canvas, max(180, free - innovation - gain), innovation, gain, round(window_height))


def gutter(*, dark: bool) -> NDArray[np.uint8]:
    """A plain picture for the canvas between the panels."""
    return np.full((2, 2, 3), (30, 32, 36) if dark else (236, 239, 242), dtype=np.uint8)


def window_size(
    first: tuple[float, float], second: tuple[float, float], *, docked: float, more: float
) -> tuple[float, float] | None:
    """Size of a browser's window, px, from two reports of the canvas between the panels; None if they do not tell.

    viser tells only the canvas's pixels, which are not the page's: the screen's pixel ratio and viser itself scale
    them. Their shape, width : height, is free of that. With `docked` px of panels the canvas has the shape
    (W − docked) : H; with `more` px docked beside them (W − docked − more) : H, and the difference gives H.

    Args:
        first: canvas width and height with `docked` px of panels.
        second: the same with `more` px added to the panels.
        docked: width of the panels, px.
        more: what was added, px.
    """
    if min(*first, *second) <= 0.0:
        return None
    shape, narrower = first[0] / first[1], second[0] / second[1]
    if shape - narrower < 0.02:  # a phone docks nothing, and a tiny window has nothing left to give
        return None
    height = more / (shape - narrower)
    width = shape * height + docked
    # Not yet docked when first seen, or still moving: such a pair of reports tells of an impossible window.
    return (width, height) if height >= LEAST_HEIGHT and width <= WIDEST_SHAPE * height else None


class Panels:
    """The control panel at the left edge and the chart panel at the right."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._right_width = FIRST_RIGHT_WIDTH
        self._dark: bool | None = None
        self.set_theme(dark=False)
        server.gui.main_panel.dock_left()
        server.gui.main_panel.set_width(LEFT_WIDTH)
        self.right = server.gui.add_panel()
        self.charts = self.right.add_tab("Signal")
        self.right.dock_right()
        self.right.set_width(FIRST_RIGHT_WIDTH)
        self.right.expand()

    def set_theme(self, *, dark: bool) -> None:
        """Light or dark; every call must name all options, or viser takes its own defaults again."""
        if dark == self._dark:
            return
        self._dark = dark
        self._server.scene.set_background_image(gutter(dark=dark), format="png")
        self._server.gui.configure_theme(
            dark_mode=dark,
            show_logo=False,
            show_share_button=False,
            brand_color=(86, 180, 233) if dark else (0, 114, 178),
        )

    @property
    def docked_width(self) -> float:
        """Width that both panels ask for, px."""
        return LEFT_WIDTH + self._right_width

    def set_right_width(self, width: int) -> None:
        """Width of the chart panel, px."""
        if width != self._right_width:
            self._right_width = width
            self.right.set_width(width)
