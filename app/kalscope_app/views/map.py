"""The tuning map between the panels: its colours, its picture, and the mark of the present setting."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
import viser
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from kalscope.common.charts import drawing
from kalscope.common.text import DURATIONS, duration, number, squared, trimmed
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.program.user_settings import UserSettings
from kalscope_app.session.changes import momentum_words, set_map_shown, set_point
from kalscope_app.session.session import Session
from kalscope_app.session.state import State
from kalscope_app.studies.tuning_map import (
    FleetLayer,
    MapFrame,
    Point,
    TuningMap,
    decades,
    exponents_of,
    lag_lines,
    nothing,
)
from kalscope_app.views.charts import DARK, LIGHT, Palette
from kalscope_app.views.phone import page_figure, pixels_of
from kalscope_app.views.widgets import on_user, put
from kalscope_app.views.window import MAP_MARK, MAP_PICTURE, MAP_POINTED, MAP_PRESENT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    from kalscope.fleet.results import Fleet


# pyright: reportUnknownMemberType=false
# matplotlib leaves the types of keyword arguments open.


# The tuning map as a picture by matplotlib: colours, contour, lines of equal lag, numbers, legend. Pure.
#
# matplotlib is imported where it draws, because that takes long.


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
    def palette(self) -> Palette:
        """The colours of the theme."""
        return DARK if self.dark else LIGHT

    @property
    def lag_unit(self) -> tuple[str, float]:
        """The unit of lags, and the length of a sample in it: s, for slow recordings min to years."""
        if self.period is None:
            return "samples", 1.0
        name, length = next((u for u in reversed(DURATIONS) if u[1] >= 1.0 and self.period >= u[1]), ("s", 1.0))
        return name, self.period / length


def draw_map_picture(inputs: MapPictureInput) -> NDArray[np.uint8]:
    """The whole picture, shape (SHARPNESS · height, SHARPNESS · width, 3)."""
    frame, palette = inputs.frame, inputs.palette
    with drawing():
        figure = page_figure(frame.width, frame.height, palette.paper, SHARPNESS)
        if inputs.map.marks:
            axes = figure.add_axes(frame.share(frame.top, frame.bottom))
            _draw_shades(axes, inputs)
            _draw_lags(axes, inputs)
            _write_axes(axes, inputs)
            _draw_bar(figure.add_axes(frame.share(frame.bottom + 72, frame.bottom + 82)), inputs)
            _write_legend(figure, _draw_marks(axes, inputs), inputs)
        else:
            figure.text(0.06, 0.7, fill(inputs.map.note, 44), color=palette.quiet, fontsize=14)
        return pixels_of(figure)


def shades(palette: Palette) -> Colormap:
    """The colours of the map in steps, from worst to best."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("map", palette.shades, LEVELS)


def _draw_shades(axes: Axes, inputs: MapPictureInput) -> None:
    """The likelihood, and the density of a large fleet over it."""
    from matplotlib.colors import ListedColormap

    frame, palette, fleet = inputs.frame, inputs.palette, inputs.map.fleet
    image: dict[str, Any] = {"extent": (*frame.q, *frame.r), "origin": "lower", "aspect": "auto"}
    axes.imshow(inputs.map.shade, shades(palette), vmin=0.0, vmax=1.0, interpolation="bilinear", **image)
    if fleet is not None and fleet.density is not None:
        shares = np.where(fleet.density > 0.0, 0.27 + 0.67 * fleet.density, 0.0)
        axes.imshow(np.full(shares.shape, 1.0), ListedColormap([palette.density]), alpha=shares, **image)


def _draw_lags(axes: Axes, inputs: MapPictureInput) -> None:
    """Lines of equal lag with the lag where each leaves the map, at the top or the right edge; the first paper."""
    from matplotlib.patheffects import Normal, Stroke

    frame, palette, free = inputs.frame, inputs.palette, -math.inf
    for lag, (q, r) in sorted(lag_lines(frame, inputs.lag_unit[1]), key=lambda one: one[1]):
        text, (x, y) = lag_words(lag, inputs), frame.pixel((q, r))
        axes.axline((q, r), slope=1.0, color=palette.ink, linewidth=1, alpha=0.4)
        half = 3.4 * len(text)
        style: dict[str, Any] = {"textcoords": "offset points", "color": palette.ink, "fontsize": 11}
        if y > frame.top + 8.0:
            axes.annotate(text, (q, r), (5, 0), va="center", **style)
        elif y <= frame.top + 1.0 and x - half > free:
            axes.annotate(text, (q, r), (0, 5), ha="center", **style)
            free = x + half + 6.0
    halo = [Stroke(linewidth=4, foreground=palette.paper, alpha=0.5), Normal()]
    axes.axline((0.0, -math.log10(FIRST_PAPER)), slope=1.0, color=palette.ink, linestyle="--", path_effects=halo)


