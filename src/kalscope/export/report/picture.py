"""The report as a picture of one sheet of A4, for lab books that take no HTML."""

# pyright: reportUnknownMemberType=false
# matplotlib leaves the types of keyword arguments open.

from __future__ import annotations

import io
from textwrap import wrap
from typing import TYPE_CHECKING

from kalscope.common.charts import COLOURS, draw_panels, drawing
from kalscope.common.text import one_line
from kalscope.export.report.content import Report
from kalscope.export.report.tables import ReportTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIZE = (1654, 2339)
"""Width and height of A4 at 200 dots an inch, px."""

DOTS_PER_INCH = 110
"""Of the drawing, so that a chart has the proportions of one on the page; the picture says 200."""

LINES, CHARACTERS = 80, 135
"""Lines of text on a sheet, and characters of usual text in a line."""

CHART = 22
"""Greatest height of a chart, lines."""

CELL = 36
"""Characters of a cell; longer ones are cut."""


def as_png(report: Report) -> bytes:
    """The page as PNG, 200 dots an inch; what does not fit on the sheet is left out from its end."""
    from matplotlib.figure import Figure

    tables = max(sum(_height(table) for table in column) for column in report.table_columns)
    texts = [
        (head, wrap(one_line(text), CHARACTERS))
        for head, text in (*report.texts, ("Reopen this session", report.command))
    ]
    below = tables + sum(len(lines) + 2 for _, lines in texts) + len(report.origin)
    charts = min(CHART * len(report.charts), max(LINES - below - 8, 10))
    with drawing():
        size = (SIZE[0] / DOTS_PER_INCH, SIZE[1] / DOTS_PER_INCH)
        figure = Figure(size, DOTS_PER_INCH, facecolor="white", layout="constrained")
        heights = (2, 3, charts, LINES - 5 - charts)
        grid = figure.add_gridspec(4, 3, width_ratios=(1, 16, 1), height_ratios=heights)
        title, middle, paper = (figure.add_subfigure(grid[row, 1]) for row in (1, 2, 3))
        title.text(0.0, 0.5, _cut(report.title, CHARACTERS // 2), size="xx-large")
        title.text(0.0, 0.0, _cut(report.subtitle, CHARACTERS), color=COLOURS["quiet"])
        draw_panels(middle, report.charts)
        axes = paper.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, CHARACTERS), ylim=(heights[-1], 0.0))
        axes.set_axis_off()
        for column, x in zip(report.table_columns, (0.0, 0.5 * CHARACTERS + 2.0), strict=True):
            y = 1.0
            for table in column:
                _draw_table(axes, table, x, y)
                y += _height(table)
        y = 1.0 + tables
        for head, lines in texts:
            for i, line in enumerate((head, *lines)):
                axes.text(0.0, y + i, line, va="top", weight="normal" if i else 600)
            y += len(lines) + 2
        for name, value in report.origin:
            axes.text(0.0, y, name, va="top", color=COLOURS["quiet"])
            axes.text(12.0, y, _cut(value, CHARACTERS - 12), va="top")
            y += 1.0
        file = io.BytesIO()
        figure.savefig(file, format="png", pil_kwargs={"dpi": (200, 200)}, metadata={"Software": None})
        return file.getvalue()


def _height(table: ReportTable) -> int:
    """Lines that a table takes, with its heading and the space below it."""
    return len(table.rows) + bool(table.columns) + 2


def _draw_table(axes: Axes, table: ReportTable, x: float, y: float) -> None:
    """The columns are as wide as their longest cells; the first one is cut where all are too wide."""
    width = 0.5 * CHARACTERS - 2.0
    rows = [
        [_cut(cell, CELL) for cell in row] for row in (*((table.columns,) if table.columns else ()), *table.rows)
    ]
    longest = [max(map(len, column)) + 1 for column in zip(*rows, strict=True)]
    longest[0] = max(6, min(longest[0], int(width) - sum(longest[1:])))
    axes.text(x, y, table.heading, weight=600, va="top")
    for row in rows:
        y += 1.0
        end = 0
        for i, (cell, characters) in enumerate(zip(row, longest, strict=True)):
            end += characters
            at = x if i == 0 else x + width * end / sum(longest)
            text = _cut(cell, characters) if i == 0 else cell
            colour = COLOURS["quiet" if i == 0 or row == list(table.columns) else "ink"]
            axes.text(at, y, text, va="top", ha="left" if i == 0 else "right", color=colour)
        axes.plot((x, x + width), (y + 0.88,) * 2, color=COLOURS["edge"], linewidth=1)


def _cut(text: str, characters: int) -> str:
    line = one_line(text)
    return line if len(line) <= characters else f"{line[: characters - 1]}…"
