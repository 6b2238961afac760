"""The tuning map between the panels: its colours, its picture, and the position of the present setting."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
import viser
from numpy.typing import NDArray

from kalscope.common.charts import drawing
from kalscope.common.text import DURATIONS, duration, number, squared, trimmed
from kalscope_app.engine.filter_runs import Cache
from kalscope_app.engine.frame import Frame
from kalscope_app.engine.jobs import Jobs
from kalscope_app.program.user_settings import UserSettings
from kalscope_app.session.changes import momentum_words, set_map_shown, set_point
from kalscope_app.session.session import Session
from kalscope_app.session.state import State
from kalscope_app.studies import tuning_map
from kalscope_app.studies.tuning_map import FleetLayer, MapFrame, Point, TuningMap, exponents_of
from kalscope_app.views.charts import Palette, palette_of
from kalscope_app.views.phone import page_figure, pixels_of
from kalscope_app.views.widgets import add_button, on_user, put
from kalscope_app.views.window import MAP_PICTURE, MAP_POINTED, MAP_PRESENT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure
    from matplotlib.patheffects import AbstractPathEffect

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

MAX_EDGED = 1000
"""Devices of a fleet up to which each is drawn large and with an edge."""

FIRST_PAPER = 0.01
"""q/r of the first source document, r/q = 100."""


def draw_map_picture(state: State, shown: TuningMap) -> NDArray[np.uint8]:
    """The whole picture, shape (SHARPNESS · height, SHARPNESS · width, 3)."""
    frame, palette = shown.frame, palette_of(state)
    with drawing():
        figure = page_figure(frame.width, frame.height, palette.paper, SHARPNESS)
        if not shown.marks:
            figure.text(0.06, 0.7, fill(shown.note, 44), color=palette.quiet, fontsize=14)
            return pixels_of(figure)
        axes = _axes(figure, frame, (frame.top, frame.bottom), palette)
        axes.set(xlim=frame.q, ylim=frame.r, autoscale_on=False)
        image: dict[str, Any] = {"extent": (*frame.q, *frame.r), "origin": "lower", "aspect": "auto"}
        axes.imshow(shown.shade, shades(palette), vmin=0.0, vmax=1.0, interpolation="bilinear", **image)
        _write_axes(axes, frame, state, palette)
        label = "current q and r: drag it, or click"
        axes.plot([], [], "o", color=palette.filtered, ms=12, mew=3, mfc="none", label=label)
        _draw_lags(axes, frame, state.recording.sample_period, palette)
        _draw_marks(axes, shown, palette)
        for variant in state.variants:
            at = frame.held(exponents_of(variant.tuning.q, variant.tuning.r))
            _draw_pin(axes, at, variant.name, variant.css(dark=state.view.dark), palette)
        _write_legend(figure, axes, shown, state.tuning.unit, palette)
        _draw_bar(_axes(figure, frame, (frame.bottom + 72, frame.bottom + 82), palette), shown, palette)
        return pixels_of(figure)


def _axes(figure: Figure, frame: MapFrame, ends: tuple[float, float], palette: Palette) -> Axes:
    """A strip as wide as the map, from its top to its bottom, pixels."""
    left, (top, bottom) = frame.left / frame.width, ends
    width, height = frame.right / frame.width - left, (bottom - top) / frame.height
    axes = figure.add_axes((left, 1.0 - bottom / frame.height, width, height))
    axes.tick_params(length=4, pad=4, color=palette.quiet, labelcolor=palette.ink, labelsize=11)
    axes.grid(visible=False)
    axes.spines[:].set(visible=True, color=palette.quiet)
    return axes


def shades(palette: Palette) -> Colormap:
    """The colours of the map in steps, from worst to best."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("map", palette.shades, LEVELS)


