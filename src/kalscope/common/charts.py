"""Line charts by matplotlib: panels on a grid with one legend, as inline SVG or on a sheet of paper.

matplotlib is imported where a chart is drawn, because that takes longer than the start of the program.
"""

# pyright: reportUnknownMemberType=false
# matplotlib leaves the types of keyword arguments open.

from __future__ import annotations

import logging
import math
import re
import warnings
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from io import StringIO
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 960
"""Width of every SVG in its own units, px; the page scales it."""
TOP = 30
"""Height of the legend, px."""
LEFT, LEFT_OF_MANY, RIGHT, ABOVE, BELOW = 84, 62, 19, 30, 46
"""Room around the axes of a panel for its labels and title, px; less on the left where panels are in columns."""

COLOURS = {
    "ink": "#1b1f24",
    "quiet": "#57606a",
    "edge": "#d5dae0",
    "tint": "#f4f6f8",
    "raw": "#8a939d",
    "s1": "#0072b2",
    "s2": "#d55e00",
    "s3": "#009e73",
    "s4": "#cc79a7",
}
"""Colours on paper. A page may set the CSS variable of the same name, such as --s1, to another colour.

s1 to s4: Wong (2011), Nature Methods 8, 441; distinct with every common colour vision.
"""

STYLES = {"raw": ("raw", 1.1, "-"), "truth": ("ink", 1.3, "--")} | {
    f"s{i}": (f"s{i}", 1.8, "-") for i in range(1, 5)
}
"""Colour, width and dashes of each style of a line."""

SETTINGS: Any = {
    "font.size": 13,
    "font.sans-serif": ["DejaVu Sans"],
    "text.parse_math": False,
    "text.color": COLOURS["ink"],
    "axes.labelcolor": COLOURS["quiet"],
    "axes.labelsize": "medium",
    "axes.titlesize": "medium",
    "axes.titleweight": 600,
    "axes.titlelocation": "left",
    "axes.facecolor": "none",
    "axes.xmargin": 0,
    "axes.ymargin": 0.06,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-99, 99),
    "axes.grid": True,
    "grid.color": COLOURS["edge"],
    "grid.linewidth": 1,
    "xtick.labelcolor": COLOURS["ink"],
    "ytick.labelcolor": COLOURS["ink"],
    "xtick.major.pad": 7,
    "ytick.major.pad": 6,
    "lines.dash_capstyle": "butt",
    "lines.solid_capstyle": "butt",
    "legend.frameon": False,
    "legend.borderpad": 0,
    "svg.fonttype": "none",
    "svg.hashsalt": "kalscope",
    **{f"axes.spines.{side}": False for side in ("left", "right", "top", "bottom")},
    **{f"{axis}tick.{kind}.size": 0 for axis in "xy" for kind in ("major", "minor")},
}
"""Matplotlib's settings for our charts. Ticks without a mark need no reference within the SVG."""

_LOCK = Lock()


@dataclass(frozen=True)
class Line:
    """One curve."""

    x: ArrayLike
    """Abscissae, shape (n,)."""
    y: ArrayLike
    """Ordinates, shape (n,); NaN interrupts the line."""
    label: str
    """Name in the legend; equal names appear once."""
    style: str
    """A key of `STYLES`."""


@dataclass(frozen=True)
class Mark:
    """A dashed straight line at one value, with a word beside it."""

    at: float
    """Where, on its axis."""
    text: str
    """What it marks."""
    axis: str = "x"
    """"x": upright at this abscissa; "y": level at this ordinate."""


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    title: str
    """Above the axes."""
    lines: tuple[Line, ...]
    """Curves, the first one lowest."""
    x_label: str
    """What the abscissa is, with its unit."""
    y_label: str
    """What the ordinate is, with its unit."""
    y_range: tuple[float, float] | None = None
    """Ends of the ordinate; None = what the curves need."""
    log_x: bool = False
    """Whether the abscissa is logarithmic."""
    marks: tuple[Mark, ...] = ()
    """Marked values."""


def raw_and_filtered(
    x: ArrayLike, raw: ArrayLike, filtered: ArrayLike, label: str = "filtered", style: str = "s2"
) -> tuple[Line, Line]:
    """The two curves of most panels."""
    return Line(x, raw, "raw", "raw"), Line(x, filtered, label, style)


@contextmanager
def drawing() -> Generator[None]:
    """Matplotlib with our settings. They hold for the whole process, so one thread draws at a time."""
    import matplotlib

    log = logging.getLogger("matplotlib")
    with _LOCK, warnings.catch_warnings(), matplotlib.rc_context():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)  # the page's own font may have it
        level = log.level
        log.setLevel(logging.ERROR)  # it announces its font cache
        matplotlib.rcdefaults()  # not those of the user's matplotlibrc
        matplotlib.rcParams.update(SETTINGS)
        try:
            yield
        finally:
            log.setLevel(level)


