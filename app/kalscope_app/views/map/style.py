"""Colours of the tuning map in both themes. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from kalscope_app.views.charts.style import DARK, LIGHT


@dataclass(frozen=True)
class MapPalette:
    """Colours of one theme; lightness alone tells good from bad, so every eye can."""

    background: str
    ink: str
    quiet: str
    shades: tuple[str, ...]
    """From worst to best."""
    lines: tuple[int, int, int, int]
    """Lines of equal lag."""
    halo: tuple[int, int, int, int]
    """Around a line that must be seen on every shade."""
    contour: str
    best: str
    point: str
    """The present q and r, in the colour of the filtered curve."""
    chip: str
    """Behind the chosen colouring."""
    on_chip: str
    devices: tuple[str, str, str, str]
    """Classes of the devices of a fleet, from usual to remarkable, and those without any."""
    edge: str
    """Around them."""
    density: str
    """Where many of them are."""
    shared: str
    """The filter for all of them."""


LIGHT_MAP = MapPalette(
    background="#eceff2",
    ink="#343a40",
    quiet="#5c666f",
    shades=("#ffffff", "#d3e3f1", "#9cc4e2", "#5a9fd0", "#2672ad", "#0b4479"),
    lines=(40, 46, 54, 90),
    halo=(255, 255, 255, 110),
    contour="#f7c948",
    best="#f7c948",
    point=LIGHT.filtered,
    chip="#0072B2",
    on_chip="#ffffff",
    devices=("#ffffff", "#f0a6ca", "#c2185b", "#9aa0a6"),
    edge="#343a40",
    density="#6a1b9a",
    shared="#c2185b",
)
DARK_MAP = MapPalette(
    background="#1e2024",
    ink="#d5dae1",
    quiet="#9aa4af",
    shades=("#101317", "#152a40", "#1b4a74", "#2976b0", "#5fb4e6", "#dff3ff"),
    lines=(235, 240, 245, 80),
    halo=(16, 19, 23, 130),
    contour="#c2410c",
    best="#c2410c",
    point=DARK.filtered,
    chip="#56B4E9",
    on_chip="#101317",
    devices=("#ffffff", "#f0a6ca", "#ff4f98", "#9aa0a6"),
    edge="#101317",
    density="#d0a2ee",
    shared="#ff4f98",
)
