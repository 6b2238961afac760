"""Line charts by matplotlib, as inline SVG or PNG, and HTML pages that need nothing else."""

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
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase


# Line charts by matplotlib: panels on a grid with one legend, as inline SVG or within a figure.
#
# matplotlib is imported where a chart is drawn, because that takes longer than the start of the program.


# pyright: reportUnknownMemberType=false
# matplotlib leaves the types of keyword arguments open.


WIDTH = 960
"""Width of every SVG in its own units, px; the page scales it."""
LEGEND = 30
"""Height of the legend, px."""

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

STYLE_FILE = Path(__file__).parent / "figures.mplstyle"

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


def raw_and_filtered(
    x: ArrayLike, raw: ArrayLike, filtered: ArrayLike, label: str = "filtered", style: str = "s2"
) -> tuple[Line, Line]:
    """The two curves of most panels."""
    return Line(x, raw, "raw", "raw"), Line(x, filtered, label, style)


@contextmanager
def drawing() -> Generator[None]:
    """Matplotlib with our style. It holds for the whole process, so one thread draws at a time."""
    import matplotlib.style

    ink, quiet = COLOURS["ink"], COLOURS["quiet"]
    colours = {"text.color": ink, "xtick.labelcolor": ink, "ytick.labelcolor": ink, "axes.labelcolor": quiet}
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it announces its font cache
    with _LOCK, warnings.catch_warnings(), matplotlib.style.context(["default", STYLE_FILE, colours]):
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)  # the page's own font may have it
        yield


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
    from matplotlib.figure import Figure

    with drawing():
        total = LEGEND + math.ceil(len(panels) / columns) * height
        figure = Figure((WIDTH / 72, total / 72), layout="constrained")
        draw_panels(figure, panels, columns)
        return _svg_text(figure, name)


def draw_panels(figure: FigureBase, panels: Sequence[Panel], columns: int = 1) -> None:
    """Panels on a grid, and one row above them with the name of each line once."""
    from matplotlib.lines import Line2D

    rows = math.ceil(len(panels) / columns)
    for i, panel in enumerate(panels, 1):
        _draw_panel(figure.add_subplot(rows, columns, i), panel)
    entries = {line.label: STYLES[line.style] for panel in panels for line in panel.lines}
    handles = [Line2D([], [], color=COLOURS[c], lw=max(w, 2.5), ls=d) for c, w, d in entries.values()]
    figure.legend(handles, list(entries), ncols=len(entries), loc="outside upper left")


def _draw_panel(axes: Axes, panel: Panel) -> None:
    """Curves and labels. Nothing is clipped, so a curve is interrupted where it leaves its axes."""
    low, high = panel.y_range or (-math.inf, math.inf)
    for line in panel.lines:
        colour, width, dashes = STYLES[line.style]
        y = np.asarray(line.y, dtype=np.float64)
        y = np.where((y < low) | (y > high), np.nan, y)
        axes.plot(np.asarray(line.x), y, dashes, color=COLOURS[colour], linewidth=width, clip_on=False)
    axes.locator_params("y", nbins=5)
    ends = [end for line in panel.lines for end in (np.min(line.x), np.max(line.x))]
    axes.set(title=panel.title, xlabel=panel.x_label, ylabel=panel.y_label)
    axes.set(xlim=(min(ends), max(ends)), ylim=panel.y_range)
    axes.grid(clip_on=False, color=COLOURS["edge"])


def _svg_text(figure: Figure, name: str) -> str:
    """A figure as an <svg> element for a page: no identifiers to clash, colours that the page may change."""
    file = StringIO()
    figure.savefig(file, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    text = file.getvalue().partition("<svg ")[2]
    text = re.sub(r' id="[^"]*"', "", text)
    text = re.sub(r'<path d="[^"]*"', lambda path: re.sub(r"(\.\d)\d+", r"\1", path[0]), text)  # tenths of a px
    for variable, colour in COLOURS.items():
        text = text.replace(f": {colour}", f": var(--{variable},{colour})")
    return f'<svg role="img" aria-label="{escape(name)}" {text}'


# HTML pages that need nothing else: they load nothing, run nothing, and show every word from outside as text.


_PAGE = """\
<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width,initial-scale=1">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'">
<title>{title}</title><style>{style}</style></head>
<body><main>
{body}
</main></body></html>
"""


def document(title: str, style: str, body: str) -> str:
    """A whole page: `title` is text, `style` CSS and `body` HTML."""
    return _PAGE.format(title=escape(title), style=style, body=body)


def markup_of_table(head: Sequence[str], rows: Sequence[Sequence[str]], kind: str = "") -> str:
    """A table element of CSS class `kind`, every cell escaped; without headings where `head` is empty."""
    top = "".join(f'<th scope="col">{escape(text)}</th>' for text in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows)
    head_rows = f"<thead><tr>{top}</tr></thead>" if head else ""
    css = f' class="{kind}"' if kind else ""
    return f'<div class="wide"><table{css}>{head_rows}<tbody>{body}</tbody></table></div>'
