"""The panels, their sizes and the theme. Sizes are for a window 900 px high; `page_script` fits them to others."""

from __future__ import annotations

import viser

LEFT_WIDTH = 345
"""Width of the control panel, px."""

RIGHT_WIDTH = 679
"""Width of the chart panel beside the tuning map in a window 1440 px wide, px."""

RIGHT_WIDTH_WITHOUT_MAP = 965
"""The same without the map, px: viser keeps a strip of its canvas, which the page covers."""

WINDOW_HEIGHT = 900
"""Height of the window for which all heights below are given, px."""

CHROME_HEIGHT = 166
"""Height of everything above and below the charts of the Signal tab: tab bar, range, heading; px. Firefox draws the
tab bar and the heading 2 px higher than Chromium."""

FRAME_HEIGHT = 26
"""Height of what surrounds each chart: its legend and the gap below it, px."""


def height_of(share: float, charts: int = 3) -> int:
    """Height of one of `charts` charts that takes this share of the space that a window has for them, px."""
    return round(share * (WINDOW_HEIGHT - CHROME_HEIGHT - charts * FRAME_HEIGHT))


def shape_of(client: viser.ClientHandle) -> float | None:
    """Width : height of a browser's canvas; None before it is known."""
    width, height = client.camera.image_width, client.camera.image_height
    return width / height if width > 0 and height > 0 else None


class Panels:
    """The control panel at the left edge and the chart panel at the right."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._dark: bool | None = None
        self._map_shown = False
        self.set_theme(dark=False)
        server.scene.configure_default_lights(False, cast_shadow=False)  # only phones see it: a flat picture
        server.gui.main_panel.dock_left()
        server.gui.main_panel.set_width(LEFT_WIDTH)
        self.right = server.gui.add_panel()
        self.charts = self.right.add_tab("Signal")
        self.right.dock_right()
        self.right.set_width(RIGHT_WIDTH_WITHOUT_MAP)
        self.right.expand()

    def set_theme(self, *, dark: bool) -> None:
        """Light or dark; every call must name all options, or viser takes its own defaults again."""
        if dark == self._dark:
            return
        self._dark = dark
        self._server.gui.configure_theme(
            dark_mode=dark,
            show_logo=False,
            show_share_button=False,
            brand_color=(86, 180, 233) if dark else (0, 114, 178),
        )

    def set_map_shown(self, shown: bool) -> None:
        """Leave space for the map, or give it to the charts."""
        if shown != self._map_shown:
            self._map_shown = shown
            self.right.set_width(RIGHT_WIDTH if shown else RIGHT_WIDTH_WITHOUT_MAP)
