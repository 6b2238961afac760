"""What the charts share: points, colours, axes, units, and all that is passed to uPlot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from kalscope.common.numbers import Array
from kalscope.common.text import TIME_UNITS, trimmed
from kalscope_app.engine.filter_runs import Cache, DrawnSamples, choose_indices
from kalscope_app.engine.frame import Frame
from kalscope_app.views.widgets import put
from kalscope_app.views.window import height_of

# Units and factors of chart axes, so that three decimals suffice, and ticks of logarithmic ones.


PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
"""SI prefixes by power of ten."""


PREFIXABLE = {"V", "A", "g", "Pa", "Hz", "m", "W", "N", "T", "Ω", "F", "s", "lx", "m/s", "m/s²", "m/s^2"}
"""Units that take a prefix; before any other the factor is written out."""


@dataclass(frozen=True)
class Scale:
    """How numbers of one quantity are written on an axis."""

    factor: float
    """Drawn value = value × factor."""
    unit: str
    """Unit of the drawn value, "" if none."""

    def label(self, quantity: str) -> str:
        """Axis label, such as "ax (mV)"."""
        return f"{quantity} ({self.unit})" if self.unit else quantity


def scale_for(values: Array, unit: str) -> Scale:
    """A factor that brings the largest of `values` between 1 and 10,000, where three decimals suffice.

    Units without a prefix get a power of ten only where decimals do not suffice: 0.3 is easier to read.
    """
    finite = np.abs(values[np.isfinite(values)])
    largest = float(finite.max(initial=0.0))
    if largest == 0.0 or (0.5 if unit in PREFIXABLE else 0.05) <= largest < 1e5:
        return Scale(1.0, unit)
    power = 3 * math.floor(math.log10(largest) / 3)
    power = min(max(power, -300), 300)
    if unit in PREFIXABLE and power in PREFIXES:
        return Scale(10.0**-power, PREFIXES[power] + unit)
    return Scale(10.0**-power, f"1e{power} {unit}".strip())


def time_scale_for(span: float, sample_period: float | None) -> Scale:
    """Unit of a time axis that shows `span` s: the largest that fits four times; ms where s needs four decimals."""
    if sample_period is None:
        return Scale(1.0, "samples")
    for unit, length in reversed(TIME_UNITS):
        if span >= (0.04 if unit == "s" else 4.0 * length):
            return Scale(1.0 / length, unit)
    return Scale(1000.0, "ms")


def range_text(first: float, last: float) -> str:
    """Both ends to about a hundredth of what lies between them: "0 to 4.55" also where the first is -0.000446."""
    span = abs(last - first)
    decimals = 2 - math.floor(math.log10(span)) if math.isfinite(span) and span > 0.0 else 3
    return f"{_to_decimals(first, decimals)} to {_to_decimals(last, decimals)}"


def _to_decimals(value: float, decimals: int) -> str:
    if abs(value) < 0.5 * 10.0**-decimals:
        return "0"
    return trimmed(value, min(max(math.floor(math.log10(abs(value))) + 1 + decimals, 1), 12))


def log_scale_for(values: Array, unit: str) -> Scale:
    """The prefix that suits the middle of a logarithmic axis from the lowest to the highest value > 0.

    A unit that takes no prefix stays as it is: the ticks of such an axis are written as 1e-9 where they must be.
    """
    good = values[np.isfinite(values) & (values > 0.0)]
    if unit not in PREFIXABLE or not len(good):
        return Scale(1.0, unit)
    middle = 0.5 * (math.log10(float(good.min())) + math.log10(float(good.max())))
    power = min(max(3 * math.floor((middle + 1.0) / 3.0), min(PREFIXES)), max(PREFIXES))
    return Scale(10.0**-power, PREFIXES[power] + unit)


def log_time_scale(times: Array) -> Scale:
    """Unit of a logarithmic axis of ascending times > 0, s: seconds up to ten minutes, else as fits the middle."""
    if not len(times) or times[-1] < 600.0:
        return log_scale_for(times, "s")
    middle = math.sqrt(float(times[0]) * float(times[-1]))
    unit, length = next((one for one in reversed(TIME_UNITS) if one[1] <= middle), TIME_UNITS[0])
    return Scale(1.0 / length, unit)


def log_ticks(low: float, high: float, room: int = 9) -> tuple[float, ...]:
    """Round values from low to high, > 0, for a logarithmic axis: decades, with 2 and 5 between if few."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    step = max(1, math.ceil((last - first) / room))
    fine = (1.0, 2.0, 5.0) if last - first <= 3 else (1.0,)
    ticks = (mantissa * 10.0**power for power in range(first, last + 1, step) for mantissa in fine)
    return tuple(tick for tick in ticks if 0.999 * low <= tick <= 1.001 * high)


