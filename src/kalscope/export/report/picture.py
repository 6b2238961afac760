"""The report as a picture of one sheet of A4, for lab books that take no HTML."""

from __future__ import annotations

import io
import math
import unicodedata
from typing import TYPE_CHECKING

import numpy as np

from kalscope.common.array import Array
from kalscope.export.report.page import y_range

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageFont import FreeTypeFont, ImageFont

    from kalscope.export.report.content import Curves, Report, Table

SIZE = (1654, 2339)
"""Width and height of A4 at 200 dots an inch, px."""

MARGIN = 90
"""Left and right, px."""

INK, QUIET, EDGE, RAW, FILTERED, TRUTH = "#1b1f24", "#57606a", "#dfe3e8", "#8a939d", "#D55E00", "#0072B2"

_LETTERS = str.maketrans(
    {"−": "-", "∞": "inf", "…": "...", "→": "->", "²": "^2", "×": "x", "σ": "sigma", "α": "alpha", "β": "beta"}
    | {"λ": "lambda", "Ω": "Ohm", "µ": "u", "μ": "u", "√": "sqrt ", "·": "*", "Δ": "d", "–": "-", "’": "'"}
)
"""What the built-in font lacks, and what stands in for it."""


def as_png(report: Report) -> bytes:
    """The page as PNG, 200 dots an inch; what does not fit on the sheet is left out from the end of a text."""
    from PIL import Image

    image = Image.new("RGB", SIZE, "#ffffff")
    _Sheet(image).draw(report)
    out = io.BytesIO()
    image.save(out, "PNG", dpi=(200, 200), optimize=True)
    return out.getvalue()


class _Sheet:
    """A pen that goes down the page."""

    def __init__(self, image: Image) -> None:
        from PIL import ImageDraw

        self._pen = ImageDraw.Draw(image)
        self._y = 70

    def draw(self, report: Report) -> None:
        """Everything, from the top."""
        right = SIZE[0] - MARGIN
        self._line(report.title, 38, INK)
        self._line(report.subtitle, 24, QUIET)
        self._legend(report.charts[0].truth is not None)
        height = 640 if len(report.charts) == 1 else 400
        for curves in report.charts:
            self._chart(curves, (MARGIN, self._y, right, self._y + height))
        self._tables(report.tables)
        for head, text in report.texts:
            self._line(head, 25, INK)
            self._paragraph(text, 22, right - MARGIN)
        self._line("To open this again", 25, INK)
        self._paragraph(report.command, 22, right - MARGIN)
        self._y += 6
        for name, value in report.origin:
            self._write(MARGIN, self._y, name, 19, QUIET)
            self._write(MARGIN + 150, self._y, value, 19, INK, right - MARGIN - 150)
            self._y += 26

    def _line(self, text: str, size: int, colour: str) -> None:
        self._write(MARGIN, self._y, text, size, colour, SIZE[0] - 2 * MARGIN)
        self._y += round(1.38 * size)

    def _paragraph(self, text: str, size: int, width: float) -> None:
        for line in _wrapped(_printable(text), _font(size), width):
            self._write(MARGIN, self._y, line, size, INK)
            self._y += round(1.3 * size)
        self._y += 14

    def _legend(self, truth: bool) -> None:
        x = MARGIN + 110.0
        entries = [("raw", RAW), ("filtered", FILTERED), *([("truth", TRUTH)] if truth else [])]
        for name, colour in entries:
            self._pen.line([(x, self._y + 20), (x + 50, self._y + 20)], fill=colour, width=5)
            self._write(x + 62, self._y + 6, name, 22, INK)
            x += 110 + _font(22).getlength(name)
        self._y += 40

    def _chart(self, curves: Curves, box: tuple[int, int, int, int]) -> None:
        left, top, right, bottom = box[0] + 110, box[1] + 38, box[2] - 10, box[3] - 74
        low, high = y_range(curves)
        first, last = float(curves.x[0]), float(curves.x[-1])
        last = last if last > first else first + 1.0
        self._write(left, box[1] + 2, curves.title, 22, INK)

        def across(x: Array) -> Array:
            return left + (x - first) / (last - first) * (right - left)

        def up(y: Array) -> Array:
            return bottom - (y - low) / (high - low) * (bottom - top)

        for value, text in _ticks(low, high, 5):
            at = float(up(np.array(value)))
            self._pen.line([(left, at), (right, at)], fill=EDGE, width=1)
            self._write(left - 12, at - 13, text, 20, INK, anchor="ra")
        for value, text in _ticks(first, last, 9):
            at = float(across(np.array(value)))
            self._pen.line([(at, top), (at, bottom)], fill=EDGE, width=1)
            self._write(at, bottom + 8, text, 20, INK, anchor="ma")
        self._write((left + right) / 2, bottom + 34, f"{curves.x_label};  {curves.y_label}", 20, QUIET, anchor="ma")
        lines = [(curves.raw, RAW, 2), (curves.truth, TRUTH, 3), (curves.filtered, FILTERED, 4)]
        for y, colour, width in lines:
            if y is not None:
                self._curve(across(curves.x), np.where((y < low) | (y > high), np.nan, up(y)), colour, width)
        self._y = box[3]

    def _curve(self, x: Array, y: Array, colour: str, width: int) -> None:
        """A line, interrupted where y is NaN."""
        good = np.isfinite(y)
        breaks = np.flatnonzero(np.diff(good.astype(np.int8))) + 1
        for piece in np.split(np.arange(len(x)), breaks):
            if len(piece) > 1 and good[piece[0]]:
                points = list(zip(x[piece].tolist(), y[piece].tolist(), strict=True))
                self._pen.line(points, fill=colour, width=width, joint="curve")

    def _tables(self, tables: tuple[Table, ...]) -> None:
        """Two beside each other."""
        width = (SIZE[0] - 2 * MARGIN - 60) / 2
        shown = [table for table in tables if table.rows]
        for pair in (shown[:2], shown[2:4]):
            ends = [self._table(table, MARGIN + i * (width + 60), width) for i, table in enumerate(pair)]
            self._y = max(ends, default=self._y) + 16

    def _table(self, table: Table, x: float, width: float) -> int:
        """The first column takes half of the room, the others share the rest."""
        self._write(x, self._y, table.heading, 25, INK)
        y = self._y + 36
        for row in (*((table.columns,) if table.columns else ()), *table.rows):
            self._write(x, y, row[0], 20, QUIET, 0.48 * width)
            share = 0.52 * width / (len(row) - 1)
            for i, value in enumerate(row[:0:-1]):
                ink = QUIET if row is table.columns else INK
                self._write(x + width - i * share, y, value, 20, ink, share - 8, anchor="ra")
            self._pen.line([(x, y + 27), (x + width, y + 27)], fill=EDGE, width=1)
            y += 31
        return y

    def _write(
        self, x: float, y: float, text: str, size: int, colour: str, room: float = math.inf, anchor: str = "la"
    ) -> None:
        self._pen.text(
            (x, y), _cut(_printable(text), _font(size), room), fill=colour, font=_font(size), anchor=anchor
        )


