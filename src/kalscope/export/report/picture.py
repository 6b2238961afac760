"""The report as a picture of one sheet of A4, for lab books that take no HTML."""

# pyright: reportUnknownMemberType=false
# matplotlib leaves the types of keyword arguments open.

from __future__ import annotations

import io
import math
from collections.abc import Sequence

from kalscope.common.charts import COLOURS, LEFT, add_legend, blank_axes, draw_panel, drawing
from kalscope.common.text import one_line
from kalscope.export.report.content import Report
from kalscope.export.report.tables import ReportTable

SIZE = (1654, 2339)
"""Width and height of A4 at 200 dots an inch, px."""

MARGIN = 90
"""Left and right, px."""

WIDTH = SIZE[0] - 2 * MARGIN
"""Between the margins, px."""

NAMES = {2: 0.42, 4: 0.48, 5: 0.325, 6: 0.2}
"""Part of a table that its first column takes, by the number of columns; in other tables all are equally wide."""

DOTS_PER_INCH = 110
"""Of the drawing, so that a chart has the proportions of one on the page; the picture says 200."""


def as_png(report: Report) -> bytes:
    """The page as PNG, 200 dots an inch; what does not fit on the sheet is left out from the end of a text."""
    with drawing():
        return _Sheet().draw(report)


class _Sheet:
    """Draws the page from top to bottom; all lengths in px, from the upper left corner."""

    def __init__(self) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        size = (SIZE[0] / DOTS_PER_INCH, SIZE[1] / DOTS_PER_INCH)
        self._figure = Figure(size, DOTS_PER_INCH, facecolor="#ffffff")
        self._paper = blank_axes(self._figure, *SIZE)
        self._renderer = FigureCanvasAgg(self._figure).get_renderer()
        self._y = 65.0

    def draw(self, report: Report) -> bytes:
        """Everything, from the top."""
        self._line(report.title, 38)
        self._line(report.subtitle, 24, "quiet")
        left = MARGIN + LEFT
        add_legend(self._figure, report.charts, (left / SIZE[0], 1.0 - self._y / SIZE[1]))
        self._y += 62
        height = (520.0 if len(report.charts) == 1 else 290.0) - 8.0 * len(report.tables[-1].rows)  # for the pins
        for panel in report.charts:
            bottom, width = SIZE[1] - self._y - height, SIZE[0] - MARGIN - left
            bounds = (left / SIZE[0], bottom / SIZE[1], width / SIZE[0], height / SIZE[1])
            draw_panel(self._figure.add_axes(bounds), panel)
            self._y += height + 118
        self._y -= 30
        self._tables(report.table_columns)
        for head, text in (*report.texts, ("Reopen this session", report.command)):
            self._line(head, 25)
            self._paragraph(text, 22)
        for name, value in report.origin:
            self._write(MARGIN, name, 19, "quiet")
            self._write(MARGIN + 150, value, 19, room=WIDTH - 150)
            self._y += 26
        file = io.BytesIO()
        self._figure.savefig(file, format="png", pil_kwargs={"dpi": (200, 200)}, metadata={"Software": None})
        return file.getvalue()

    def _line(self, text: str, size: int, colour: str = "ink") -> None:
        self._write(MARGIN, text, size, colour, WIDTH)
        self._y += round(1.38 * size)

    def _paragraph(self, text: str, size: int) -> None:
        for line in self._wrapped(one_line(text), size, WIDTH):
            self._write(MARGIN, line, size)
            self._y += round(1.3 * size)
        self._y += 14

    def _tables(self, columns: Sequence[Sequence[ReportTable]]) -> None:
        """Two columns of tables beside each other."""
        width = WIDTH / 2 - 30.0
        top, ends = self._y, [self._y]
        for tables, x in zip(columns, (MARGIN, MARGIN + width + 60.0), strict=True):
            self._y = top
            for table in tables:
                self._table(table, x, width)
                self._y += 16
            ends.append(self._y)
        self._y = max(ends)

    def _table(self, table: ReportTable, x: float, width: float) -> None:
        """The first column takes its part of the width, the others share the rest."""
        self._write(x, table.heading, 25)
        self._y += 36
        for row in (*((table.columns,) if table.columns else ()), *table.rows):
            first = width * NAMES.get(len(row), 1.0 / len(row))
            self._write(x, row[0], 20, "quiet", first)
            share = (width - first) / (len(row) - 1)
            for i, value in enumerate(row[:0:-1]):
                colour = "quiet" if row is table.columns else "ink"
                self._write(x + width - i * share, value, 20, colour, share - 8, align="right")
            level = self._y + 27
            self._paper.plot((x, x + width), (level, level), color=COLOURS["edge"], linewidth=1)
            self._y += 31

    def _write(
        self, x: float, text: str, size: int, colour: str = "ink", room: float = math.inf, align: str = "left"
    ) -> None:
        """Text with its top at the current height, cut where it is wider than `room`."""
        line = one_line(text)
        while len(line) > 1 and self._width(line, size) > room:
            line = line[:-4].rstrip() + "..."
        self._paper.text(x, self._y, line, size=_points(size), color=COLOURS[colour], ha=align, va="top")

    def _wrapped(self, text: str, size: int, width: float) -> list[str]:
        """Lines no longer than `width` px; a word that is longer is cut into pieces."""
        lines: list[str] = []
        line = ""
        for word in text.split(" "):
            rest = word
            while self._width(f"{line} {rest}".strip(), size) > width:
                if line:
                    lines.append(line)
                    line = ""
                    continue
                end = next(i for i in range(len(rest), 0, -1) if i == 1 or self._width(rest[:i], size) <= width)
                lines.append(rest[:end])
                rest = rest[end:]
            line = f"{line} {rest}".strip()
        return [*lines, line] if line else lines

    def _width(self, text: str, size: int) -> float:
        from matplotlib.font_manager import FontProperties

        return self._renderer.get_text_width_height_descent(text, FontProperties(size=_points(size)), ismath=False)[
            0
        ]


def _points(size: float) -> float:
    return 0.9 * 72.0 / DOTS_PER_INCH * size