def lag_words(lag: float, inputs: MapPictureInput) -> str:
    """A lag, in samples, as a length of time in one unit for the whole map, or in samples without a time."""
    name, sample = inputs.lag_unit
    value = lag * sample
    if name == "s" and value < 1.0:
        return duration(value)
    return trimmed(value) if name == "samples" else f"{trimmed(value)} {name}"


def _draw_marks(axes: Axes, inputs: MapPictureInput) -> list[Line2D]:
    """The region, the best pair, devices and pins; returns what the legend shows, from top to bottom."""
    from matplotlib.lines import Line2D
    from matplotlib.patheffects import Normal, Stroke

    frame, palette, shown = inputs.frame, inputs.palette, inputs.map
    halo = [Stroke(linewidth=4.5, foreground=palette.paper), Normal()]
    ring: dict[str, Any] = {
        "marker": "o",
        "linestyle": "",
        "markerfacecolor": "none",
        "markersize": 12,
        "markeredgewidth": 3,
    }
    handles: list[Line2D] = [
        Line2D([], [], color=palette.filtered, **ring, label="current q and r: drag it, or click")
    ]
    if shown.contour is not None:
        label = "95 % region: less than 3.00 below the best"
        handles += axes.plot(*shown.contour.T, color=palette.best, linewidth=2, path_effects=halo, label=label)
    handles.append(Line2D([], [], color=palette.ink, linestyle="--", label="r/q = 100 (Ma'arif 2019)"))
    if shown.fleet is not None:
        handles += _draw_devices(axes, shown.fleet, inputs)
    if shown.optimum is not None:
        off = " (off the map)" if math.inf in map(abs, shown.optimum) else ""
        style: dict[str, Any] = {
            "marker": "+",
            "linestyle": "",
            "markersize": 14,
            "markeredgewidth": 2.5,
            "path_effects": halo,
        }
        label = f"most likely q and r{off}"
        handles += _plot(axes, frame.held(shown.optimum), color=palette.best, **style, label=label)
    for name, colour, point in inputs.pinned:
        badge: dict[str, Any] = {"marker": "o", "linestyle": "", "markersize": 16, "markeredgecolor": palette.paper}
        handles += _plot(axes, frame.held(point), color=colour, **badge, label=f"pinned setting {name}")
        middle: dict[str, Any] = {"ha": "center", "va": "center_baseline", "fontsize": 11, "color": "white"}
        axes.text(
            *frame.held(point), name, path_effects=[Stroke(linewidth=2, foreground="black"), Normal()], **middle
        )
    return handles


def _plot(axes: Axes, at: Point, **style: Any) -> list[Line2D]:
    """A mark."""
    return axes.plot([at[0]], [at[1]], **style)


def _draw_devices(axes: Axes, layer: FleetLayer, inputs: MapPictureInput) -> list[Line2D]:
    """The devices by class, the filter for all, and the q/r that the fleet allows."""
    palette = inputs.palette
    handles: list[Line2D] = []
    for ratio in layer.ratio_ends or ():
        axes.axline((0.0, -ratio), slope=1.0, color=palette.devices[2], linewidth=1.5)
    for kind, words in enumerate(layer.words):
        points = layer.points[layer.classes == kind]
        style: dict[str, Any] = {"markersize": 6, "markeredgecolor": palette.ink}
        if words:
            handles += axes.plot(*points.T, "o", color=palette.devices[kind], **style, label=f"device, {words}")
    if layer.shared is not None:
        diamond: dict[str, Any] = {
            "marker": "D",
            "markersize": 11,
            "markerfacecolor": "none",
            "markeredgewidth": 2,
            "linestyle": "",
        }
        label = "one filter for all; lines: best q/r, 95 %"
        handles += _plot(axes, inputs.frame.held(layer.shared), color=palette.devices[2], **diamond, label=label)
    return handles


def title_of(inputs: MapPictureInput) -> str:
    """The heading above the lags: the momentum, where the filters on the map have any."""
    momentum = inputs.frame.momentum
    return f"at momentum {momentum_words(momentum, inputs.period)}: lag" if momentum > 0.0 else "lag"