def _halo(width: float, colour: str, alpha: float = 1.0) -> list[AbstractPathEffect]:
    """An edge around a line or a letter."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=width, foreground=colour, alpha=alpha)]


def _draw_lags(axes: Axes, frame: MapFrame, period: float | None, palette: Palette) -> None:
    """Lines of equal lag with the lag where each leaves the map, at the top or the right edge; the first paper."""
    free = -math.inf
    for lag, (q, r) in sorted(tuning_map.lag_lines(frame, lag_unit(period)[1]), key=lambda one: one[1]):
        text, (x, y) = lag_words(lag, period), frame.pixel((q, r))
        axes.axline((q, r), slope=1.0, color=palette.ink, linewidth=1, alpha=0.4)
        half = 3.4 * len(text)
        style: dict[str, Any] = {"textcoords": "offset points", "color": palette.ink, "fontsize": 11}
        if y > frame.top + 8.0:
            axes.annotate(text, (q, r), (5, 0), va="center", **style)
        elif y <= frame.top + 1.0 and x - half > free:
            axes.annotate(text, (q, r), (0, 5), ha="center", **style)
            free = x + half + 6.0
    style = {"color": palette.ink, "linestyle": "--", "path_effects": _halo(4, palette.paper, 0.5)}
    axes.axline((0.0, -math.log10(FIRST_PAPER)), slope=1.0, **style, label="r/q = 100 (Ma'arif 2019)")


def lag_unit(period: float | None) -> tuple[str, float]:
    """The unit of lags, and the length of a sample in it: s, for slow recordings min to years."""
    if period is None:
        return "samples", 1.0
    name, length = next((u for u in reversed(DURATIONS) if u[1] >= 1.0 and period >= u[1]), ("s", 1.0))
    return name, period / length


def lag_words(lag: float, period: float | None) -> str:
    """A lag, in samples, as a length of time in one unit for the whole map, or in samples without a time."""
    name, sample = lag_unit(period)
    value = lag * sample
    if name == "s" and value < 1.0:
        return duration(value)
    return trimmed(value) if name == "samples" else f"{trimmed(value)} {name}"


def _draw_marks(axes: Axes, shown: TuningMap, palette: Palette) -> None:
    """The region, devices, and the best pair."""
    halo = _halo(4.5, palette.paper)
    if shown.contour is not None:
        label = "95 % region: less than 3.00 below the best"
        axes.plot(*shown.contour.T, color=palette.best, linewidth=2, path_effects=halo, label=label)
    if shown.fleet is not None:
        _draw_devices(axes, shown.fleet, shown.frame, palette)
    if shown.optimum is not None:
        off = " (off the map)" if math.inf in map(abs, shown.optimum) else ""
        at, label = shown.frame.held(shown.optimum), f"most likely q and r{off}"
        axes.plot(*at, "+", color=palette.best, ms=14, mew=2.5, path_effects=halo, label=label)


def _draw_pin(axes: Axes, at: Point, name: str, colour: str, palette: Palette) -> None:
    """A pinned setting with its name."""
    axes.plot(*at, "o", color=colour, ms=16, mec=palette.paper, label=f"pinned setting {name}")
    middle: dict[str, Any] = {"ha": "center", "va": "center_baseline", "fontsize": 11, "color": "white"}
    axes.text(*at, name, path_effects=_halo(2, "black"), **middle)


def _draw_devices(axes: Axes, layer: FleetLayer, frame: MapFrame, palette: Palette) -> None:
    """The devices by class, the filter for all, and the q/r that the fleet allows."""
    for ratio in layer.ratio_ends or ():
        axes.axline((0.0, -ratio), slope=1.0, color=palette.devices[2], linewidth=1.5)
    few = len(layer.devices) <= MAX_EDGED
    style: dict[str, Any] = {"markersize": 6 if few else 3, "markeredgecolor": palette.ink if few else "none"}
    for kind, words in enumerate(layer.words):
        points, colour = layer.points[layer.classes == kind], palette.devices[kind]
        style["alpha"], style["color"] = (1.0, colour) if few or kind else (0.3, palette.ink)
        if words:
            axes.plot(*points.T, "o", **style, label=f"device, {words}")
    if layer.shared is not None:
        at, label = frame.held(layer.shared), "one filter for all; lines: best q/r, 95 %"
        axes.plot(*at, "D", color=palette.devices[2], ms=11, mew=2, mfc="none", label=label)


def _write_axes(axes: Axes, frame: MapFrame, state: State, palette: Palette) -> None:
    """The decades of q and r, their names, and above the lags for which momentum the map holds."""
    unit = squared(state.tuning.unit)
    for axis, ends, name in (axes.xaxis, frame.q, "process noise q"), (axes.yaxis, frame.r, "measurement noise r"):
        ticks = tuning_map.decades(*ends)
        axis.set_ticks(ticks, [tick(e) for e in ticks])
        axis.set_label_text(f"{name}, {unit}", color=palette.ink, fontsize=13)
    momentum = momentum_words(frame.momentum, state.recording.sample_period)
    title = f"at momentum {momentum}: lag" if frame.momentum > 0.0 else "lag"
    axes.set_title(title, loc="center", color=palette.quiet, fontsize=12, fontweight="normal", pad=24)


def tick(exponent: int) -> str:
    """A power of ten, short enough for the axis: 0.001, 1, 1 000, 1e4."""
    return number(10.0**exponent, 1) if -3 <= exponent <= 3 else f"1e{exponent}"


def _draw_bar(axes: Axes, shown: TuningMap, palette: Palette) -> None:
    """The colour bar with its numbers."""
    axes.imshow(np.linspace(1.0, 0.0, 256)[None], shades(palette), aspect="auto", extent=(0.0, 1.0, 0.0, 1.0))
    axes.set_title("log-likelihood below the best", color=palette.ink, fontsize=12, fontweight="normal")
    marks = shown.marks[:: math.ceil(len(shown.marks) / 9)]
    words = [f"{drop:.0e}".replace("e+0", "e") if drop >= 1e4 else trimmed(drop) for _, drop in marks]
    axes.set_xticks([1.0 - shade for shade, _ in marks], words)
    axes.set_yticks([])


def _write_legend(figure: Figure, axes: Axes, shown: TuningMap, unit: str, palette: Palette) -> None:
    """What the marks are, and below it what the map does not take into account."""
    frame, fleet = shown.frame, shown.fleet
    if fleet is not None and fleet.fleet.devices.unit != unit:
        axes.plot([], [], " ", label=f"devices: q and r in {squared(fleet.fleet.devices.unit)[:24]}")
    if shown.note:
        axes.plot([], [], " ", label=fill(shown.note, 50))
    handles, labels = axes.get_legend_handles_labels()
    place = frame.left / frame.width, 1.0 - (frame.bottom + 106) / frame.height
    style: dict[str, Any] = {"bbox_to_anchor": place, "borderpad": 0.0, "borderaxespad": 0.0, "handlelength": 1.6}
    style |= {"fontsize": 12 if len(handles) < 9 else 10, "labelcolor": palette.ink, "labelspacing": 0.5}
    figure.legend(handles, labels, loc="upper left", **style)


# The tuning map between the panels: a flat picture, the mark of the present point, what the mouse does.
#
# Picture, position of the mark and mouse are hidden widgets here; `map.js` shows them over viser's canvas.


NOWHERE = (-1.0, -1.0)
"""The position that hides the mark."""

SHOW, HIDE = "Map", "Hide map"


class TuningMapView:
    """Picture, mark and mouse."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self.on_device: Callable[[Fleet, int], None] = lambda _fleet, _device: None
        """Called when a device of an open fleet is clicked."""
        self._map = tuning_map.nothing("")
        self._state: State | None = None
        self._pictures = Cache[NDArray[np.uint8]]()
        self._drawn: NDArray[np.uint8] | None = None

    def build_button(self, gui: viser.GuiApi, settings: UserSettings, jobs: Jobs) -> None:
        """The button of the header; what it does is remembered for the next start."""

        def toggle(_client: viser.ClientHandle) -> None:
            shown = self._shown.label == SHOW
            self._session.request(set_map_shown(shown))
            jobs.run(partial(settings.keep, map_shown=shown))

        self._shown = add_button(gui, SHOW, "The map of q and r beside the charts: click or drag in it.", toggle)

    def build_controls(self, gui: viser.GuiApi) -> None:
        """The widgets that the page shows as the map."""
        dot = np.zeros((2, 2, 3), dtype=np.uint8)
        self._picture = gui.add_image(dot, label=MAP_PICTURE, format="jpeg", jpeg_quality=90, visible=False)
        self._present = gui.add_vector2(MAP_PRESENT, NOWHERE, visible=False, hint="Hidden.")
        self._pointed = gui.add_vector3(MAP_POINTED, (0.0, 0.0, 0.0), visible=False, hint="Hidden.")
        on_user(self._pointed.on_update, lambda _client: self._on_pointed())

    # What the user does.

    def _on_pointed(self) -> None:
        """File the pair under a drag or a click, or open the device under a click if there is one."""
        across, down, gesture = self._pointed.value
        frame, state = self._map.frame, self._state
        if state is None or not self._map.marks:
            return
        x, y = across * frame.width, down * frame.height
        fleet = self._map.fleet
        device = fleet.nearest(frame, (x, y)) if fleet is not None and gesture < 0.0 else None
        if fleet is not None and device is not None:
            self.on_device(fleet.fleet, device)
        elif gesture > 0.0 or frame.inside((x, y)):
            point = frame.held(frame.point((x, y)))
            self._session.request(set_point(*point), key=f"held:map {gesture:.0f}")

    # What the user sees.

    def follow(self, frame: Frame) -> None:
        """Move the mark of an open map."""
        self._state = frame.state
        shown = frame.state.view.map_shown
        put(self._shown, label=HIDE if shown else SHOW)
        if shown:
            self._place(frame.state)

    def _place(self, state: State) -> None:
        """Put the mark on the pair, in shares of the picture; on the edge of the map if the pair is outside."""
        frame, at = self._map.frame, NOWHERE
        if self._map.marks and state.has_one_speed:
            x, y = frame.pixel(frame.held(exponents_of(state.tuning.q, state.tuning.r)))
            at = x / frame.width, y / frame.height
        put(self._present, value=at)

    def on_emptied(self) -> None:
        """A click means nothing without a picture."""
        self._map = tuning_map.nothing("")
        put(self._present, value=NOWHERE)

    def show(self, answer: tuple[State, TuningMap] | None) -> None:
        """Draw the map of a state whose values have stopped changing; None: it is closed."""
        if answer is None:
            return
        state, shown = self._state, self._map = answer
        self._place(state)
        period, dark = state.recording.sample_period, state.view.dark
        what = shown, state.tuning.unit, period, dark, state.variants
        picture = self._pictures.once(lambda: draw_map_picture(state, shown), *what)
        if picture is not self._drawn:
            self._drawn = self._picture.image = picture
