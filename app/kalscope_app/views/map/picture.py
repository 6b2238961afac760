"""The tuning map as a picture: colours, contour, lines of equal lag, numbers, legend. Pure: numpy and Pillow."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from kalscope.common.text import DURATIONS, duration, number, squared, trimmed
from kalscope_app.session.changes.momentum import momentum_words
from kalscope_app.studies.map_geometry import MapFrame, Point, decades, diagonal, lag_lines
from kalscope_app.studies.tuning_map import TuningMap
from kalscope_app.views.charts.pen import Pen
from kalscope_app.views.map.fleet_marks import draw_density, draw_devices, draw_picked, write_fleet_legend
from kalscope_app.views.map.style import DARK_MAP, LIGHT_MAP, MapPalette

SHARPNESS = 2
"""Pixels drawn for each pixel of the page, along each side: smooth lines, and sharp on a high-resolution screen."""

LEVELS = 24
"""Steps of colour: their edges are the contour lines of the map."""

FIRST_PAPER = 0.01
"""q/r of the first source document, r/q = 100."""


@dataclass(frozen=True)
class MapPictureInput:
    """All that a picture of the map is drawn from."""

    map: TuningMap
    frame: MapFrame
    unit: str
    """Unit of the signal."""
    period: float | None
    """Sample period, s."""
    dark: bool
    truth: bool
    """Whether RMSE can be chosen."""
    pinned: tuple[tuple[str, str, Point], ...] = ()
    """Name, colour and exponents of each pinned variant."""

    @property
    def lag_unit(self) -> tuple[str, float]:
        """The unit of lags, and the length of a sample in it: s, for slow recordings min to years."""
        if self.period is None:
            return "samples", 1.0
        name, length = next((u for u in reversed(DURATIONS) if u[1] >= 1.0 and self.period >= u[1]), ("s", 1.0))
        return name, self.period / length


def draw_map_picture(inputs: MapPictureInput) -> NDArray[np.uint8]:
    """The whole picture, shape (SHARPNESS · height, SHARPNESS · width, 3)."""
    frame, palette = inputs.frame, DARK_MAP if inputs.dark else LIGHT_MAP
    size = round(SHARPNESS * frame.width), round(SHARPNESS * frame.height)
    image = Image.new("RGB", size, palette.background)
    pen = Pen(image, SHARPNESS)
    if not inputs.map.colour:
        pen.paragraph((24, 0.3 * frame.height), inputs.map.note, palette.quiet, 14, frame.width - 48)
        return np.asarray(image)
    left, top, right, bottom = (
        round(SHARPNESS * edge) for edge in (frame.left, frame.top, frame.right, frame.bottom)
    )
    box = left, top, right, bottom
    image.paste(heat(inputs.map.shade, palette, right - left, bottom - top), (left, top))
    if inputs.map.fleet is not None:
        draw_density(image, inputs.map.fleet, palette, box)
    _draw_inside(image, inputs, palette, box)
    pen.draw.rectangle(box, outline=palette.quiet, width=SHARPNESS)
    _write_chips(pen, inputs, palette)
    _write_lags(pen, inputs, palette)
    _write_axes(pen, inputs, palette)
    y = _write_bar(pen, inputs, palette, frame.bottom + 62)
    _write_legend(pen, inputs, palette, y + 12)
    return np.asarray(image)


def heat(shade: NDArray[np.float64], palette: MapPalette, width: int, height: int) -> Image.Image:
    """Shades as stepped colours, row 0 of the cells at the bottom."""
    smooth = Image.fromarray(shade[::-1].astype(np.float32)).resize((width, height), Image.Resampling.BILINEAR)
    return Image.fromarray(colours(np.asarray(smooth), palette))


def colours(shade: NDArray[np.floating], palette: MapPalette) -> NDArray[np.uint8]:
    """Colour of each shade 0 … 1, shape (…, 3)."""
    stops = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in palette.shades], dtype=float)
    at = np.linspace(0.0, 1.0, len(stops))
    centres = (np.arange(LEVELS) + 0.5) / LEVELS
    table = np.stack([np.interp(centres, at, stops[:, i]) for i in range(3)], axis=-1).astype(np.uint8)
    return table[np.clip((np.asarray(shade) * LEVELS).astype(int), 0, LEVELS - 1)]


def _draw_inside(
    image: Image.Image, inputs: MapPictureInput, palette: MapPalette, box: tuple[int, int, int, int]
) -> None:
    """Everything that must not leave the frame: drawn on a layer that is cut to it."""
    layer = Image.new("RGBA", image.size, (0, 0, 0, 0))
    pen, frame = Pen(layer, SHARPNESS), inputs.frame
    for line in lag_lines(frame, inputs.lag_unit[1]):
        pen.line([line.start, line.end], palette.lines, 1)
    paper = diagonal(frame, FIRST_PAPER)
    if paper is not None:
        pen.line([paper.start, paper.end], palette.halo, 4)
        pen.dashes(paper.start, paper.end, palette.ink, 1.5)
    if inputs.map.contour is not None:
        points = [frame.pixel((q, r)) for q, r in inputs.map.contour.tolist()]
        pen.line(points, palette.background, 4)
        pen.line(points, palette.contour, 2)
    if inputs.map.fleet is not None:
        draw_devices(pen, inputs.map.fleet, palette, frame)
    if inputs.map.optimum is not None:
        pen.cross(frame.pixel(frame.held(inputs.map.optimum)), palette.best, palette.background)
    for name, colour, point in inputs.pinned:
        pen.badge(frame.pixel(frame.held(point)), name, colour, palette.background)
    if inputs.map.fleet is not None:
        draw_picked(pen, inputs.map.fleet, palette, frame)
    inside = box[0], box[1], box[2] + 1, box[3] + 1
    part = layer.crop(inside)
    image.paste(part, inside[:2], part)


def chips(frame: MapFrame, truth: bool) -> tuple[tuple[str, tuple[float, float, float, float]], ...]:
    """The colourings to choose from above the map, each with its box, pixels: left, top, right, bottom."""
    names = (("likelihood", 82.0), *((("RMSE", 58.0),) if truth else ()), ("lag", 44.0))
    boxes: list[tuple[str, tuple[float, float, float, float]]] = []
    x = frame.left + 62.0
    for name, width in names:
        boxes.append((name, (x, 12.0, x + width, 36.0)))
        x += width + 6.0
    return tuple(boxes)


def _write_chips(pen: Pen, inputs: MapPictureInput, palette: MapPalette) -> None:
    pen.text((inputs.frame.left, 24), "colour by", palette.quiet, 12, "lm")
    for name, (left, top, right, bottom) in chips(inputs.frame, inputs.truth):
        chosen = name == inputs.map.colour
        pen.box((left, top, right, bottom), palette.chip if chosen else None, palette.chip)
        colour = palette.on_chip if chosen else palette.ink
        pen.text((0.5 * (left + right), 0.5 * (top + bottom)), name, colour, 12, "mm")


def _write_lags(pen: Pen, inputs: MapPictureInput, palette: MapPalette) -> None:
    """The lag of each line where it leaves the map, at the top or the right edge."""
    frame, free = inputs.frame, -math.inf
    pen.text((0.5 * (frame.left + frame.right), frame.top - 34), title_of(inputs), palette.quiet, 12, "ms")
    for line in sorted(lag_lines(frame, inputs.lag_unit[1]), key=lambda one: one.end[0]):
        text = lag_words(line.lag, inputs)
        x, y = line.end
        if y > frame.top + 1.0:
            if y > frame.top + 8.0:
                pen.text((frame.right + 5, y), text, palette.ink, 11, "lm")
        elif x - 0.5 * pen.width(text, 11) > free:
            pen.text((x, frame.top - 7), text, palette.ink, 11, "ms")
            free = x + 0.5 * pen.width(text, 11) + 6.0


def title_of(inputs: MapPictureInput) -> str:
    """The heading above the lags: the momentum, where the filters on the map have any."""
    momentum = inputs.frame.momentum
    return f"at momentum {momentum_words(momentum, inputs.period)}: lag" if momentum > 0.0 else "lag"


def lag_words(lag: float, inputs: MapPictureInput) -> str:
    """A lag, in samples, as a length of time in one unit for the whole map, or in samples without a time."""
    name, sample = inputs.lag_unit
    value = lag * sample
    if name == "s" and value < 1.0:
        return duration(value)
    return trimmed(value) if name == "samples" else f"{trimmed(value)} {name}"


def _write_axes(pen: Pen, inputs: MapPictureInput, palette: MapPalette) -> None:
    frame = inputs.frame
    for e in decades(*frame.q):
        x = frame.pixel((e, 0.0))[0]
        pen.line([(x, frame.bottom), (x, frame.bottom + 4)], palette.quiet, 1)
        pen.text((x, frame.bottom + 16), tick(e), palette.ink, 11, "mm")
    for e in decades(*frame.r):
        y = frame.pixel((0.0, e))[1]
        pen.line([(frame.left - 4, y), (frame.left, y)], palette.quiet, 1)
        pen.text((frame.left - 7, y), tick(e), palette.ink, 11, "rm")
    unit = squared(inputs.unit)
    middle = 0.5 * (frame.left + frame.right)
    pen.text((middle, frame.bottom + 36), f"process noise q, {unit}", palette.ink, 13, "mm")
    pen.upright((14, 0.5 * (frame.top + frame.bottom)), f"measurement noise r, {unit}", palette.ink, 13)


def tick(exponent: int) -> str:
    """A power of ten, short enough for the axis: 0.001, 1, 1 000, 1e-6."""
    return number(10.0**exponent, 1) if -3 <= exponent <= 4 else f"1e{exponent}"


def _write_bar(pen: Pen, inputs: MapPictureInput, palette: MapPalette, y: float) -> float:
    """The colour bar with its numbers; returns where it ends."""
    frame, shown = inputs.frame, inputs.map
    left, right = frame.left, frame.right
    titles = {
        "likelihood": "log-likelihood below the best",
        "RMSE": f"error against the truth, RMSE ({inputs.unit or 'unit'})",
        "lag": "lag" + ("" if inputs.period else " (samples)"),
    }
    pen.text((left, y), titles[shown.colour], palette.ink, 12, "lm")
    strip = colours(np.linspace(1.0, 0.0, round(SHARPNESS * (right - left)))[None, :], palette)
    pen.paste(Image.fromarray(np.repeat(strip, 10 * SHARPNESS, axis=0)), (left, y + 12))
    pen.outline((left, y + 12, right, y + 22), palette.quiet)
    free = -math.inf
    for shade, value in shown.marks:
        text = lag_words(value, inputs) if shown.colour == "lag" else bare(value)
        x = left + (1.0 - shade) * (right - left)
        begin = min(max(x - 0.5 * pen.width(text, 11), left), right - pen.width(text, 11))
        if begin > free:
            pen.line([(x, y + 22), (x, y + 26)], palette.quiet, 1)
            pen.text((begin, y + 34), text, palette.ink, 11, "lm")
            free = begin + pen.width(text, 11) + 8.0
    return y + 42


def bare(value: float) -> str:
    """A number of the colour bar, short."""
    return f"{value:.0e}".replace("e+0", "e") if value >= 1e4 else trimmed(value)


def _write_legend(pen: Pen, inputs: MapPictureInput, palette: MapPalette, y: float) -> None:
    frame, shown = inputs.frame, inputs.map
    x, words = frame.left + 12.0, frame.left + 32.0
    rows = [("point", "current q and r: drag it, or click")]
    if shown.optimum is not None:
        off = " (off the map)" if math.inf in map(abs, shown.optimum) else ""
        rows.append(("best", f"most likely q and r{off}"))
    if shown.contour is not None:
        inside = " (inside the cross)" if hidden(frame, shown) else ": less than 3.00 below the best"
        rows.append(("contour", f"95 % region{inside}"))
    rows.append(("paper", "r/q = 100 (Ma'arif 2019)"))
    if inputs.pinned:
        rows.append(("pinned", "pinned settings"))
    for kind, text in rows:
        _draw_key(pen, kind, (x, y), inputs, palette)
        pen.text((words, y), text, palette.ink, 12, "lm")
        y += 19.0
    if shown.fleet is not None:
        y = write_fleet_legend(pen, shown.fleet, palette, (x, y), frame.width - frame.left - 12, inputs.unit)
    if shown.note:
        pen.paragraph((frame.left, y), shown.note, palette.quiet, 11, frame.width - frame.left - 12)


def hidden(frame: MapFrame, shown: TuningMap) -> bool:
    """Whether the cross of the best pair covers the 95 % region, as it does for a long recording."""
    if shown.contour is None:
        return False
    pixels = np.array([frame.pixel((q, r)) for q, r in shown.contour.tolist()])
    return bool((np.ptp(pixels, axis=0) < 12.0).all())


def _draw_key(pen: Pen, kind: str, at: Point, inputs: MapPictureInput, palette: MapPalette) -> None:
    x, y = at
    if kind == "point":
        pen.ring(at, 6.0, palette.point, palette.background)
    elif kind == "best":
        pen.cross(at, palette.best, palette.ink)
    elif kind == "contour":
        pen.oval((x - 10, y - 5, x + 10, y + 5), palette.contour)
    elif kind == "paper":
        pen.dashes((x - 11, y), (x + 11, y), palette.ink, 1.5)
    else:
        name, colour, _ = inputs.pinned[0]
        pen.badge(at, name, colour, palette.background)


def draw_ring(*, dark: bool) -> NDArray[np.uint8]:
    """The mark of the present point, shape (64, 64, 4): a ring with a dot, with an edge of the other lightness."""
    palette = DARK_MAP if dark else LIGHT_MAP
    image = Image.new("RGBA", (64, 64), (0, 0, 0, 0))
    draw = ImageDraw.Draw(image)
    for width, colour in ((13, palette.background), (7, palette.point)):
        inset = 6 + (13 - width) // 2
        draw.ellipse((inset, inset, 63 - inset, 63 - inset), outline=colour, width=width)
    draw.ellipse((27, 27, 36, 36), fill=palette.point, outline=palette.background, width=2)
    return np.asarray(image)
