"""What an instrument writes above its table: cells, numbers, units, and what its rules say about the table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from kalscope.sources.grammar.cells import is_number, parse_number, split_fields

# The lines above a table: their cells, the numbers and units in them, the first row of samples.
#
# Pure functions on the first lines of a file. Every loop ends after MAX_LINES lines, and every step over a line is
# linear in its length.


Cells = tuple[str, ...]

KEPT_COMMA = "\x1f"
"""A comma that is part of a text, where "," stands for the delimiter of a file (`dialect`)."""

MIN_PERIOD = 1e-15
"""Shortest period in s, and the inverse of the longest; any other is damage."""

MAX_LINES = 200
"""The table of a known instrument begins within this many lines."""


def cells_of(line: str) -> Cells:
    """Cells of a line, without blanks, quotes, and the empty cells at its end."""
    cells = split_fields(line, ",")
    while cells and not cells[-1]:
        cells.pop()
    return tuple(cells)


def table_rows(head: Sequence[str]) -> list[Cells]:
    """Cells of the first MAX_LINES lines."""
    return [cells_of(line) for line in head[:MAX_LINES]]


def is_sample(cells: Cells) -> bool:
    """True for a row of numbers; those after the first may be missing."""
    return bool(cells) and is_number(cells[0]) and all(not cell or is_number(cell) for cell in cells)


def first_stamp(rows: Sequence[Cells], after: int) -> int | None:
    """Index of the first row that begins with a number, whatever follows ("∞", 0x00); None where there is none."""
    return next((i for i in range(after, len(rows)) if is_sample(rows[i][:1])), None)


def index_of(rows: Sequence[Cells], *firsts: str) -> int | None:
    """Index of the first row whose first cell is one of `firsts`, in lower case; None where there is none."""
    return next((i for i, cells in enumerate(rows) if cells and cells[0].lower() in firsts), None)


def positive(text: str) -> float | None:
    """The positive number that a cell holds, of the size of a period or rate; None for any other cell ("Inf")."""
    value = parse_number(text.strip())
    return value if value is not None and MIN_PERIOD <= value <= 1 / MIN_PERIOD else None


def in_words(period: float) -> str:
    """A period as a report writes it: "8 µs"."""
    period = float(f"{period:.6g}")
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9)):
        if period >= size:
            return f"{period / size:.6g} {unit}"
    return f"{period / 1e-12:.6g} ps"


# What an instrument's own rules say about a table of text.


@dataclass(frozen=True)
class Preface:
    """What the lines above or beside a table say about it; None and () where they say nothing."""

    instrument: str
    """What wrote the file, as a report names it: "Rigol oscilloscope"; "" where only its text is understood."""
    delimiter: str | None = None
    """Delimiter of the table."""
    decimal: str | None = None
    """Decimal mark."""
    header_row: int | None = None
    """Line number, from 1, of the row of names; 0 where there is none. `names` takes precedence over it."""
    unit_row: int | None = None
    """Line number, from 1, of the row of units; 0 where there is none. `units` takes precedence over it."""
    first_row: int | None = None
    """Line number, from 1, of the first row of the table."""
    names: tuple[str, ...] = ()
    """Name of each column of the table, without an empty one at its end; "" where one has none."""
    units: tuple[str, ...] = ()
    """Unit of each column, "" where it has none; as many as `names`."""
    left_out: frozenset[int] = frozenset()
    """Columns, from 0, that hold no samples: metadata beside the data, a counter, a second form of the stamp."""
    time_column: int | None = None
    """Column, from 0, of the time; -1 where the table has none."""
    time_unit: str | None = None
    """Unit of the time column, a key of SECONDS_PER_UNIT."""
    period: float | None = None
    """Sample period in s."""
    start: float | None = None
    """What second 0 of the stamps is, or the first sample where there are none, in s since 1970 (UTC where no zone
    is given)."""
    offset: float | None = None
    """Stamp of the first sample in s, where the table has no time column: an oscilloscope counts from its
    trigger."""
    notes: tuple[str, ...] = ()
    """What else was understood, each a sentence for the report."""


@dataclass(frozen=True)
class TablePreface(Preface):
    """The same for a comma-separated table with decimal points, without rows of names and units.

    Rules see every file in this form: `preface.py` restores the marks of the file.
    """

    delimiter: str | None = ","
    decimal: str | None = "."
    header_row: int | None = 0
    unit_row: int | None = 0


# The first lines of a file in one form, so that the rule of an instrument handles only one.
#
# A file that a spreadsheet saved again, that a German computer wrote, or that a script copied, has ";" or tabs
# as delimiters, decimal commas, quotes around all of them, blank lines, or a line `sep=;` above.


_MAX_LENGTH = 1 << 14
"""No instrument writes a longer line above its samples; so wide a table is not an instrument's."""
_LOOKED_AT = 40
_MIN_SHARE = 0.6
"""Least share of lines with the delimiter; text above a table has no delimiter."""
_MAX_BLANK = 0.4
"""Above this share, blank lines are not the instrument's own: line ends were doubled, for instance."""
_MAX_CELLS = 50
_TOLD = {",": ",", ";": ";", "\t": "\t", "\\t": "\t", "|": "|"}