def _font(size: int) -> FreeTypeFont | ImageFont:
    from PIL import ImageFont

    return ImageFont.load_default(size=size)


def _printable(text: str) -> str:
    """One line in the letters that the built-in font has: accents dropped, a question mark for the rest."""
    plain = (c for c in unicodedata.normalize("NFKD", text.translate(_LETTERS)) if not unicodedata.combining(c))
    letters = (c if c.isascii() or c in "±°«»" else "?" for c in plain)
    return " ".join("".join(c if c.isprintable() else " " for c in letters).split())


def _cut(text: str, font: FreeTypeFont | ImageFont, room: float) -> str:
    while len(text) > 1 and font.getlength(text) > room:
        text = text[:-4].rstrip() + "..."
    return text


def _wrapped(text: str, font: FreeTypeFont | ImageFont, width: float) -> list[str]:
    """Lines no longer than `width` px; a word that is longer is cut into pieces."""
    lines, line = [], ""
    for word in text.split(" "):
        rest = word
        while font.getlength(f"{line} {rest}".strip()) > width:
            if line:
                lines.append(line)
                line = ""
                continue
            size = next(i for i in range(len(rest), 0, -1) if i == 1 or font.getlength(rest[:i]) <= width)
            lines.append(rest[:size])
            rest = rest[size:]
        line = f"{line} {rest}".strip()
    return [*lines, line] if line else lines


def _ticks(low: float, high: float, about: int) -> list[tuple[float, str]]:
    """Round values between two ends, and how they are written."""
    rough = (high - low) / about
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * f for f in (1.0, 2.0, 5.0, 10.0) if power * f >= rough * (1 - 1e-9))
    numbers = range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
    return [(i * step, f"{i * step:.6g}") for i in numbers]
