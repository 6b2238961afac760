"""The tuning map between the panels: its colours, its picture, and the mark of the present setting."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import viser
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from kalscope.common.text import DURATIONS, duration, number, squared, trimmed
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.program.user_settings import UserSettings
from kalscope_app.session.changes import momentum_words, pick_device, set_map_shown, set_point
from kalscope_app.session.session import Session
from kalscope_app.session.state import State
from kalscope_app.studies.tuning_map import (
    FleetLayer,
    MapFrame,
    Point,
    TuningMap,
    decades,
    diagonal,
    exponents_of,
    frame_for,
    lag_lines,
    nothing,
)
from kalscope_app.views.charts import DARK, LIGHT
from kalscope_app.views.phone import Pen
from kalscope_app.views.widgets import on_user, put
from kalscope_app.views.window import MAP_MARK, MAP_PICTURE, MAP_POINTED, MAP_PRESENT

if TYPE_CHECKING:
    from kalscope.fleet.results import Fleet


# Colours of the tuning map in both themes. Pure.


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
    devices=("#ffffff", "#f0a6ca", "#ff4f98", "#9aa0a6"),
    edge="#101317",
    density="#d0a2ee",
    shared="#ff4f98",
)


# The devices of a fleet in the picture of the tuning map. Pure: numpy and Pillow.


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
        pen.text((x + 20, y), "one filter for all; lines: best q/r, 95 %", palette.ink, 12, "lm")
        y += 19.0
    shown = [(kind, words) for kind, words in enumerate(layer.words) if words]
    for place, (kind, words) in enumerate(shown):
        left = x + (place % 2) * 0.5 * width
        pen.disc((left, y), RADIUS + 1.0, palette.devices[kind], palette.edge)
        pen.text((left + (20 if place % 2 == 0 else 12), y), words, palette.ink, 12, "lm")
        y += 19.0 if place % 2 or place == len(shown) - 1 else 0.0
    return y


# The tuning map as a picture: colours, contour, lines of equal lag, numbers, legend. Pure: numpy and Pillow.


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
    if not inputs.map.marks:
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
    pen.text((left, y), "log-likelihood below the best", palette.ink, 12, "lm")
    strip = colours(np.linspace(1.0, 0.0, round(SHARPNESS * (right - left)))[None, :], palette)
    pen.paste(Image.fromarray(np.repeat(strip, 10 * SHARPNESS, axis=0)), (left, y + 12))
    pen.outline((left, y + 12, right, y + 22), palette.quiet)
    free = -math.inf
    for shade, value in shown.marks:
        text = bare(value)
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


# The tuning map between the panels: a flat picture, the mark of the present point, what the mouse does.
#
# Picture, mark and mouse are hidden widgets here; `map.js` shows them over viser's canvas.


SIZE = (400.0, 800.0)
"""Width and height of the picture, px. Each browser fits it into the space between its panels."""

NOWHERE = (-1.0, -1.0)
"""The position that hides the mark."""

SHOW, HIDE = "Map", "Hide map"


class TuningMapView:
    """Picture, mark and mouse."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.on_device: Callable[[Fleet, int], None] = lambda _fleet, _device: None
        """Called when the device of an open fleet that is picked is clicked."""
        self._lock = threading.Lock()
        self._map: TuningMap = nothing("")
        self._state: State | None = None
        self._drawn: MapPictureInput | None = None
        self._frame = frame_for(*SIZE, self._map.q, self._map.r)

    def build_button(self, gui: viser.GuiApi, settings: UserSettings, jobs: Jobs) -> None:
        """The button of the header; what it does is remembered for the next start."""
        self._shown = gui.add_button(SHOW, hint="The map of q and r beside the charts: click or drag in it.")

        def toggle() -> None:
            shown = self._shown.label == SHOW
            self._session.request(set_map_shown(shown))
            jobs.run(partial(settings.keep, map_shown=shown))

        on_user(self._shown.on_click, lambda _client: toggle())

    def build_controls(self, gui: viser.GuiApi) -> None:
        """The widgets that the page shows as the map."""
        dot = np.zeros((2, 2, 3), dtype=np.uint8)
        self._picture = gui.add_image(dot, label=MAP_PICTURE, format="png", visible=False)
        self._mark = gui.add_image(draw_ring(dark=False), label=MAP_MARK, format="png", visible=False)
        self._present = gui.add_vector2(MAP_PRESENT, NOWHERE, visible=False, hint="Hidden.")
        self._pointed = gui.add_vector3(MAP_POINTED, (0.0, 0.0, 0.0), visible=False, hint="Hidden.")
        on_user(self._pointed.on_update, lambda _client: self._on_pointed())

    # What the user does.

    def _on_pointed(self) -> None:
        """File the pair under a drag or a click."""
        across, down, gesture = self._pointed.value
        frame, state = self._frame, self._state
        if state is None or not self._map.marks:
            return
        x, y = across * frame.width, down * frame.height
        if gesture < 0.0 and self._on_fleet((x, y)):
            return
        if gesture > 0.0 or frame.inside((x, y)):
            point = frame.held(frame.point((x, y)))
            self._session.request(set_point(*point), key=f"held:map {gesture:.0f}")

    def _on_fleet(self, at: Point) -> bool:
        """Whether a click is for a device: the first click names it, a second one opens it."""
        fleet = self._map.fleet
        if fleet is None:
            return False
        asked = self._state and self._state.fleet  # the map may be drawn a little later
        device, picked = fleet.nearest(self._frame, at), asked and asked.picked
        if device is not None and device == picked:
            self.on_device(fleet.fleet, device)
        elif device != picked:
            self._session.request(pick_device(device))
        return device is not None

    # What the user sees.

    def follow(self, frame: Frame) -> None:
        """Move the mark of an open map."""
        self._state = frame.state
        shown = frame.state.view.map_shown
        put(self._shown, label=HIDE if shown else SHOW)
        if shown:
            self._place(frame.state)

    def _place(self, state: State) -> None:
        visible = bool(self._map.marks) and state.is_standard
        put(self._present, value=self._share(exponents_of(state.tuning.q, state.tuning.r)) if visible else NOWHERE)

    def _share(self, point: Point) -> Point:
        """The position of a pair of exponents, in shares of the picture; on the edge of the map if outside."""
        frame = self._frame
        x, y = frame.pixel(frame.held(point))
        return x / frame.width, y / frame.height

    def on_emptied(self) -> None:
        """A click means nothing without a picture."""
        self._map = nothing("")
        put(self._present, value=NOWHERE)

    def show(self, answer: tuple[State, TuningMap] | None) -> None:
        """Draw the map of a state whose values have stopped changing; None: it is closed."""
        if answer is None:
            return
        with self._lock:
            self._state, self._map = answer
            self._draw(answer[0])

    def _draw(self, state: State) -> None:
        self._frame = frame_for(*SIZE, self._map.q, self._map.r, self._map.momentum)
        inputs = picture_input(state, self._map, self._frame)
        self._place(state)
        if self._drawn is not None and same_picture(inputs, self._drawn):
            return
        self._mark.image, self._picture.image = draw_ring(dark=inputs.dark), draw_map_picture(inputs)
        self._drawn = inputs


def picture_input(state: State, shown: TuningMap, frame: MapFrame) -> MapPictureInput:
    """What the picture is drawn from."""
    pinned = tuple(
        (v.name, v.css(dark=state.view.dark), exponents_of(v.tuning.q, v.tuning.r)) for v in state.variants
    )
    period, dark = state.recording.sample_period, state.view.dark
    return MapPictureInput(shown, frame, state.tuning.unit, period, dark, pinned)


def same_picture(one: MapPictureInput, other: MapPictureInput) -> bool:
    """Whether two inputs give the same picture; maps hold arrays, which have no single equality."""
    rest = [(p.frame, p.unit, p.period, p.dark, p.pinned) for p in (one, other)]
    return one.map is other.map and rest[0] == rest[1]
