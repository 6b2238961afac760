"""The first lines of a file in one form, so that the rule of an instrument handles only one.

A file that a spreadsheet saved again, that a German computer wrote, or that a script copied, has ";" or tabs
as delimiters, decimal commas, quotes around all of them, blank lines, or a line `sep=;` above.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from kalscope.sources.grammar.cells import is_number, split_fields
from kalscope.sources.instruments.metadata import KEPT_COMMA, MAX_LINES
from kalscope.sources.instruments.preface import Preface

_MAX_LENGTH = 1 << 14
"""No instrument writes a longer line above its samples; so wide a table is not an instrument's."""
_LOOKED_AT = 40
_MIN_SHARE = 0.6
"""Least share of lines with the delimiter; the text above an ActiGraph's table has no delimiter."""
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
