"""The devices of a fleet in the picture of the tuning map. Pure: numpy and Pillow."""

from __future__ import annotations

import numpy as np
from PIL import Image

from kalscope.common.text import squared
from kalscope_app.studies.fleet_layer import FleetLayer
from kalscope_app.studies.map_geometry import MapFrame, Point, diagonal
from kalscope_app.views.charts.pen import Pen
from kalscope_app.views.map.style import MapPalette

RADIUS = 3.0
"""Of a point, pixels of the page."""


def draw_density(
    image: Image.Image, layer: FleetLayer, palette: MapPalette, box: tuple[int, int, int, int]
) -> None:
    """Lay the density of the devices over the colours of the map, in the box of its frame."""
    if layer.density is None:
        return
    left, top, right, bottom = box
    shares = layer.density[::-1]
    alpha = np.where(shares > 0.0, 70.0 + 170.0 * shares, 0.0).astype(np.uint8)
    mask = Image.fromarray(alpha).resize((right - left, bottom - top), Image.Resampling.NEAREST)
    image.paste(Image.new("RGB", mask.size, palette.density), (left, top), mask)


def draw_devices(pen: Pen, layer: FleetLayer, palette: MapPalette, frame: MapFrame) -> None:
    """Draw the points, the filter for all, and the q/r that the fleet allows."""
    lines = [diagonal(frame, 10.0**end) for end in set(layer.ratio_ends or ())]
    for width, colour in ((3.5, palette.background), (1.5, palette.shared)):  # no halo over the other line
        for line in lines:
            if line is not None:
                pen.line([line.start, line.end], colour, width)
    for point, kind in zip(layer.points.tolist(), layer.classes.tolist(), strict=True):
        pen.disc(frame.pixel((point[0], point[1])), RADIUS, palette.devices[kind], palette.edge)
    if layer.shared is not None:
        draw_shared(pen, frame.pixel(frame.held(layer.shared)), palette)


def draw_picked(pen: Pen, layer: FleetLayer, palette: MapPalette, frame: MapFrame) -> None:
    """The device that was clicked: a ring around it, and what it is, in the half of the map that it is not in."""
    if layer.picked is None:
        return
    at = frame.pixel(layer.picked.point)
    pen.ring(at, 2.5 * RADIUS, palette.ink, palette.background)
    lines = layer.picked.words
    width, height = max(pen.width(line, 12) for line in lines) + 16.0, 18.0 * len(lines) + 8.0
    left, top = frame.left + 8.0, frame.top + 8.0
    if at[1] < 0.5 * (frame.top + frame.bottom):
        top = frame.bottom - height - 8.0
    pen.box((left, top, left + width, top + height), palette.background, palette.quiet)
    for place, line in enumerate(lines):
        pen.text(
            (left + 8.0, top + 13.0 + 18.0 * place), line, palette.quiet if place == 2 else palette.ink, 12, "lm"
        )


def draw_shared(pen: Pen, at: Point, palette: MapPalette) -> None:
    """The mark of the filter for all: a diamond that hides no device inside of it."""
    (x, y), reach = at, 8.0
    corners = [(x - reach, y), (x, y - reach), (x + reach, y), (x, y + reach)]
    for width, colour in ((4.5, palette.background), (2.0, palette.shared)):
        pen.line([*corners, *corners[:2]], colour, width)


def write_fleet_legend(
    pen: Pen, layer: FleetLayer, palette: MapPalette, at: Point, width: float, unit: str
) -> float:
    """Write what the marks are, two colours per row; returns where it ends. `unit` is that of the recording."""
    x, y = at
    if layer.unit != unit:
        pen.text((x + 20, y), f"devices: q and r in {squared(layer.unit)[:24]}", palette.ink, 12, "lm")
        y += 19.0
    if layer.shared is not None:
        draw_shared(pen, (x, y), palette)
        pen.text((x + 20, y), "one filter for all; line: its q/r, 95 %", palette.ink, 12, "lm")
        y += 19.0
    shown = [(kind, words) for kind, words in enumerate(layer.words) if words]
    for place, (kind, words) in enumerate(shown):
        left = x + (place % 2) * 0.5 * width
        pen.disc((left, y), RADIUS + 1.0, palette.devices[kind], palette.edge)
        pen.text((left + (20 if place % 2 == 0 else 12), y), words, palette.ink, 12, "lm")
        y += 19.0 if place % 2 or place == len(shown) - 1 else 0.0
    return y
