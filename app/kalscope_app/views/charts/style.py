"""Colours, lines and axes that the charts share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope_app.engine.decimation import DrawnSamples


@dataclass(frozen=True)
class Palette:
    """Colours of one theme; hues from the colour-blind-safe set of the Arduino plotter.

    Every line has a contrast of 3 : 1 with its background, as WCAG 2.2 requires of graphics (1.4.11).
    """

    raw: str
    raw_band: str
    filtered: str
    truth: str
    innovation: str
    gain: str
    smoothed: str
    band: str
    innovation_band: str
    velocity_band: str
    board: str


LIGHT = Palette(
    raw="#8595a3",
    raw_band="rgba(133, 149, 163, 0.34)",
    filtered="#D55E00",
    truth="#0072B2",
    innovation="#009E73",
    gain="#CC79A7",
    smoothed="#1b9e8a",
    band="rgba(213, 94, 0, 0.14)",
    innovation_band="rgba(0, 158, 115, 0.14)",
    velocity_band="rgba(204, 121, 167, 0.16)",
    board="#7b3fa0",
)


DARK = Palette(
    raw="#6f7f8d",
    raw_band="rgba(111, 127, 141, 0.34)",
    filtered="#ff8a3d",
    truth="#56B4E9",
    innovation="#2fc99b",
    gain="#e39ac6",
    smoothed="#3fd6bd",
    band="rgba(255, 138, 61, 0.20)",
    innovation_band="rgba(47, 201, 155, 0.18)",
    velocity_band="rgba(227, 154, 198, 0.20)",
    board="#c9a0ff",
)


SENSORS = {
    False: ("#6598c3", "#a785c7", "#60a359", "#af8f3b", "#c57f8f", "#4fa09d", "#8595a3", "#a69076"),
    True: ("#4f7796", "#7e6495", "#5b8557", "#8c783f", "#91626d", "#4b8583", "#6f7f8d", "#7b6c59"),
}
"""Of fused sensors in their order, light and dark: easy to tell apart, and paler than the fused line."""


@dataclass(frozen=True)
class ChartLine:
    """One line of a chart."""

    y: Array
    """Values, unit."""
    style: dict[str, object]
    """uPlot series."""
    gaps: bool = False
    """Drawn as points, with gaps where y is NaN."""


def gappy(label: str, y: Array, colour: str, quiet: int = 0) -> tuple[ChartLine, ...]:
    """A measured line. With missing samples (after the first `quiet`): points, and the last value for the range.

    uPlot draws a line across every gap, and takes no range from a line that begins with one.
    """
    if not np.isnan(y[quiet:]).any():
        return (ChartLine(y, line(label, colour)),)
    return ChartLine(y, dots(label, colour, 3), gaps=True), ChartLine(y, line(f"last {label}"))


def raw_lines(shown: DrawnSamples, palette: Palette) -> tuple[ChartLine, ...]:
    """The measurements: a line, points where some are missing, or the edges of a band where they are dense."""
    if shown.band is None:
        return gappy("raw", shown.raw, palette.raw)
    low, high = shown.band
    return ChartLine(low, line("raw min", palette.raw, 0.5)), ChartLine(high, line("raw max", palette.raw, 0.5))


def short(name: str, limit: int) -> str:
    """A name cut to a length that fits beside an axis."""
    return name if len(name) <= limit else f"{name[: limit - 1]}…"


def dots(label: str, colour: str, size: float) -> dict[str, object]:
    """Dots without a line between them; the range of y need not include them."""
    marks = {"show": True, "size": size, "space": 0, "fill": colour, "stroke": colour}
    return {"label": label, "stroke": colour, "width": 0, "points": marks, "auto": False}


def rings(label: str, colour: str, size: float) -> dict[str, object]:
    """Thin rings around points of another line, which stay visible."""
    marks = {"show": True, "size": size, "space": 0, "fill": "transparent", "stroke": colour, "width": 1.5}
    return {"label": label, "stroke": colour, "width": 0, "points": marks, "auto": False}


def line(label: str, colour: str = "transparent", width: float = 1, *, scaled: bool = True) -> dict[str, object]:
    """A line without marks; without a colour it is the edge of a band; the range of y includes it if `scaled`."""
    return {"label": label, "stroke": colour, "width": width, "points": {"show": False}, "auto": scaled}


def axes(y: str, space: int = 22) -> tuple[dict[str, object], ...]:
    """Small type; x has its name in the legend, which saves a line; ticks of y are `space` px apart at least."""
    small = {
        "font": "12px sans-serif",
        "labelFont": "12px sans-serif",
        "labelSize": 20,
        "labelGap": 2,
        "gap": 3,
    }
    return ({**small, "size": 34}, {**small, "label": y, "size": 60, "space": space})
