"""The marks that a spreadsheet, or the computer's country, puts in place of "," and ".".

An oscilloscope's file that was saved again, or that a German computer wrote, has ";" between its cells and decimal
commas. Its first lines are put back, so that the rule of an instrument knows one form.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from kalscope.sources.grammar.cells import is_number
from kalscope.sources.instruments.metadata import KEPT_COMMA, MAX_LINES
from kalscope.sources.instruments.preface import Preface

_LOOKED_AT = 40
_MIN_SHARE = 0.6
"""Above this share of the lines; the text above an ActiGraph's table has no delimiter."""
_MAX_CELLS = 50


@dataclass(frozen=True)
class Dialect:
    """The marks of one file."""

    delimiter: str = ","
    """Between the cells."""
    decimal: str = "."
    """Decimal mark; "" where no number among the first lines has one."""

    def plain(self, head: Sequence[str]) -> list[str]:
        """The first lines as they are written with "," and "."; each line keeps its number."""
        lines = list(head[:MAX_LINES])
        if self.delimiter == ",":
            return lines
        comma = "." if self.decimal == "," else KEPT_COMMA
        return [line.replace(",", comma).replace(self.delimiter, ",") for line in lines]

    def restored(self, preface: Preface) -> Preface:
        """The preface of those lines with the marks of the file."""
        if self.delimiter == ",":
            return preface
        return replace(
            preface,
            delimiter=preface.delimiter and self.delimiter,
            decimal=(preface.decimal and self.decimal) or None,
            names=tuple(name.replace(KEPT_COMMA, ",") for name in preface.names),
            units=tuple(unit.replace(KEPT_COMMA, ",") for unit in preface.units),
            notes=tuple(note.replace(KEPT_COMMA, ",") for note in preface.notes),
        )


def dialect_of(head: Sequence[str]) -> Dialect:
    """The dialect of the first lines: ";" or a tab on nearly each, with decimal commas or without."""
    lines = [line for line in head[:_LOOKED_AT] if line.strip()]
    for delimiter in (";", "\t"):
        marked = [line for line in lines if delimiter in line]
        # The text above the table has other marks: the second half counts as well.
        below = lines[len(lines) // 2 :]
        if marked and any(_share(part, delimiter) >= _MIN_SHARE for part in (lines, below)):
            return Dialect(delimiter, _decimal_of(line.split(delimiter) for line in marked))
    return Dialect()


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