# Colours, lines and axes that the charts share.


@dataclass(frozen=True)
class Palette:
    """The colours of one theme: charts, map and pictures. Good and bad of the map differ in lightness alone.

    Every line has a contrast of 3 : 1 with its background, as WCAG 2.2 requires of graphics (1.4.11).
    """

    raw: str
    filtered: str
    truth: str
    innovation: str
    gain: str
    smoothed: str
    board: str
    raw_band: str
    band: str
    innovation_band: str
    velocity_band: str
    paper: str
    """Behind pictures."""
    ink: str
    quiet: str
    shades: tuple[str, ...]
    """Of the map, from worst to best."""
    best: str
    """The most likely pair and the 95 % region on the map."""
    devices: tuple[str, str, str, str]
    """A fleet's devices by class, from usual to remarkable, and those without any."""
    density: str
    """Where many devices are."""


LIGHT = Palette(
    raw="#8595a3",
    filtered="#D55E00",
    truth="#0072B2",
    innovation="#009E73",
    gain="#CC79A7",
    smoothed="#1b9e8a",
    board="#7b3fa0",
    raw_band="rgba(133, 149, 163, 0.34)",
    band="rgba(213, 94, 0, 0.14)",
    innovation_band="rgba(0, 158, 115, 0.14)",
    velocity_band="rgba(204, 121, 167, 0.16)",
    paper="#eceff2",
    ink="#343a40",
    quiet="#5c666f",
    shades=("#ffffff", "#d3e3f1", "#9cc4e2", "#5a9fd0", "#2672ad", "#0b4479"),
    best="#f7c948",
    devices=("#ffffff", "#f0a6ca", "#c2185b", "#9aa0a6"),
    density="#6a1b9a",
)
DARK = Palette(
    raw="#6f7f8d",
    filtered="#ff8a3d",
    truth="#56B4E9",
    innovation="#2fc99b",
    gain="#e39ac6",
    smoothed="#3fd6bd",
    board="#c9a0ff",
    raw_band="rgba(111, 127, 141, 0.34)",
    band="rgba(255, 138, 61, 0.20)",
    innovation_band="rgba(47, 201, 155, 0.18)",
    velocity_band="rgba(227, 154, 198, 0.20)",
    paper="#1e2024",
    ink="#d5dae1",
    quiet="#9aa4af",
    shades=("#101317", "#152a40", "#1b4a74", "#2976b0", "#5fb4e6", "#dff3ff"),
    best="#c2410c",
    devices=("#ffffff", "#f0a6ca", "#ff4f98", "#9aa0a6"),
    density="#d0a2ee",
)


SENSORS = {
    False: ("#3f73d8", "#12525f", "#e0609a", "#3d3d3d", "#6a2fa0", "#2c9c6a", "#8a6fb8", "#8f8f93"),
    True: ("#6c9bff", "#a8e0e0", "#d0447f", "#8f9aa6", "#b58cff", "#4fb286", "#f2a6d8", "#5e7fa0"),
}
"""Of fused sensors in their order, light and dark: a deuteranope can tell the first ones and the fused line."""


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


def lag_line(frame: Frame, palette: Palette) -> ChartLine:
    """A level line as long as the lag, up to the filtered signal at its steepest rise; NaN where it is tiny."""
    time, x = frame.drawn.time, frame.filtered
    lag = float(frame.steady.lag_samples) * (frame.state.recording.sample_period or 1.0)
    y = np.full(len(x), np.nan)
    if len(x) > 1 and 0.005 * (time[-1] - time[0]) < lag < 0.5 * (time[-1] - time[0]):
        begin = np.searchsorted(time, time - lag)
        rise = np.nan_to_num(np.where(time - lag < time[0], np.nan, x - x[begin]), nan=-math.inf)
        end = int(np.argmax(rise))
        y[begin[end] : end + 1] = x[end]
    return ChartLine(y, line("lag", palette.ink, 3, scaled=False), gaps=True)


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


# All that is passed to uPlot: which points, in which order, in which unit, and what it must never get.
#
# viser's uPlot goes blank on a leading NaN, on inf and on empty arrays, draws a bridge over NaN, and prints ticks
# with three decimals at most. So everything drawn passes through here.