@dataclass(frozen=True)
class PlainHead:
    """The first lines of a file, as they are written with "," and ".", without quotes."""

    lines: tuple[str, ...]
    """Without the lines `sep=` and blank ones above the first text."""
    numbers: tuple[int, ...]
    """Line number in the file, from 1, of each."""
    delimiter: str
    """Delimiter in the file."""
    decimal: str
    """Decimal mark in the file; "" where no number among these lines has one."""
    told: str | None
    """The delimiter that a line `sep=` names; None where there is none."""

    def restored(self, preface: Preface) -> Preface:
        """What was found in these lines, with the marks and line numbers of the file."""
        own = self.delimiter == ","
        return replace(
            preface,
            delimiter=(preface.delimiter and self.delimiter) or self.told,
            decimal=preface.decimal if own else (preface.decimal and self.decimal) or None,
            header_row=self._number(preface.header_row),
            unit_row=self._number(preface.unit_row),
            first_row=self._number(preface.first_row),
            names=tuple(_with_commas(name) for name in preface.names),
            units=tuple(_with_commas(unit) for unit in preface.units),
            notes=tuple(_with_commas(note) for note in preface.notes),
        )

    def _number(self, row: int | None) -> int | None:
        if not row or row <= len(self.numbers):
            return self.numbers[row - 1] if row else row
        return self.numbers[-1] + row - len(self.numbers)  # a table that has no rows yet


def plain_head(head: Sequence[str]) -> PlainHead:
    """The first MAX_LINES lines in one form."""
    kept = [(i, line[:_MAX_LENGTH]) for i, line in enumerate(head[:MAX_LINES], 1)]
    if kept:
        kept[0] = (1, kept[0][1].removeprefix("\ufeff"))
    told = told_delimiter(kept[0][1]) if kept else None
    kept = kept[1:] if told else kept
    blank = sum(not line.strip() for _, line in kept)
    if blank > _MAX_BLANK * len(kept):
        kept = [(i, line) for i, line in kept if line.strip()]
    while kept and not kept[0][1].strip():
        kept = kept[1:]
    delimiter, decimal = _marks([line for _, line in kept])
    lines = tuple(_plain(line, delimiter, decimal) for _, line in kept)
    return PlainHead(lines, tuple(i for i, _ in kept), delimiter, decimal, told)


def told_delimiter(line: str) -> str | None:
    """The delimiter that a first line `sep=;` tells a spreadsheet; None for any other line."""
    text = line.strip(' "\r').lower() if len(line) < 12 else ""
    return _TOLD.get(text[4:]) if text.startswith("sep=") else None


def _plain(line: str, delimiter: str, decimal: str) -> str:
    comma = "." if decimal == "," else KEPT_COMMA
    if "{" in line:  # JSON, whose quotes and commas are its own
        return line.replace(",", KEPT_COMMA)
    cells = [cell.replace(",", comma) for cell in split_fields(line, delimiter)]
    while cells and not cells[-1]:
        cells.pop()
    return ",".join(cells)


def _with_commas(text: str) -> str:
    return text.replace(KEPT_COMMA, ",")


def _marks(lines: Sequence[str]) -> tuple[str, str]:
    """(delimiter, decimal mark): ";" or a tab on most lines, with decimal commas or without; else "," and "."."""
    looked = [line for line in lines[:_LOOKED_AT] if line.strip()]
    for delimiter in (";", "\t"):
        marked = [line for line in looked if delimiter in line]
        # The text above the table has other marks: the second half counts as well.
        below = looked[len(looked) // 2 :]
        if marked and any(_share(part, delimiter) >= _MIN_SHARE for part in (looked, below)):
            return delimiter, _decimal_of(line.split(delimiter) for line in marked)
    return ",", "."


def _share(lines: Sequence[str], delimiter: str) -> float:
    return sum(delimiter in line for line in lines) / len(lines)


def _decimal_of(rows: Iterable[Sequence[str]]) -> str:
    """The mark that more numbers are written with; "" where none has one."""
    count = {".": 0, ",": 0}
    for row in rows:
        for cell in row[:_MAX_CELLS]:
            for mark in count:
                count[mark] += mark in cell and is_number(cell.strip(' "'), mark)
    return max(count, key=lambda mark: count[mark]) if any(count.values()) else ""
