"""What the charts share: points, colours, axes, units, and all that is passed to uPlot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import viser

from kalscope.common.numbers import Array
from kalscope.common.text import TIME_UNITS, number, trimmed
from kalscope_app.session.state import State
from kalscope_app.views.widgets import put
from kalscope_app.views.window import height_of

T = TypeVar("T")

# Units and factors of chart axes, so that three decimals suffice, and ticks of logarithmic ones.


PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
"""SI prefixes by power of ten."""


LOGARITHMIC = {"distr": 3, "log": 10}
"""A logarithmic uPlot scale."""

Ends = tuple[float, float]
"""Of an axis."""

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


def log_ticks(low: float, high: float, room: int = 9) -> tuple[float, ...]:
    """Round values from low to high, > 0, for a logarithmic axis: decades, with 2 and 5 between if few."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    step = max(1, math.ceil((last - first) / room))
    fine = (1.0, 2.0, 5.0) if last - first <= 3 else (1.0,)
    ticks = (mantissa * 10.0**power for power in range(first, last + 1, step) for mantissa in fine)
    return tuple(tick for tick in ticks if 0.999 * low <= tick <= 1.001 * high)


# Colours, lines and axes that the charts share.


class Palette:
    """The colours of one theme: charts, map and pictures. Good and bad of the map differ in lightness alone.

    Every line has a contrast of 3 : 1 with its background, as WCAG 2.2 requires of graphics (1.4.11).
    """

    def __init__(self, *, dark: bool) -> None:
        def pick(light: T, in_the_dark: T) -> T:
            return in_the_dark if dark else light

        self.raw = pick("#8595a3", "#6f7f8d")
        self.filtered = pick("#D55E00", "#ff8a3d")
        self.truth = pick("#0072B2", "#56B4E9")
        self.innovation = pick("#009E73", "#2fc99b")
        self.gain = pick("#CC79A7", "#e39ac6")
        self.smoothed = pick("#1b9e8a", "#3fd6bd")
        self.board = pick("#7b3fa0", "#c9a0ff")
        self.band = pick("24", "33")
        """Opacity of bands in the colour of their line, two hexadecimal digits."""
        self.paper = pick("#eceff2", "#1e2024")
        """Behind pictures."""
        self.ink = pick("#343a40", "#d5dae1")
        self.quiet = pick("#5c666f", "#9aa4af")
        self.shades = pick(
            ("#ffffff", "#d3e3f1", "#9cc4e2", "#5a9fd0", "#2672ad", "#0b4479"),
            ("#101317", "#152a40", "#1b4a74", "#2976b0", "#5fb4e6", "#dff3ff"),
        )
        """Of the map, from worst to best."""
        self.best = pick("#f7c948", "#c2410c")
        """The most likely pair and the 95 % region on the map."""
        self.devices = ("#ffffff", "#f0a6ca", pick("#c2185b", "#ff4f98"), "#9aa0a6")
        """A fleet's devices by class, from usual to remarkable, and those without any."""
        self.sensors = pick(
            ("#3f73d8", "#12525f", "#e0609a", "#3d3d3d", "#6a2fa0", "#2c9c6a", "#8a6fb8", "#8f8f93"),
            ("#6c9bff", "#a8e0e0", "#d0447f", "#8f9aa6", "#b58cff", "#4fb286", "#f2a6d8", "#5e7fa0"),
        )
        """Of fused sensors in their order: a deuteranope can tell the first ones and the fused line."""
        self.alternatives = pick(
            ("#009E73", "#0072B2", "#CC79A7", "#3a9bdc", "#7b4fc8", "#a0522d", "#1b9e8a"),
            ("#2fc99b", "#56B4E9", "#e39ac6", "#8fd0ff", "#b79bff", "#d9a066", "#3fd6bd"),
        )
        """Of the simpler filters in the order of their names."""


LIGHT, DARK = Palette(dark=False), Palette(dark=True)


def palette_of(state: State) -> Palette:
    """The colours of the theme on screen."""
    return DARK if state.view.dark else LIGHT