def drawable(x: Array, ys: list[Array], gaps: frozenset[int] = frozenset()) -> tuple[Array, ...]:
    """X ascending and every y finite, never empty: what uPlot can draw.

    The lines whose numbers are in `gaps` keep their NaN: they are drawn as points and do not affect the range.

    A value that is not finite takes the nearest finite one before it, or the first after it; a line without any
    becomes 0. A single point becomes two, because a line needs them.
    """
    if len(x) == 0:
        return (np.array([0.0, 1.0]), *(np.zeros(2) for _ in ys))
    if len(x) == 1:
        x, ys = np.array([x[0], x[0] + 1.0]), [np.repeat(y, 2) for y in ys]
    return (
        np.ascontiguousarray(x, dtype=np.float64),
        *(np.where(np.isfinite(y), y, np.nan) if i in gaps else _finite(y) for i, y in enumerate(ys)),
    )


def _finite(y: Array) -> Array:
    good = np.isfinite(y)
    if good.all():
        return np.ascontiguousarray(y, dtype=np.float64)
    if not good.any():
        return np.zeros(len(y))
    first = int(np.argmax(good))
    held = np.maximum.accumulate(np.where(good, np.arange(len(y)), first))
    return y[held]


class Chart:
    """One uPlot chart that keeps its zoom while data change, and is rebuilt only when its lines do."""

    def __init__(self, gui: viser.GuiApi, share: float, *, sync: str | None = None, window: bool = False) -> None:
        """Make a chart.

        Args:
            gui: where it is added.
            share: of the window's height for charts.
            sync: the name under which charts share their zoom.
            window: whether a zoom chooses the window of the recording.
        """
        zeros = np.zeros(2)
        self._share, self._sync, self._window = share, sync, window
        self._handle = gui.add_uplot(
            (np.array([0.0, 1.0]), zeros),
            ({"label": "x"}, {"label": "y"}),
            scales={"x": {"time": False}},
            padding=(10, 24, 0, 0),  # without it viser rebuilds the chart whenever its width changes
            height=height_of(share),
            cursor=self._cursor(),
        )
        self._data: tuple[Array, ...] = ()
        self._layout: object = None
        self._view: object = None

    @property
    def handle(self) -> viser.GuiUplotHandle:
        """The viser handle, for tests and heights."""
        return self._handle

    def show(
        self,
        x: Array,
        ys: list[Array],
        layout: ChartLayout,
        view: object = None,
        reach: tuple[float, float] | None = None,
    ) -> None:
        """Draw; numbers and `layout` are sent only when they differ.

        `reach` is the range of the x axis, if not that of x. A new `view`, or another reach, rebuilds the chart and
        so ends a zoom: with a fixed range for x viser keeps a zoom over new data, but not over a new scale.
        """
        data = drawable(x, ys, layout.gaps)
        reach = reach or (float(data[0][0]), float(data[0][-1]))
        if (view, reach, layout.y_range) != self._view:
            self._view = (view, reach, layout.y_range)
            scales: dict[str, Any] = {"x": {"time": False, "range": reach, **_distribution(layout.log_x)}}
            if layout.y_range is not None:
                flip = {"dir": -1} if layout.y_down else {}
                scales["y"] = {"range": layout.y_range, **flip, **_distribution(layout.log_y)}
            self._handle.scales = scales
        if layout != self._layout:
            self._layout = layout
            self._handle.series = layout.series
            self._handle.bands = layout.bands
            self._handle.axes = layout.axes
        if not same_numbers(data, self._data):
            self._handle.data = self._data = data
        put(self._handle, visible=True)

    def draw(
        self,
        x: Array,
        x_label: str,
        lines: Sequence[ChartLine],
        y_axes: Sequence[dict[str, object]],
        view: object,
        reach: tuple[float, float] | None = None,
        *,
        factor: float = 1.0,
        **layout: Any,
    ) -> None:
        """Draw lines whose values are times `factor`; the rest are fields of `ChartLayout`, see `show`."""
        series = ({"label": x_label}, *(one.style for one in lines))
        gaps = frozenset(i for i, one in enumerate(lines) if one.gaps)
        self.show(
            x,
            [one.y * factor for one in lines],
            ChartLayout(series, tuple(y_axes), gaps=gaps, **layout),
            view,
            reach,
        )

    def _cursor(self) -> Any:
        """How the mouse works; `share` and `window` are keys of the page script, not of uPlot."""
        cursor: dict[str, Any] = {"drag": {"x": True, "y": False}, "share": self._share, "window": self._window}
        return cursor if self._sync is None else {**cursor, "sync": {"key": self._sync}}

    def set_height(self, share: float, pixels: int) -> None:
        """Set the share of the height, which rebuilds the chart, and its height in a window of usual size, px."""
        put(self._handle, height=pixels)
        if share != self._share:
            self._share = share
            self._handle.cursor = self._cursor()

    def hide(self) -> None:
        """Take the chart off the screen: without an answer, an old curve would be mistaken for one."""
        put(self._handle, visible=False)


