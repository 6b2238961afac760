"""The one door to uPlot: which points, in which order, in which unit, and what it must never be given.

viser's uPlot goes blank on a leading NaN, on inf and on empty arrays, draws a bridge over NaN, and prints ticks
with three decimals at most. So everything drawn passes through here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray
from tsdownsample import MinMaxLTTBDownsampler

Array = NDArray[np.float64]

POINT_LIMIT = 4000
"""Most points a line is drawn with."""

PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
"""SI prefixes by power of ten."""

PREFIXABLE = {"V", "A", "g", "Pa", "Hz", "m", "W", "N", "T", "Ω", "F", "s", "lx", "m/s", "m/s²", "m/s^2"}
"""Units that take a prefix; before any other the factor is written out."""

TIME_UNITS = (
    ("ms", 1e-3),
    ("s", 1.0),
    ("min", 60.0),
    ("h", 3600.0),
    ("days", 86400.0),
    ("years", 31557600.0),
)
"""Units of the time axis and their length in s."""


def choose_indices(z: Array, truth: Array | None = None, limit: int = POINT_LIMIT) -> NDArray[np.intp]:
    """Ascending indices of at most `limit` samples that keep the look of z, shape (n,), and of the truth."""
    n = len(z)
    if n <= limit:
        return np.arange(n, dtype=np.intp)
    if truth is None:
        return _downsample(z, limit)
    share = limit // 4
    return np.union1d(_downsample(z, limit - share), _downsample(truth, share)).astype(np.intp)


def _downsample(y: Array, points: int) -> NDArray[np.intp]:
    """MinMaxLTTB; missing samples are held at their last value for the choice."""
    if np.isnan(y).any():
        known = np.where(np.isnan(y), 0, np.arange(len(y)))
        y = np.nan_to_num(y[np.maximum.accumulate(known)])
    chosen = MinMaxLTTBDownsampler().downsample(np.ascontiguousarray(y), n_out=points)
    return np.unique(chosen).astype(np.intp)


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

    Units without a prefix are written with a power of ten only where decimals do not: 0.3 is easier to read.
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
    """Unit of a time axis that shows `span` seconds: the largest one that fits four times into it."""
    if sample_period is None:
        return Scale(1.0, "samples")
    for unit, length in reversed(TIME_UNITS):
        if span >= 4.0 * length:
            return Scale(1.0 / length, unit)
    return Scale(1000.0, "ms")


def drawable(x: Array, ys: list[Array], gaps: frozenset[int] = frozenset()) -> tuple[Array, ...]:
    """X ascending and every y finite, never empty: what uPlot can be given.

    The lines whose numbers are in `gaps` keep their NaN: they are drawn as points and decide no range.

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

    def __init__(self, gui: viser.GuiApi, height: int, *, sync: str | None = None) -> None:
        zeros = np.zeros(2)
        cursor: dict[str, Any] = {"drag": {"x": True, "y": False}}
        if sync is not None:
            cursor["sync"] = {"key": sync}
        self._handle = gui.add_uplot(
            (np.array([0.0, 1.0]), zeros),
            ({"label": "x"}, {"label": "y"}),
            scales={"x": {"time": False}},
            padding=(10, 24, 0, 0),  # without it viser rebuilds the chart whenever its width changes
            height=height,
            cursor=cursor,  # pyright: ignore[reportArgumentType]
        )
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
        layout: Layout,
        view: object = None,
        reach: tuple[float, float] | None = None,
    ) -> None:
        """Draw; `layout` is sent only when it differs; `reach` is the range of the x axis, if not that of x.

        A new `view`, or another reach of x, rebuilds the chart and so ends a zoom: with a fixed range for x viser
        keeps a zoom over new data, but not over a new scale.
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
        self._handle.data = data
        if not self._handle.visible:
            self._handle.visible = True

    def hide(self) -> None:
        """Take the chart off the screen: where there is no answer, an old curve would be taken for it."""
        if self._handle.visible:
            self._handle.visible = False


def _distribution(log: bool) -> dict[str, int]:
    return {"distr": 3, "log": 10} if log else {}


def log_scale_for(values: Array, unit: str) -> Scale:
    """A factor for a logarithmic axis that leaves its lowest value, > 0, at 0.001 or more."""
    lowest = float(values[values > 0.0].min(initial=1.0)) if len(values) else 1.0
    if lowest >= 0.001:
        return Scale(1.0, unit)
    power = max(3 * math.floor(math.log10(lowest) / 3), -300)
    if unit in PREFIXABLE and power in PREFIXES:
        return Scale(10.0**-power, PREFIXES[power] + unit)
    return Scale(10.0**-power, f"1e{power} {unit}".strip())


def log_time_scale(times: Array) -> Scale:
    """Unit of a logarithmic axis of ascending times > 0, s: seconds up to ten minutes, else as fits the middle."""
    if not len(times) or times[-1] < 600.0:
        return log_scale_for(times, "s")
    middle = math.sqrt(float(times[0]) * float(times[-1]))
    unit, length = next((one for one in reversed(TIME_UNITS) if one[1] <= middle), TIME_UNITS[0])
    return Scale(1.0 / length, unit)


def log_rate_scale(rates: Array) -> Scale:
    """Unit of a logarithmic axis of frequencies > 0, cycles a sample: so many samples that 0.001 is the lowest."""
    lowest = float(rates[rates > 0.0].min(initial=1.0)) if len(rates) else 1.0
    if lowest >= 0.001:
        return Scale(1.0, "cycles/sample")
    power = -3 * math.floor(math.log10(lowest) / 3) - 3
    samples = "1,000" if power == 3 else f"1e{power}"
    return Scale(10.0**power, f"cycles per {samples} samples")


def log_ticks(low: float, high: float, room: int = 9) -> tuple[float, ...]:
    """Round values from low to high, > 0, for a logarithmic axis: decades, with 2 and 5 between if few."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    step = max(1, math.ceil((last - first) / room))
    fine = (1.0, 2.0, 5.0) if last - first <= 3 else (1.0,)
    ticks = (mantissa * 10.0**power for power in range(first, last + 1, step) for mantissa in fine)
    return tuple(tick for tick in ticks if 0.999 * low <= tick <= 1.001 * high)


@dataclass(frozen=True)
class Layout:
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