def _write_axes(axes: Axes, inputs: MapPictureInput) -> None:
    """The decades of q and r, their names, and the frame around the map."""
    frame, palette, unit = inputs.frame, inputs.palette, squared(inputs.unit)
    axes.set(xlim=frame.q, ylim=frame.r)
    for axis, ends, name in (axes.xaxis, frame.q, "process noise q"), (axes.yaxis, frame.r, "measurement noise r"):
        ticks = decades(*ends)
        axis.set_ticks(ticks, [tick(e) for e in ticks])
        axis.set_label_text(f"{name}, {unit}", color=palette.ink, fontsize=13)
    axes.set_title(title_of(inputs), loc="center", color=palette.quiet, fontsize=12, fontweight="normal", pad=24)
    axes.tick_params(length=4, pad=4, color=palette.quiet, labelcolor=palette.ink, labelsize=11)
    axes.grid(visible=False)
    axes.spines[:].set(visible=True, color=palette.quiet)


def tick(exponent: int) -> str:
    """A power of ten, short enough for the axis: 0.001, 1, 1 000, 1e4."""
    return number(10.0**exponent, 1) if -3 <= exponent <= 3 else f"1e{exponent}"


def _draw_bar(axes: Axes, inputs: MapPictureInput) -> None:
    """The colour bar with its numbers."""
    palette = inputs.palette
    axes.imshow(np.linspace(1.0, 0.0, 256)[None], shades(palette), aspect="auto", extent=(0.0, 1.0, 0.0, 1.0))
    axes.set_title("log-likelihood below the best", color=palette.ink, fontsize=12, fontweight="normal")
    words = {
        value: f"{value:.0e}".replace("e+0", "e") if value >= 1e4 else trimmed(value)
        for _, value in inputs.map.marks
    }
    ticks = {1.0 - shade: words[value] for shade, value in inputs.map.marks}
    step = math.ceil(len(ticks) / 9)
    axes.set_xticks(list(ticks)[::step], list(ticks.values())[::step])
    axes.set_yticks([])
    axes.tick_params(length=4, pad=3, color=palette.quiet, labelcolor=palette.ink, labelsize=11)
    axes.grid(visible=False)
    axes.spines[:].set(visible=True, color=palette.quiet)


def _write_legend(figure: Figure, handles: list[Line2D], inputs: MapPictureInput) -> None:
    """What the marks are, and below it what the map does not take into account."""
    from matplotlib.lines import Line2D

    frame, palette = inputs.frame, inputs.palette
    if inputs.map.fleet is not None and inputs.map.fleet.unit != inputs.unit:
        text = f"devices: q and r in {squared(inputs.map.fleet.unit)[:24]}"
        handles.append(Line2D([], [], linestyle="", label=text))
    if inputs.map.note:
        handles.append(Line2D([], [], linestyle="", label=fill(inputs.map.note, 50)))
    x, top, _, _ = frame.share(frame.bottom + 106, frame.bottom + 106)
    place: dict[str, Any] = {
        "loc": "upper left",
        "bbox_to_anchor": (x, top),
        "borderpad": 0.0,
        "borderaxespad": 0.0,
    }
    size = 12 if len(handles) < 9 else 10
    figure.legend(
        handles=handles, **place, fontsize=size, labelcolor=palette.ink, handlelength=1.6, labelspacing=0.5
    )


def draw_ring(*, dark: bool) -> NDArray[np.uint8]:
    """The mark of the present point, shape (64, 64, 4): a ring with a dot, with an edge of the other lightness."""
    palette = DARK if dark else LIGHT
    image = Image.new("RGBA", (64, 64), (0, 0, 0, 0))
    draw = ImageDraw.Draw(image)
    for width, colour in ((13, palette.paper), (7, palette.filtered)):
        inset = 6 + (13 - width) // 2
        draw.ellipse((inset, inset, 63 - inset, 63 - inset), outline=colour, width=width)
    draw.ellipse((27, 27, 36, 36), fill=palette.filtered, outline=palette.paper, width=2)
    return np.asarray(image)


# The tuning map between the panels: a flat picture, the mark of the present point, what the mouse does.
#
# Picture, mark and mouse are hidden widgets here; `map.js` shows them over viser's canvas.


NOWHERE = (-1.0, -1.0)
"""The position that hides the mark."""

SHOW, HIDE = "Map", "Hide map"


class TuningMapView:
    """Picture, mark and mouse."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.on_device: Callable[[Fleet, int], None] = lambda _fleet, _device: None
        """Called when a device of an open fleet is clicked."""
        self._lock = threading.Lock()
        self._map: TuningMap = nothing("")
        self._state: State | None = None
        self._drawn: MapPictureInput | None = None
        self._frame = MapFrame(self._map.q, self._map.r)

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
        """Open the device under a click, if there is one."""
        fleet = self._map.fleet
        device = None if fleet is None else fleet.nearest(self._frame, at)
        if fleet is not None and device is not None:
            self.on_device(fleet.fleet, device)
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
        self._frame = MapFrame(self._map.q, self._map.r, self._map.momentum)
        inputs = picture_input(state, self._map, self._frame)
        self._place(state)
        if inputs == self._drawn:
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