@dataclass(frozen=True)
class ChartLine:
    """One line of a chart."""

    y: Array
    """Values, unit."""
    style: dict[str, object]
    """uPlot series."""
    gaps: bool = False
    """Whether NaN in y are gaps; else what is before them is held."""
    fill: str = ""
    """Colour between this line and the one before it; "": none."""


def line(
    y: Array,
    label: str,
    colour: str = "transparent",
    width: float = 1,
    *,
    scaled: bool = True,
    gaps: bool = False,
    fill: str = "",
    **style: object,
) -> ChartLine:
    """A line without marks; without a colour it is the edge of a band; the range of y includes it if `scaled`."""
    plain = {"label": label, "stroke": colour, "width": width, "points": {"show": False}, "auto": scaled}
    return ChartLine(y, {**plain, **style}, gaps, fill)


def dots(y: Array, label: str, colour: str, size: float) -> ChartLine:
    """Dots without a line between them; the range of y need not include them."""
    return line(y, label, colour, 0, scaled=False, gaps=True, points=marks(colour, size))


def rings(y: Array, label: str, colour: str, size: float) -> ChartLine:
    """Thin rings around points of another line, which stay visible."""
    points = {**marks("transparent", size), "stroke": colour, "width": 1.5}
    return line(y, label, colour, 0, scaled=False, gaps=True, points=points)


def marks(colour: str, size: float) -> dict[str, object]:
    """Points on every value of a line."""
    return {"show": True, "size": size, "space": 0, "fill": colour}


def band(
    middle: Array | float, spread: Array, name: str, fill: str, *, scaled: bool = False
) -> tuple[ChartLine, ChartLine]:
    """All within `spread` of a line."""
    low = line(middle - spread, f"−{name}", scaled=scaled)
    return low, line(middle + spread, f"+{name}", scaled=scaled, fill=fill)


def gappy(label: str, y: Array, colour: str, quiet: int = 0) -> tuple[ChartLine, ...]:
    """A measured line. With missing samples (after the first `quiet`): points, and the last value for the range.

    uPlot draws a line across every gap, and takes no range from a line that begins with one.
    """
    if not np.isnan(y[quiet:]).any():
        return (line(y, label, colour),)
    return dots(y, label, colour, 3), line(y, f"last {label}")


def short(name: str, limit: int) -> str:
    """A name cut to a length that fits beside an axis."""
    return name if len(name) <= limit else f"{name[: limit - 1]}…"


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
        self.handle = gui.add_uplot(
            (np.array([0.0, 1.0]), zeros),
            ({"label": "x"}, {"label": "y"}),
            scales={"x": {"time": False}},
            padding=(10, 24, 0, 0),  # without it viser rebuilds the chart whenever its width changes
            height=height_of(share),
            cursor=self._cursor(),
        )
        """The viser handle, for tests and heights."""
        self._data: tuple[Array, ...] = ()
        self._scales: object = None

    def draw(
        self,
        x: Array,
        lines: Sequence[ChartLine],
        x_label: str,
        y_label: str,
        *,
        factor: float = 1.0,
        view: object = None,
        reach: Ends | None = None,
        y_range: Ends | None = None,
        log: str = "",
        space: int = 22,
        lanes: bool = False,
    ) -> None:
        """Draw; numbers, lines and axes are sent only when they differ.

        A new `view`, or another range, rebuilds the chart and so ends a zoom: with a fixed range for x viser keeps
        a zoom over new data, but not over a new scale.

        Args:
            x: abscissae, ascending.
            lines: what to draw; the lowest comes first.
            x_label: name of x, which the legend has, too.
            y_label: name of y.
            factor: what the values of lines and `y_range` are multiplied by.
            view: see above.
            reach: range of x; None = that of `x`.
            y_range: range of y; None = what the lines need.
            log: the logarithmic axes, "x" or "xy": all is > 0 there.
            space: ticks of y are this many px apart at least.
            lanes: whether y counts lanes, downward.
        """
        data = drawable(
            x, [one.y * factor for one in lines], frozenset(i for i, one in enumerate(lines) if one.gaps)
        )
        reach = reach or (float(data[0][0]), float(data[0][-1]))
        across, up = axis(34, log_ticks(*reach) if "x" in log else None), axis(60)
        scales: dict[str, Any] = {"x": {"time": False, "range": reach, **(LOGARITHMIC if "x" in log else {})}}
        if y_range is not None:
            ends = y_range[0] * factor, y_range[1] * factor
            up = axis(60, log_ticks(*ends) if "y" in log else None)
            scales["y"] = {"range": ends, **(LOGARITHMIC if "y" in log else {}), **({"dir": -1} if lanes else {})}
        up |= {"label": y_label, **({"incrs": (1,), "space": 8} if lanes else {"space": space})}
        across |= {"label": x_label} if lanes else {}  # elsewhere in the legend alone, which saves a line
        if (view, scales) != self._scales:
            self._scales, self.handle.scales = (view, scales), scales
        series = ({"label": x_label}, *(one.style for one in lines))
        bands = tuple({"series": (i, i - 1), "fill": one.fill} for i, one in enumerate(lines, 1) if one.fill)
        put(self.handle, series=series, bands=bands, axes=(across, up))
        same = (np.array_equal(*pair, equal_nan=True) for pair in zip(data, self._data, strict=False))
        if len(data) != len(self._data) or not all(same):
            self.handle.data = self._data = data
        put(self.handle, visible=True)

    def _cursor(self) -> Any:
        """How the mouse works; `share` and `window` are keys of the page script, not of uPlot."""
        cursor: dict[str, Any] = {"drag": {"x": True, "y": False}, "share": self._share, "window": self._window}
        return cursor if self._sync is None else {**cursor, "sync": {"key": self._sync}}

    def set_height(self, share: float, pixels: int) -> None:
        """Set the share of the height, which rebuilds the chart, and its height in a window of usual size, px."""
        put(self.handle, height=pixels)
        if share != self._share:
            self._share = share
            self.handle.cursor = self._cursor()

    def hide(self) -> None:
        """Take the chart off the screen: without an answer, an old curve would be mistaken for one."""
        put(self.handle, visible=False)


