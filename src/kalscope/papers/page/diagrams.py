"""The two diagrams of the papers: the flow chart of the first, the block diagram of the second."""

# pyright: reportUnknownMemberType=false
# matplotlib leaves the types of keyword arguments open.

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from kalscope.common.charts import COLOURS, WIDTH, blank_axes, drawing, new_figure, svg_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LINE_HEIGHT = 22.0
"""Distance of two lines of text in a box, px."""


def flow_chart() -> str:
    """Figure 2 of Ma'arif et al. (2019): initialise once, then read, predict, update and show in a loop."""
    boxes = (
        (15.0, 150.0, "once", "choose Q and R", "x = 0, p = 1"),
        (191.0, 130.0, "read", "sensor data y"),
        (347.0, 165.0, "predict", "x stays  (11)", "p ← p + Q  (12)"),
        (538.0, 205.0, "update", "K = p / (p + R)  (14)", "x ← x + K (y − x)  (13)", "p ← (1 − K) p  (15)"),
        (769.0, 175.0, "show", "x, the filtered value", "keep x and p"),
    )
    with drawing():
        figure = new_figure(190.0)
        axes = blank_axes(figure, WIDTH, 190.0)
        for left, width, *words in boxes:
            _box(axes, (left, 40.0), (width, 104.0), *words)
        for (left, width, *_), (following, *_) in pairwise(boxes):
            _arrow(axes, (left + width, 92.0), (following, 92.0))
        first, last = 256.0, 856.5  # middles of "read" and "show"
        _arrow(axes, (last, 144.0), (last, 176.0), (first, 176.0), (first, 144.0))
        axes.text((first + last) / 2, 170.0, "next sample", ha="center", color=COLOURS["quiet"])
        return svg_text(figure, "Flow chart: initialise, then read, predict, update, show, and again")


def block_diagram() -> str:
    """Figure 1 of Khan et al.: what flows where; the dashed arrow is the slip of equation (3)."""
    slip = COLOURS["s2"]
    with drawing():
        figure = new_figure(360.0)
        axes = blank_axes(figure, WIDTH, 360.0)
        _box(axes, (250.0, 70.0), (190.0, 70.0), "gain (1)", "K = σE / (σE + σM)")
        _box(axes, (530.0, 70.0), (230.0, 70.0), "estimate (2)", "E ← E + K (M − E)")
        _box(axes, (390.0, 240.0), (230.0, 70.0), "error (3)", "σE ← (1 − K) · ?")
        _arrow(axes, (150.0, 106.0), (250.0, 106.0))
        _arrow(axes, (645.0, 27.0), (645.0, 70.0))
        _arrow(axes, (440.0, 106.0), (530.0, 106.0))
        _arrow(axes, (760.0, 106.0), (945.0, 106.0))
        _arrow(axes, (420.0, 140.0), (420.0, 240.0))
        _arrow(axes, (390.0, 275.0), (300.0, 275.0), (300.0, 140.0))
        _arrow(axes, (345.0, 275.0), (345.0, 340.0), (505.0, 340.0), (505.0, 310.0))
        _arrow(axes, (690.0, 140.0), (690.0, 275.0), (620.0, 275.0), colour=slip, dashes=(0, (5, 3)))
        axes.text(20.0, 110.0, "σM, measured error")
        axes.text(645.0, 20.0, "M, measurement", ha="center")
        axes.text(485.0, 98.0, "K", ha="center")
        axes.text(880.0, 96.0, "filtered value", ha="center")
        axes.text(412.0, 200.0, "K", ha="right")
        axes.text(292.0, 215.0, "σE", ha="right")
        axes.text(515.0, 344.0, "σE, as the words of the text ask")
        axes.text(700.0, 215.0, "E(t−1), as printed", color=slip, weight=600)
        return svg_text(figure, "Block diagram: gain, estimate, error, and what equation (3) feeds back")


def _box(axes: Axes, corner: tuple[float, float], size: tuple[float, float], title: str, *lines: str) -> None:
    from matplotlib.patches import FancyBboxPatch

    (x, y), (width, height) = corner, size
    shape = FancyBboxPatch(corner, width, height, "round,pad=0,rounding_size=6", clip_on=False)
    shape.set(facecolor=COLOURS["tint"], edgecolor=COLOURS["quiet"], linewidth=1.3)
    axes.add_patch(shape)
    for i, text in enumerate((title, *lines)):
        weight = "normal" if i else 600
        axes.text(x + width / 2, y + 23.0 + LINE_HEIGHT * i, text, ha="center", weight=weight)


def _arrow(axes: Axes, *points: tuple[float, float], colour: str = COLOURS["quiet"], dashes: object = "-") -> None:
    """A line along the points with a head at the last one."""
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path

    axes.plot(*zip(*points, strict=True), color=colour, linewidth=1.5, linestyle=dashes, clip_on=False)
    head = FancyArrowPatch(path=Path(points[-2:]), arrowstyle="-|>", mutation_scale=13, color=colour, clip_on=False)
    axes.add_patch(head)