def draw_svg(panels: Sequence[Panel], name: str, columns: int = 1, height: int = 250) -> str:
    """Panels on a grid as one <svg> element.

    Args:
        panels: the panels, row by row.
        name: what a screen reader says of the picture.
        columns: panels a row.
        height: height of a panel, of a width of 960 for the whole figure.

    Returns:
        The element as text, every word escaped.
    """
    total = TOP + math.ceil(len(panels) / columns) * height
    left, width = LEFT if columns == 1 else LEFT_OF_MANY, WIDTH / columns
    with drawing():
        figure = new_figure(total)
        for i, panel in enumerate(panels):
            bottom = total - TOP - (i // columns + 1) * height + BELOW
            x, w, h = (i % columns) * width + left, width - left - RIGHT, height - ABOVE - BELOW
            axes = figure.add_axes((x / WIDTH, bottom / total, w / WIDTH, h / total))
            axes.yaxis.set_label_coords((16 - left) / w, 0.5)
            draw_panel(axes, panel)
        add_legend(figure, panels, (left / WIDTH, 1.0))
        return svg_text(figure, name)


def new_figure(height: float) -> Figure:
    """An empty figure of `WIDTH` and this height, px."""
    from matplotlib.figure import Figure

    return Figure((WIDTH / 72, height / 72), facecolor="none")


def blank_axes(figure: Figure, width: float, height: float) -> Axes:
    """Axes without lines over a whole figure, in px from the upper left corner."""
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, width), ylim=(height, 0.0))
    axes.set_axis_off()
    return axes


def draw_panel(axes: Axes, panel: Panel) -> None:
    """Curves, marks and labels. Nothing is clipped, so a curve is interrupted where it leaves its axes."""
    low, high = panel.y_range or (-math.inf, math.inf)
    for line in panel.lines:
        colour, width, dashes = STYLES[line.style]
        y = np.asarray(line.y, dtype=np.float64)
        y = np.where((y < low) | (y > high), np.nan, y)
        axes.plot(np.asarray(line.x), y, dashes, color=COLOURS[colour], linewidth=width, clip_on=False)
    axes.locator_params("y", nbins=5)
    if panel.log_x:
        from matplotlib.ticker import EngFormatter

        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
    ends = [end for line in panel.lines for end in (np.min(line.x), np.max(line.x))]
    axes.set(title=panel.title, xlabel=panel.x_label, ylabel=panel.y_label)
    axes.set(xlim=(min(ends), max(ends)), ylim=panel.y_range)
    axes.grid(clip_on=False)
    for axis in (axes.xaxis, axes.yaxis):
        if not 1e-5 <= np.abs(axis.get_view_interval()).max() < 1e12:  # all digits would be too long
            axis.set_major_formatter("{x:g}")
    for mark in panel.marks:
        _draw_mark(axes, mark)


def _draw_mark(axes: Axes, mark: Mark) -> None:
    style: Any = {"color": COLOURS["ink"], "linewidth": 1, "linestyle": (0, (4, 3)), "clip_on": False}
    if mark.axis == "x":
        axes.axvline(mark.at, **style)
        at, frame, offset, align = (mark.at, 0.0), axes.get_xaxis_transform(), (4, 6), "left"
    else:
        axes.axhline(mark.at, **style)
        at, frame, offset, align = (1.0, mark.at), axes.get_yaxis_transform(), (-4, -13), "right"
    axes.annotate(mark.text, at, offset, frame, textcoords="offset points", ha=align)


def add_legend(figure: Figure, panels: Sequence[Panel], corner: tuple[float, float]) -> None:
    """One row with each name once; its upper left corner in shares of the figure."""
    from matplotlib.lines import Line2D

    entries = {line.label: STYLES[line.style] for panel in panels for line in panel.lines}
    handles = [Line2D([], [], color=COLOURS[c], lw=max(w, 2.5), ls=d) for c, w, d in entries.values()]
    figure.legend(handles, list(entries), ncols=len(entries), loc="upper left", bbox_to_anchor=corner)


def svg_text(figure: Figure, name: str) -> str:
    """A figure as an <svg> element for a page: no identifiers to clash, colours that the page may change."""
    file = StringIO()
    figure.savefig(file, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    text = file.getvalue().partition("<svg ")[2]
    text = re.sub(r' id="[^"]*"', "", text)
    text = re.sub(r'<path d="[^"]*"', lambda path: re.sub(r"(\.\d)\d+", r"\1", path[0]), text)  # tenths of a px
    for variable, colour in COLOURS.items():
        text = text.replace(f": {colour}", f": var(--{variable},{colour})")
    return f'<svg role="img" aria-label="{escape(name)}" {text}'
