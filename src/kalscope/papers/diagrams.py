"""The two diagrams of the papers: the flow chart of the first, the block diagram of the second."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from kalscope.common.svg import svg_element, word

if TYPE_CHECKING:
    from collections.abc import Sequence

Point = tuple[float, float]


def flow_chart() -> str:
    """Figure 2 of Ma'arif et al. (2019): initialise once, then read, predict, update, show, for ever."""
    steps = (
        ("once", ("choose Q and R", "x = 0, p = 1")),
        ("read", ("sensor data y",)),
        ("predict", ("x stays  (11)", "p ← p + Q  (12)")),
        ("update", ("K = p / (p + R)  (14)", "x ← x + K (y − x)  (13)", "p ← (1 − K) p  (15)")),
        ("show", ("x, the filtered value", "keep x and p")),
    )
    widths = (150.0, 130.0, 165.0, 205.0, 175.0)
    parts, left, edges = [], 15.0, []
    for (title, lines), width in zip(steps, widths, strict=True):
        parts.append(_box(left, 40.0, width, 104.0, title, lines))
        edges.append((left, left + width))
        left += width + 26.0
    parts += [_arrow(((a[1], 92.0), (b[0], 92.0))) for a, b in pairwise(edges)]
    first, last = sum(edges[1]) / 2, sum(edges[-1]) / 2
    parts.append(_arrow(((last, 144.0), (last, 176.0), (first, 176.0), (first, 144.0))))
    parts.append(word((first + last) / 2, 170.0, "next sample", "mid label"))
    return svg_element("".join(parts), 190.0, "Flow chart: initialise, then read, predict, update, show, and again")


def block_diagram() -> str:
    """Figure 1 of Khan et al.: what flows where; the dashed arrow is the slip of equation (3)."""
    gain = _box(250.0, 70.0, 190.0, 70.0, "gain (1)", ("K = σE / (σE + σM)",))
    estimate = _box(530.0, 70.0, 230.0, 70.0, "estimate (2)", ("E ← E + K (M − E)",))
    error = _box(390.0, 240.0, 230.0, 70.0, "error (3)", ("σE ← (1 − K) · ?",))
    parts = [
        gain,
        estimate,
        error,
        word(20.0, 110.0, "σM, measured error"),
        _arrow(((150.0, 106.0), (250.0, 106.0))),
        word(645.0, 20.0, "M, measurement", "mid"),
        _arrow(((645.0, 27.0), (645.0, 70.0))),
        word(485.0, 98.0, "K", "mid"),
        _arrow(((440.0, 106.0), (530.0, 106.0))),
        word(880.0, 96.0, "filtered value", "mid"),
        _arrow(((760.0, 106.0), (945.0, 106.0))),
        _arrow(((420.0, 140.0), (420.0, 240.0))),
        word(412.0, 200.0, "K", "end"),
        _arrow(((390.0, 275.0), (300.0, 275.0), (300.0, 140.0))),
        word(292.0, 215.0, "σE", "end"),
        _arrow(((345.0, 275.0), (345.0, 340.0), (505.0, 340.0), (505.0, 310.0))),
        word(515.0, 344.0, "σE, as the words of the text ask"),
        _arrow(((690.0, 140.0), (690.0, 275.0), (620.0, 275.0)), "slip"),
        word(700.0, 215.0, "E(t−1), as printed", "slip-word"),
    ]
    return svg_element(
        "".join(parts), 360.0, "Block diagram: gain, estimate, error, and what equation (3) feeds back"
    )


def _box(x: float, y: float, width: float, height: float, title: str, lines: Sequence[str]) -> str:
    shape = f'<rect class="box" x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="6"/>'
    middle, top = x + width / 2, y + 23.0
    rows = [word(middle, top + 22.0 * (i + 1), line, "mid") for i, line in enumerate(lines)]
    return shape + word(middle, top, title, "mid strong") + "".join(rows)


def _arrow(points: Sequence[Point], kind: str = "arrow") -> str:
    """A line along the points with a head at the last one."""
    (x0, y0), (x1, y1) = points[-2:]
    length = abs(x1 - x0) + abs(y1 - y0)
    ux, uy = (x1 - x0) / length, (y1 - y0) / length
    wing = f"M{x1:g} {y1:g}L{x1 - 9 * ux - 4 * uy:g} {y1 - 9 * uy - 4 * ux:g}L{x1 - 9 * ux + 4 * uy:g}"
    path = "M" + "L".join(f"{x:g} {y:g}" for x, y in points)
    return f'<path class="{kind}" d="{path}"/><path class="head" d="{wing} {y1 - 9 * uy + 4 * ux:g}z"/>'
