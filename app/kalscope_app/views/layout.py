"""Panels, their widths and heights, and the theme. The sums are pure; only `Panels` knows viser."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import viser
from numpy.typing import NDArray

LEFT_WIDTH = 330
"""Width of the control panel, px."""

CANVAS_WIDTH = 120
"""Width of the 3D canvas between the panels, px: the least that viser keeps."""

FIRST_RIGHT_WIDTH = 560
"""Width of the chart panel until a browser has told how large it is, px: leaves canvas to measure by."""

PHONE_WIDTH = 576
"""Up to this width viser stacks the panels in one sheet, px."""

CHROME_HEIGHT = 246
"""Height in px of what stands around the three charts: tab bar, heading, range, legends and gaps."""


@dataclass(frozen=True)
class Sizes:
    """Sizes that fill one window, px."""

    right_width: int
    signal_height: int
    innovation_height: int
    gain_height: int


def sizes_for(window_width: float, window_height: float) -> Sizes:
    """Panel width and chart heights that fill a window and need no scrolling from 720 px of height on."""
    right = max(300, round(window_width) - LEFT_WIDTH - CANVAS_WIDTH)
    free = max(400, round(window_height) - CHROME_HEIGHT)
    innovation, gain = max(120, round(0.24 * free)), max(100, round(0.18 * free))
    return Sizes(right, max(180, free - innovation - gain), innovation, gain)


def gutter(*, dark: bool) -> NDArray[np.uint8]:
    """A plain picture for the canvas between the panels."""
    return np.full((2, 2, 3), (30, 32, 36) if dark else (236, 239, 242), dtype=np.uint8)


class WindowFinder:
    """Finds the size of a browser's window from all that viser tells: the pixels of the canvas between the panels.

    Those pixels are not the page's. They are scaled by the screen's pixel ratio, which viser changes as it likes,
    so only width : height is used. The first report shows the whole window, before the panels are docked; the
    next what they leave of it, and that fixes the scale. A change of height and shape together is a new window
    size; a change of width alone is the person dragging a divider, which is not ours to undo.
    """

    def __init__(self) -> None:
        self._whole: float | None = None
        self.first = (0.0, 0.0)
        """The first report, pixels: the same again is most likely the same window, reloaded."""
        self._height = 0.0
        self._reported = (0.0, 0.0)
        self.needs_room = False
        """The panels may have taken more than there is: dock them narrower and the next report will tell."""

    @property
    def shape(self) -> float:
        """Width : height of the window, 0 while unknown."""
        return self._whole or 0.0

    def report(self, width: float, height: float, docked: float) -> tuple[float, float] | None:
        """Take one report, pixels of any scale, with `docked` px of panels; the window's size if it is news."""
        if width <= 0.0 or height <= 0.0:
            return None
        shape, (old_shape, old_height) = width / height, self._reported
        self._reported = (shape, height)
        if self._whole is None:
            self._whole, self.first = shape, (width, height)
            return None
        if abs(shape - old_shape) <= 0.01 * old_shape:
            return None
        if self._height == 0.0:
            return self._calibrate(shape, docked)
        if height == old_height:
            return None
        self._height *= height / old_height
        return shape * self._height + docked, self._height

    def _calibrate(self, shape: float, docked: float) -> tuple[float, float] | None:
        """The canvas lost `docked` px of width; or all but CANVAS_WIDTH, which looks much the same."""
        whole = self._whole or 0.0
        if shape >= whole:
            self._whole = shape
            return None
        self.needs_room = docked > LEFT_WIDTH + FIRST_RIGHT_WIDTH
        if self.needs_room:
            return None
        height = docked / (whole - shape)
        self._height = height if shape * height >= CANVAS_WIDTH else CANVAS_WIDTH / shape
        return whole * self._height, self._height


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