def axis(size: int, ticks: tuple[float, ...] | None = None) -> dict[str, object]:
    """A uPlot axis in small type; `ticks` are written out: uPlot itself writes 0 for any value below 0.0005."""
    font = "12px sans-serif"
    fixed = {} if ticks is None else {"splits": ticks, "values": tuple(number(tick, 1) for tick in ticks)}
    return {"font": font, "labelFont": font, "labelSize": 20, "labelGap": 2, "gap": 3, "size": size, **fixed}


# The time axis that the charts share: its unit, its name, and a window that follows a live board.


@dataclass(frozen=True)
class TimeAxis:
    """The abscissa of a frame."""

    x: Array
    """Times of the samples, in its unit, shape (m,)."""
    scale: Scale
    """Its unit, by the length of what is shown."""
    label: str
    """Its name, with the unit."""
    first: float
    """Its left end, s after `origin`."""
    last: float
    """Its right end."""
    origin: float = 0.0
    """The time that is 0 on it, s: of a window that follows a live board, its newest sample."""

    @property
    def reach(self) -> Ends:
        """Both ends in its unit."""
        return self.first * self.scale.factor, self.last * self.scale.factor


def time_axis(time: Array, state: State) -> TimeAxis:
    """The time axis of samples drawn at these times, s, which the charts share.

    A window that follows counts back from the newest sample, so that neither its axis nor a zoom moves.
    """
    live, recording, origin = state.live, state.recording, 0.0
    first, last = (float(time[0]), float(time[-1])) if len(time) else (0.0, 1.0)
    last = last if len(time) > 1 else first + 1.0
    follows = live is not None and live.following and live.snapshot is not None
    if live is not None and follows:
        origin = float(recording.time[-1])
        first, last = -(live.span if math.isfinite(live.span) else rounded_up(last - first)), 0.0
    scale = time_scale_for(last - first, recording.sample_period)
    label = "sample" if scale.unit == "samples" else scale.label("time before now" if follows else "time")
    return TimeAxis((time - origin) * scale.factor, scale, label, first, last, origin)


def rounded_up(value: float) -> float:
    """The next of 1, 2, 5 × 10^k, so that a growing axis changes only now and then."""
    decade = 10.0 ** math.floor(math.log10(max(value, 1e-3)))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= value)
