"""Names and units of the columns: from header and units rows, comments, or a row of numeric codes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from kalscope.sources.grammar.cells import MISSING, is_comment, is_number, parse_number, split_fields
from kalscope.sources.grammar.line_format import LineFormat
from kalscope.sources.layout.columns import Cells, Column, are_units, bare_unit, named_column
from kalscope.sources.layout.tables import HeadLine, HeadTable, are_names

_COMMENT_NAME_LENGTH = 40
_MARKS = {"\t": "tabs", " ": "blanks"}


@dataclass(frozen=True)
class Header:
    """What is above the data."""

    columns: tuple[Column, ...]
    """One per field of a data line, with name and unit where the file says them."""
    rows: tuple[tuple[int, Cells], ...]
    """(line number, cells) of header and units rows, nearest to the data first."""
    first: int
    """Line number of the first data line."""
    notes: tuple[str, ...]
    """What was decided, each a sentence."""


def read_header(head: Sequence[str], lines: list[HeadLine], table: HeadTable, wanted: bool | None) -> Header:
    """Find the names of a table's columns; `wanted` is `ReadOptions.header`."""
    form, width = table.form, table.width
    first = _first_row(lines, table)
    if wanted is False:
        return Header(_unnamed(width), (), first, (table_note(form), "no header line, as requested"))
    above = [line for line in lines if line.number < first]
    rows = [(line.number, tuple(split_fields(line.text, form.delimiter))) for line in reversed(above[-2:])]
    fits = [are_names(cells, table.rows[0][1], form.decimal) and _names_fit(cells, width) for _, cells in rows]
    if fits == [True, True] and len(rows[0][1]) == width and are_units(rows[0][1]):
        return _with_units(rows, table, first)
    if fits and fits[0]:
        return _named(rows[0], table, first)
    if wanted is None:
        commented = _commented_header(head, table, first)
        if commented is not None:
            said = (table_note(form), f"names from comment line {commented[0]}")
            return Header(_columns(commented[1], width), (commented,), first, said)
    if (wanted or _is_code_row(table)) and len(table.rows) > 1:
        after = table.rows[1][0]
        said = f"names from line {table.rows[0][0]}" + ("" if wanted else ", codes unlike all numbers below")
        return Header(_columns(table.rows[0][1], width), (table.rows[0],), after, (table_note(form), said))
    return Header(_unnamed(width), (), first, (table_note(form), "no header line"))


def table_note(form: LineFormat) -> str:
    """The sentence about delimiter and decimal mark."""
    mark = _MARKS.get(form.delimiter, f'"{form.delimiter}"')
    return f'columns are separated by {mark}, the decimal mark is "{form.decimal}"'


def _first_row(lines: list[HeadLine], table: HeadTable) -> int:
    """Number of the first data line: lines of missing values right above the first numbers belong to it."""
    first = table.rows[0][0]
    for line in reversed([line for line in lines if line.number < first]):
        cells = [cell.lower() for cell in split_fields(line.text, table.form.delimiter)]
        if len(cells) != table.width or not all(cell in MISSING for cell in cells) or not any(cells):
            break
        first = line.number
    return first


def _with_units(rows: list[tuple[int, Cells]], table: HeadTable, first: int) -> Header:
    columns = _columns(rows[1][1], table.width)
    said = tuple(
        replace(column, unit=bare_unit(unit)) if unit else column
        for column, unit in zip(columns, rows[0][1], strict=True)
    )
    note = f"names from line {rows[1][0]}, units from line {rows[0][0]}"
    return Header(said, (rows[0], rows[1]), first, (table_note(table.form), note))


def _named(row: tuple[int, Cells], table: HeadTable, first: int) -> Header:
    number, cells = row
    notes = [table_note(table.form), f"names from line {number}"]
    if len(cells) != table.width:
        notes.append(f"line {number} holds {len(cells)} names for {table.width} columns")
    return Header(_columns(cells, table.width), (row,), first, tuple(notes))


def _names_fit(names: Cells, width: int) -> bool:
    """R writes one name too few (the row names have none); some loggers write more names than values."""
    if width == 1:
        return len(names) == 1 and len(names[0]) <= 40  # a longer single cell is a sentence
    return len(names) == width or (width > 2 and width - 1 <= len(names) <= 2 * width)


def _commented_header(head: Sequence[str], table: HeadTable, first: int) -> tuple[int, Cells] | None:
    """The last comment above the data where it is a list of names, as `# time ax ay` of numpy.savetxt."""
    for number in range(first - 1, 0, -1):
        text = head[number - 1]
        if is_comment(text):
            names = tuple(split_fields(text.strip(" \t").lstrip("#%/").strip(), table.form.delimiter))
            listed = len(names) == table.width > 1 and all(map(_is_name, names))
            named = listed and are_names(names, table.rows[0][1], table.form.decimal)
            return (number, names) if named else None
    return None


def _is_name(text: str) -> bool:
    """A word, with its unit in brackets perhaps: no sentence."""
    bare = text.partition("[")[0].partition("(")[0].strip()
    return 0 < len(bare) <= _COMMENT_NAME_LENGTH and not any(c in bare for c in " \t,;|")


def _is_code_row(table: HeadTable) -> bool:
    """True where the first row can only be codes: `94255 2018 1000 0 2010 …` above fractions of another size.

    The first sample must never be eaten. Three columns at least must hold a whole number five times larger
    than anything below, one of them above nothing but fractions.
    """
    decimal = table.form.decimal
    codes, rows = table.rows[0][1], [cells for _, cells in table.rows[1:]]
    if len(rows) < 20 or not all(is_number(cell) and cell.isdecimal() for cell in codes):
        return False
    unlike, above_fractions = 0, False
    for i, code in enumerate(codes):
        values = [parse_number(row[i], decimal) for row in rows]
        sizes = [abs(value) for value in values if value is not None and not math.isnan(value)]
        if sizes and float(code) > 5 * max(*sizes, 1.0):
            unlike += 1
            above_fractions |= all(decimal in row[i] for row in rows)
    return unlike >= 3 and above_fractions


def _unnamed(width: int) -> tuple[Column, ...]:
    return tuple(Column("") for _ in range(width))


def _columns(names: Cells, width: int) -> tuple[Column, ...]:
    if len(names) == width - 1:
        return (Column("", role="row name"), *(named_column(name) for name in names))
    return tuple(named_column(name) for name in names[:width])