def same_numbers(one: tuple[Array, ...], other: tuple[Array, ...]) -> bool:
    """Whether two tuples hold equal arrays."""
    return len(one) == len(other) and all(
        np.array_equal(a, b, equal_nan=True) for a, b in zip(one, other, strict=True)
    )


def _distribution(log: bool) -> dict[str, int]:
    return {"distr": 3, "log": 10} if log else {}


@dataclass(frozen=True)
class ChartLayout:
    """Everything of a chart but its numbers: compared by value, so it must hold only tuples and dicts."""

    series: tuple[Any, ...]
    """uPlot series, the x axis first."""
    axes: tuple[Any, ...]
    """uPlot axes: x, then y."""
    bands: tuple[Any, ...] | None = None
    """Filled bands between pairs of series."""
    gaps: frozenset[int] = frozenset()
    """Numbers of the lines, from 0, that are drawn as points and keep their gaps."""
    y_range: tuple[float, float] | None = None
    """Fixed range of y; None = what the lines need."""
    y_down: bool = False
    """Whether a fixed y grows downward."""
    log_x: bool = False
    """Whether the x axis is logarithmic; all x > 0 then."""
    log_y: bool = False
    """Whether the y axis is logarithmic; needs y_range, both ends > 0."""


# The time axis that the charts share: its unit, its name, and a window that follows a live board.


def time_axis(frame: Frame) -> Scale:
    """Unit of the shared time axis, by the length of what is shown."""
    time, reach = time_points(frame)
    first, last = reach or (float(time[0]), float(time[-1]))
    span = last - first if len(time) > 1 else 1.0
    return time_scale_for(span, frame.state.recording.sample_period)


def follows(frame: Frame) -> bool:
    """Whether the window follows a live board's newest sample."""
    live = frame.state.live
    return live is not None and live.following and live.snapshot is not None


def time_points(frame: Frame) -> tuple[Array, tuple[float, float] | None]:
    """Times of the samples on the time axis, s, and the range of the axis if that is not theirs.

    A window that follows counts back from the newest sample, so that neither its axis nor a zoom moves.
    """
    time, live = frame.drawn.time, frame.state.live
    if live is None or not follows(frame):
        return time, None
    newest = float(frame.state.recording.time[-1])
    span = live.span if math.isfinite(live.span) else rounded_up(float(time[-1] - time[0]))
    return time - newest, (-span, 0.0)


def rounded_up(value: float) -> float:
    """The next of 1, 2, 5 × 10^k, so that a growing axis changes only now and then."""
    decade = 10.0 ** math.floor(math.log10(max(value, 1e-3)))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= value)


def time_label(clock: Scale, *, before_now: bool = False) -> str:
    """Name of the time axis, with its unit."""
    if clock.unit == "samples":
        return "sample"
    return f"time before now ({clock.unit})" if before_now else f"time ({clock.unit})"


# Fewer points for a chart that is drawn at every step of a control that moves.
#
# They are some of those that are drawn once it has stopped, the first and the last among them: neither the axes nor
# the raw signal move when the others follow.


MAX_MOVING_POINTS = 2000
"""Points of a line while a control moves, at most: about two to each pixel of a wide chart."""


class Thinning:
    """Chooses the points once for each view of the recording."""

    def __init__(self) -> None:
        self._places = Cache[NDArray[np.intp]]()

    def of(self, frame: Frame) -> NDArray[np.intp] | None:
        """Indices of the points to draw among those of the frame; None: all, where single samples are visible."""
        drawn = frame.drawn
        if drawn.band is None or frame.set_aside is not None or len(drawn.indices) <= MAX_MOVING_POINTS:
            return None
        return self._places.once(lambda: places_to_keep(drawn), drawn)


def places_to_keep(drawn: DrawnSamples) -> NDArray[np.intp]:
    """Ascending: the first, last, highest and lowest, and those that keep the shape of raw signal and truth."""
    chosen = choose_indices(drawn.raw, drawn.truth, MAX_MOVING_POINTS - 2)
    return np.union1d(chosen, (drawn.raw.argmin(), drawn.raw.argmax())).astype(np.intp)
