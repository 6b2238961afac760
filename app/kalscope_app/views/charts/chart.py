"""All that is passed to uPlot: which points, in which order, in which unit, and what it must never get.

viser's uPlot goes blank on a leading NaN, on inf and on empty arrays, draws a bridge over NaN, and prints ticks
with three decimals at most. So everything drawn passes through here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import viser

from kalscope.common.array import Array
from kalscope_app.views.binding import put
from kalscope_app.views.window.layout import height_of


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
    """Whether two tuples hold equal arrays; NaN equals nothing, so lines with gaps always count as new."""
    return len(one) == len(other) and all(map(np.array_equal, one, other))


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
