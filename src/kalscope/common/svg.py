"""Small line charts as inline SVG: panels on a grid, one legend, colours from the page's light or dark theme.

Written by hand, because the page needs nothing more than lines and a drawing library would be the largest
dependency of the project. Colours are classes (`raw`, `s1` … `s4`, `truth`); the page's style sheet gives them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kalscope.common.array import Array

if TYPE_CHECKING:
    from collections.abc import Sequence

WIDTH = 960
"""Width of every figure in its own units; the page scales it."""
LEFT, RIGHT, TOP, BOTTOM = 60, 19, 30, 44
"""Room around the axes of a panel for its labels and title."""
LEGEND = 30
"""Height of the legend."""


@dataclass(frozen=True)
class Line:
    """One curve."""

    x: ArrayLike
    """Abscissae, shape (n,)."""
    y: ArrayLike
    """Ordinates, shape (n,); NaN interrupts the line."""
    label: str
    """Name in the legend; equal names stand there once."""
    style: str
    """"raw", "s1" … "s4" or "truth"."""


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


@dataclass(frozen=True)
class _Axis:
    """From values to the units of the picture."""

    low: float
    high: float
    start: float
    stop: float
    log: bool = False

    def place(self, values: ArrayLike) -> Array:
        """Positions of values in the picture."""
        v = np.asarray(values, dtype=np.float64)
        v = np.log10(v) if self.log else v
        return self.start + (v - self.low) / (self.high - self.low) * (self.stop - self.start)

    def ticks(self, about: int) -> list[tuple[float, str]]:
        """Round values on the axis and how they are written."""
        if self.log:
            decades = range(math.ceil(self.low - 1e-9), math.floor(self.high + 1e-9) + 1)
            return [(10.0**d, _decade(d)) for d in decades]
        step = _round_step((self.high - self.low) / about)
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        digits = max(0, -math.floor(math.log10(step) + 1e-9))
        return [(i * step, f"{i * step:.{digits}f}".replace("-", "−")) for i in range(first, last + 1)]


def draw(panels: Sequence[Panel], name: str, columns: int = 1, height: int = 250) -> str:
    """Panels on a grid as one <svg> element.

    Args:
        panels: the panels, row by row.
        name: what a screen reader says of the picture.
        columns: panels a row.
        height: height of a panel, of a width of 960 for the whole figure.

    Returns:
        The element as text, every word escaped.
    """
    rows = math.ceil(len(panels) / columns)
    width = WIDTH / columns
    parts = [_legend(panels)]
    for i, panel in enumerate(panels):
        left, top = (i % columns) * width, LEGEND + (i // columns) * height
        parts.append(_panel(panel, left, top, width, height))
    return svg_element("".join(parts), LEGEND + rows * height, name)


def svg_element(content: str, height: float, name: str) -> str:
    """The <svg> element around `content`, as wide as every figure."""
    size = f'viewBox="0 0 {WIDTH} {height:g}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" aria-label="{escape(name)}">{content}</svg>'


def word(x: float, y: float, text: str, kind: str = "", turn: bool = False) -> str:
    """One <text> element; `kind` are classes such as "end", "mid", "strong"."""
    turned = f' transform="rotate(-90 {x:.1f} {y:.1f})"' if turn else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" class="{kind}"{turned}>{escape(text)}</text>'


def _panel(panel: Panel, left: float, top: float, width: float, height: float) -> str:
    x, y = _axes(panel, left, top, width, height)
    parts = [word(x.start, top + 18, panel.title, "strong")]
    for value, text in y.ticks(max(3, round((y.start - y.stop) / 45))):
        at = float(y.place(value))
        parts.append(f'<path class="grid" d="M{x.start:.1f} {at:.1f}H{x.stop:.1f}"/>')
        parts.append(word(x.start - 6, at + 4, text, "end"))
    for value, text in x.ticks(max(3, round((x.stop - x.start) / 85))):
        at = float(x.place(value))
        parts.append(f'<path class="grid" d="M{at:.1f} {y.start:.1f}V{y.stop:.1f}"/>')
        parts.append(word(at, y.start + 16, text, "mid"))
    parts.append(word((x.start + x.stop) / 2, y.start + 35, panel.x_label, "mid label"))
    parts.append(word(left + 14, (y.start + y.stop) / 2, panel.y_label, "mid label", turn=True))
    parts.extend(_curve(line, x, y) for line in panel.lines)
    parts.extend(_marked(mark, x, y) for mark in panel.marks)
    return "".join(parts)


def _axes(panel: Panel, left: float, top: float, width: float, height: float) -> tuple[_Axis, _Axis]:
    xs = np.concatenate([np.asarray(line.x, dtype=np.float64) for line in panel.lines])
    ends = (float(xs.min()), float(xs.max()))
    if panel.log_x:
        ends = (math.log10(ends[0]), math.log10(ends[1]))
    if panel.y_range is None:
        ys = np.concatenate([np.asarray(line.y, dtype=np.float64) for line in panel.lines])
        low, high = float(np.nanmin(ys)), float(np.nanmax(ys))
        room = 0.06 * (high - low) or 1.0
        low, high = low - room if low < 0.0 or low > room else 0.0, high + room
    else:
        low, high = panel.y_range
    x = _Axis(*ends, left + LEFT, left + width - RIGHT, panel.log_x)
    return x, _Axis(low, high, top + height - BOTTOM, top + TOP)


def _curve(line: Line, x: _Axis, y: _Axis) -> str:
    """The curve, interrupted at NaN and where it leaves its axes."""
    xs = x.place(line.x)
    ys = y.place(line.y)
    ys = np.where((ys < y.stop - 0.5) | (ys > y.start + 0.5), np.nan, ys)
    pen, parts = "M", []
    for px, py in zip(xs.tolist(), ys.tolist(), strict=True):
        if math.isnan(py):
            pen = "M"
            continue
        parts.append(f"{pen}{px:.1f} {py:.1f}")
        pen = "L"
    return f'<path class="line {line.style}" d="{"".join(parts)}"/>'


def _marked(mark: Mark, x: _Axis, y: _Axis) -> str:
    if mark.axis == "x":
        at = float(x.place(mark.at))
        path, label = f"M{at:.1f} {y.start:.1f}V{y.stop:.1f}", word(at + 4, y.start - 6, mark.text)
    else:
        at = float(y.place(mark.at))
        path, label = f"M{x.start:.1f} {at:.1f}H{x.stop:.1f}", word(x.stop - 4, at + 13, mark.text, "end")
    return f'<path class="mark" d="{path}"/>{label}'


def _legend(panels: Sequence[Panel]) -> str:
    styles = {line.label: line.style for panel in panels for line in panel.lines}
    at, parts = float(LEFT), []
    for label, style in styles.items():
        parts.append(f'<path class="line thick {style}" d="M{at:.1f} 16h26"/>{word(at + 32, 20, label)}')
        at += 56 + 7.2 * len(label)
    return "".join(parts)


def _decade(power: int) -> str:
    """10 to the power, short enough for an axis: 100, 1k, 100k, 1M."""
    if not 0 <= power < 9:
        return f"{10.0**power:g}"
    return f"{10 ** (power % 3)}{('', 'k', 'M')[power // 3]}"


def _round_step(rough: float) -> float:
    """1, 2 or 5 times a power of ten, at least `rough`."""
    power = 10.0 ** math.floor(math.log10(rough))
    return next(power * f for f in (1.0, 2.0, 5.0, 10.0) if power * f >= rough * (1 - 1e-9))
