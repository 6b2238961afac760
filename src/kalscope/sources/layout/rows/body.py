"""Where the table starts, what its columns hold, and what is above and beside it."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Literal

from kalscope.sources.grammar.cells import split_fields
from kalscope.sources.grammar.units import are_units
from kalscope.sources.layout.plan import Plan
from kalscope.sources.layout.rows.beside import find_beside
from kalscope.sources.layout.rows.kinds import CellKinds, Cells, ColumnType, column_type
from kalscope.sources.layout.rows.shapes import HeadLine
from kalscope.sources.layout.rows.tables import HeadTable

MAX_HEADER_LINES = 5
"""Lines of names, units and what was done to each column that may be above a table."""
MAX_REPEATED = 64
"""Rows of one repeated word that may come between the names and the first number."""
_PAIR_LABELS = frozenset(
    """
    sample rate|sampling rate|sample frequency|sampling frequency|sample interval|sample period|sampling interval
    record length|serial number|serial no|serial no.|serial|operator|user|site|station|station name|location|gain
    firmware|firmware version|software version|version|model|model number|device|device id|instrument|manufacturer
    latitude|longitude|elevation|altitude|province|start time|start date|created|comment|comments|title|project
    """.replace("\n", "|")
    .replace("    ", "")
    .strip("|")
    .split("|")
)
"""Labels of the pairs above a table, in lower case."""
_WIDE_GAP = re.compile(r"[ \t]{2,}|\t")
_RULED = frozenset("-=_+|:;, \t")
"""Characters of a ruled line below the names."""
_MAX_NAME = 40
"""A longer single cell above a column of numbers is a sentence."""

Fit = Literal["row", "partial", "void", "text"]
"""All cells of a line suit their columns; some do; all are missing; none does, which is how names look."""


@dataclass(frozen=True)
class Body:
    """The rows of a table, and the lines above it."""

    rows: tuple[tuple[int, Cells], ...]
    """(line number, cells) of the rows of the head that look like data."""
    samples: tuple[tuple[int, Cells], ...]
    """The same from further down the file; their numbers only tell them apart."""
    first: int
    """Line number of the first row."""
    above: tuple[tuple[int, Cells], ...]
    """(line number, cells) of lines of text right above the first row, nearest first."""
    types: tuple[ColumnType, ...]
    """What each column holds."""
    beside: frozenset[int]
    """Columns that are filled in the first rows only: metadata beside the data."""
    narrow: frozenset[int] = frozenset()
    """Widths of rows that lack their last cells."""

    def starting_at(self, first: int) -> Body:
        """The same table without the rows above line `first`."""
        rows = tuple(row for row in self.rows if row[0] >= first)
        return replace(self, rows=rows or self.rows, first=first)

    def column(self, index: int) -> list[str]:
        """The cells of one column: of the head, then of the samples."""
        return [cells[index] for _, cells in self.rows] + [cells[index] for _, cells in self.samples]


def find_body(lines: list[HeadLine], table: HeadTable, plan: Plan, size: int, kinds: CellKinds) -> Body:
    """The rows of a table among the lines of a file.

    Args:
        lines: The lines that may hold data.
        table: How they are split.
        plan: What is decided already.
        size: Lines of the head; those with a larger number come from further down.
        kinds: The kinds of cells by the table's decimal mark.
    """
    least = plan.first_row
    rows = [row for row in table.rows if row[0] >= least] or list(table.rows)
    beside = find_beside(rows, table.width, kinds) | {i for i in plan.preface.left_out if i < table.width}
    types = tuple(column_type([cells[i] for _, cells in rows], kinds) for i in range(table.width))
    if table.form.kind != "table":
        inside = tuple(row for row in rows if row[0] <= size)
        samples = tuple(row for row in rows if row[0] > size)
        return Body(inside or tuple(rows[:1]), samples, rows[0][0], (), types, beside)
    grid = _Grid(lines, table, types, beside, kinds)
    first = grid.first_row(least)
    found, rows = rows, grid.rows_from(first)
    inside = tuple(row for row in rows if row[0] <= size)
    samples = tuple(row for row in rows if row[0] > size)
    if rows != found:
        types = tuple(column_type([cells[i] for _, cells in rows], kinds) for i in range(table.width))
    return Body(inside or table.rows[:1], samples, first, grid.above(first), types, beside, table.narrow)


class _Grid:
    """The lines of a file, each split and compared with the columns of the table."""

    def __init__(
        self,
        lines: list[HeadLine],
        table: HeadTable,
        types: tuple[ColumnType, ...],
        beside: frozenset[int],
        kinds: CellKinds,
    ) -> None:
        self._kinds, self._types, self._beside = kinds, types, beside
        self._table = table
        self._least = _least_width(table, types)
        self._texts = {line.number: line.text for line in lines}
        known = {} if table.narrow else dict(table.rows)
        self._lines = [
            (line.number, known.get(line.number) or tuple(split_fields(line.text, table.form.delimiter)))
            for line in lines
        ]
        self._fits = self._all_fits([line.shape for line in lines])

    def _all_fits(self, shapes: list[str]) -> list[Fit | None]:
        """How each line suits the columns; one of the shape of a whole row is one as well."""
        whole: set[str] = set()
        fits: list[Fit | None] = []
        for (_, cells), shape in zip(self._lines, shapes, strict=True):
            fit: Fit | None = "row" if shape in whole else self._fit(cells)
            fits.append(fit)
            if fit == "row":
                whole.add(shape)
        return fits

    def _fit(self, cells: Cells) -> Fit | None:
        """How a line suits the columns; None where it has too few or too many cells."""
        width = len(cells)
        if not (self._least <= width <= self._table.width or width in self._table.narrow):
            return None
        fitting, said = 0, list[tuple[str, str]]()
        for i, cell in enumerate(cells):
            if i in self._beside:
                continue
            if self._kinds[cell] == self._types[i].kind != "text":
                fitting += 1  # nearly all cells of a log
            else:
                said.append((self._types[i].judge(cell, self._kinds), cell))
        fitting += sum(judged == "fits" for judged, _ in said)
        strange = sum(judged == "strange" for judged, _ in said)
        if fitting:
            return "partial" if strange else "row"
        known = [cell for judged, cell in said if judged == "missing" and cell and self._kinds[cell] != "text"]
        if not strange and known:
            return "void"
        # "-,-,ERR" is a row of missing samples, "t,M" are names.
        return "void" if len(known) > strange else "text"

    def first_row(self, least: int) -> int:
        """Line number of the first row, from line `least` on.

        A line of names below others that are not whole rows begins the table: above it is metadata.
        """
        places = [i for i, (number, _) in enumerate(self._lines) if number >= least]
        best, gained, whole, other = 0, 0, 0, 0
        for i in places:
            if self._fits[i] == "text" and other - 2 * whole > gained and self._is_header(i):
                best, gained = i + 1, other - 2 * whole
            whole += self._fits[i] == "row"
            other += self._fits[i] == "partial"
        places = [i for i in places if i >= best]
        data = [i for i in places if self._fits[i] in ("row", "partial")]
        if not data:
            return self._table.rows[0][0]
        start = data[0]
        if not best:
            start = next((i for i in data if not self._is_label(i)), start)
        while start - 1 in places and (self._fits[start - 1] == "void" or self._repeats(start - 1)):
            start -= 1
        return self._lines[start][0]

    def _repeats(self, place: int) -> bool:
        """True for the second ERR of several below other names: one word that repeats is not a name."""
        cells = self._lines[place][1]
        if self._fits[place] != "text" or len(set(cells)) > 1:
            return False
        above = [other for _, other in self._lines[max(0, place - MAX_REPEATED) : place]]
        below = self._lines[place + 1][1] if place + 1 < len(self._lines) else ()
        is_repeated = cells == below or (bool(above) and above[-1] == cells)
        return is_repeated and any(other != cells and self._may_name(other) for other in above)

    def _is_header(self, place: int) -> bool:
        """True for a line of text with a row right below it."""
        below = self._fits[place + 1 : place + 1 + MAX_HEADER_LINES]
        return "row" in below and len(self._lines[place][1]) >= self._least

    def _is_label(self, place: int) -> bool:
        """True for `Sample rate,100` with no names above it: text where the rows below have a number."""
        if self._fits[place] != "partial":
            return False
        cells = self._lines[place][1]
        if self._types[0].judge(cells[0], self._kinds) != "strange" or not any(c.isalpha() for c in cells[0]):
            return False
        return self._is_pair(cells) or not place or self._fits[place - 1] != "text"

    def _is_pair(self, cells: Cells) -> bool:
        """True for `Sample Rate,100 Hz`: a property of the recording, and its value."""
        label = cells[0].partition("(")[0].partition("[")[0].strip(" :=").lower()
        said = [cell for cell in cells[1:] if cell]
        return label in _PAIR_LABELS and len(said) == 1 and self._types[0].kind in ("number", "stamp")

    def rows_from(self, first: int) -> list[tuple[int, Cells]]:
        """(line number, cells) of the rows from line `first` on, each padded to the width of the table."""
        width = self._table.width
        return [
            line if len(line[1]) == width else (line[0], line[1] + ("",) * (width - len(line[1])))
            for line, fit in zip(self._lines, self._fits, strict=True)
            if line[0] >= first and fit in ("row", "partial", "void")
        ]

    def above(self, first: int) -> tuple[tuple[int, Cells], ...]:
        """(line number, cells) of the lines of text right above the first row that may name its columns."""
        lines = [line for line in self._lines if line[0] < first]
        found: list[tuple[int, Cells]] = []
        for number, _ in reversed(lines[-MAX_HEADER_LINES:]):
            cells = header_cells(self._texts[number], self._table.form.delimiter, self._least)
            if not set(self._texts[number]) - _RULED or (not found and self._is_remark(number, cells)):
                continue
            if not self._may_name(cells):
                break
            found.append((number, cells))
        if found and len(found[0][1]) < self._least:
            alike = sum(len(cells) == len(found[0][1]) for _, cells in lines[-MAX_HEADER_LINES:])
            return () if alike > 1 else tuple(found)  # `Gain;24` above `Site;Barn 7` are pairs, not names
        return tuple(found)

    def _is_remark(self, number: int, cells: Cells) -> bool:
        """True for one word alone below a line that names all columns."""
        width = self._table.width
        if width == 1 or len(cells) != 1 or self._kinds[cells[0]] != "text":
            return False
        above = [text for other, text in self._texts.items() if other < number]
        names = header_cells(above[-1], self._table.form.delimiter, self._least) if above else ()
        return len(names) == width and all(names) and self._may_name(names)

    def _may_name(self, cells: Cells) -> bool:
        """True for text in about as many cells as a row has."""
        width = self._table.width
        if width == 1:
            fits = len(cells) == 1 and len(cells[0]) <= _MAX_NAME
        else:
            # Split at blanks, any sentence has several cells.
            prose = self._table.form.delimiter == " "
            low, high = (self._least - 1, width) if prose else (self._least // 2, 2 * width)
            fits = max(2, low) <= len(cells) <= high and not (prose and cells[-1].endswith((".", ":")))
        return (
            fits
            and any(cells)
            and not self._is_pair(cells)
            and not any(self._kinds[cell] in ("number", "stamp") for cell in cells if cell)
        )


def header_cells(text: str, delimiter: str, width: int) -> Cells:
    """The cells of a line above `width` columns.

    Split at blanks, a unit in brackets belongs to the name before it (`t [us]   torque`), names may hold a blank
    where several separate them, and a row of units may lack that of the time.
    """
    cells = tuple(split_fields(text, delimiter))
    if delimiter != " " or len(cells) == width:
        return cells
    joined: list[str] = []
    for cell in cells:
        if joined and cell and cell[0] in "[(" and cell[-1] in "])":
            joined[-1] += f" {cell}"
        else:
            joined.append(cell)
    wide = tuple(cell.strip() for cell in _WIDE_GAP.split(text.strip()))
    fitting = next((found for found in (tuple(joined), wide) if len(found) == width), cells)
    if len(fitting) < width and are_units(fitting) and text.startswith((" ", "\t")):
        return ("",) * (width - len(fitting)) + fitting
    return fitting


def _least_width(table: HeadTable, types: tuple[ColumnType, ...]) -> int:
    """The fewest cells of a whole row: those after the last column that is ever filled may be left out."""
    width = table.width
    while width > 1 and types[width - 1].kind == "empty":
        width -= 1
    return width
