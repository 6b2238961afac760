"""Names and units of the columns: from header and units rows, comments, or a row of numeric codes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from kalscope.sources.grammar.cells import (
    COMMENT_MARKS,
    are_units,
    bare_unit,
    is_comment,
    is_number,
    is_unit,
    parse_number,
    split_fields,
    words,
)
from kalscope.sources.grammar.read_options import DELIMITERS
from kalscope.sources.reading.columns import COUNTING_NAMES, CellKinds, Cells, Column, Plan, named_column
from kalscope.sources.reading.table import Body, HeadTable, header_cells

_COMMENT_NAME_LENGTH, _COMMENT_NAME_WORDS = 40, 3
_MIN_CODE_ROWS = 20
_MAX_HEADER_PLACE, _MAX_HEADER_LENGTH, _MAX_NAME_LINES = 50, 4000, 12
"""Lines of the head that are looked at for names that break, their length, and lines of one header."""

_SETTING = re.compile(r'[#%*; \t"]*+([A-Za-z][^:=,;|\t"]{0,60}+)"?[ \t]*(?::=|[:=,;|\t])[ \t]*+(\S.*)')
_PROCESSING = words("raw cal uncal avg mean smp sample tot total min max std med first last")
_NAMES = re.compile(r"((?:channel|column|field|signal|sensor)s? )?(?:labels|columns|channels|fields|names|header)")
_LAST_NAMES, _LAST_UNITS = ("source", "channel data"), ("vertical units",)
"""Settings of oscilloscopes that give the names and units of the last columns: `Source,CH2`, `Vertical Units,V`."""

Row = tuple[int, Cells]


@dataclass(frozen=True)
class Header:
    """What is above the data."""

    columns: tuple[Column, ...]
    """One per field of a data line, with name and unit where the file says them."""
    rows: tuple[Row, ...]
    """(line number, cells) of header and units rows, nearest to the data first."""
    first: int
    """Line number of the first data line."""
    notes: tuple[str, ...]
    """What was decided, each a sentence."""


@dataclass(frozen=True)
class _Rows:
    """Which lines hold the names and the units."""

    names: Row | None = None
    units: Row | None = None
    others: tuple[Row, ...] = ()
    first: int = 0
    said: str = ""
    """Where the names are from, where that is no row above the data."""

    @property
    def note(self) -> str:
        """The sentence about the names and the units."""
        said = self.said or (f"names from line {self.names[0]}" if self.names else "no header line")
        return f"{said}, units from line {self.units[0]}" if self.names and self.units else said


def settings_of(head: Sequence[str], first: int) -> dict[str, str]:
    """What lines above line `first`, and those beside the first rows, say: {"source": "CH2", "unit volume": "m3"}.

    The key is in lower case. The lines are `# Labels:= ECG;EDA`, `Vertical Units,V`, `# name 0 = timeS: Time [s]`.
    """
    found: dict[str, str] = {}
    for line in head[: max(_MAX_HEADER_PLACE, first - 1)]:
        match = _SETTING.fullmatch(line) if len(line) <= _MAX_HEADER_LENGTH else None
        if match:
            found.setdefault(match[1].strip().lower(), match[2].strip())
    return found


def _listed(settings: dict[str, str], table: HeadTable, body: Body) -> tuple[Cells, Cells]:
    """Names and units that lines above a table or beside it list, or give one by one."""
    width, filled = table.width, [i for i, kind in enumerate(body.types) if kind.kind != "empty"]
    names = tuple(settings.get(f"name {i}") or settings.get(f"column {i}", "") for i in range(width))
    found: dict[bool, Cells] = {False: names} if width > 1 and all(names) else {}
    for key, value in settings.items():
        cells = tuple(cell.strip(" \t\"'[]") for cell in re.split(r"[;,\t|]", value))
        said = tuple(cell for cell in cells if cell and not is_number(cell, table.form.decimal))
        is_list = width > 1 and len(said) == len(cells) == width
        if is_list and (_NAMES.fullmatch(key) or key.endswith("units")):
            found.setdefault(key.endswith("units"), cells)
        if key in (*_LAST_NAMES, *_LAST_UNITS) and 0 < len(said) < max(2, len(filled)):
            at = dict(zip(filled[-len(said) :], said, strict=True))
            found.setdefault(key in _LAST_UNITS, tuple(at.get(i, "") for i in range(width)))
    return found.get(False, ()), found.get(True, ())


def join_quoted(head: Sequence[str]) -> list[str]:
    """The lines, with quoted names that span lines joined into the last of them, and those above left empty.

    Spreadsheets write such names. A stray quote in a row of data joins nothing: all cells must be names.
    """
    lines = list(head)
    odd = [
        i
        for i, line in enumerate(lines[: _MAX_HEADER_PLACE + _MAX_NAME_LINES])
        if line.count('"') % 2 and len(line) <= _MAX_HEADER_LENGTH
    ]
    for first, last in zip(odd[::2], odd[1::2], strict=False):
        joined = " ".join(part.strip() for part in lines[first : last + 1] if part)
        ways = (split_fields(joined, mark) for mark in DELIMITERS if mark != " ")
        if last - first <= _MAX_NAME_LINES and any(
            len(cells) > 1 and not any('"' in cell[:1] or is_number(cell) for cell in cells) for cells in ways
        ):
            lines[first : last + 1] = [""] * (last - first) + [joined]
    return lines


def read_header(
    head: Sequence[str], settings: dict[str, str], table: HeadTable, body: Body, plan: Plan, kinds: CellKinds
) -> Header:
    """Find the names and units of a table's columns."""
    found, preface = _chosen(head, table, body, plan) or _find(head, table, body, plan, kinds), plan.preface
    listed, listed_units = _listed(settings, table, body)
    names, notes, columns = preface.names or listed, [found.note], [Column("")] * table.width
    if preface.names:
        notes = []
    elif found.names is not None:
        columns, more = _named(found.names, table, body)
        notes += more
    elif names:
        notes = ["names from the lines above the table"]
    units = preface.units or (found.units[1] if found.units is not None else listed_units)
    named = {i: named_column(name) for i, name in enumerate(names) if name}
    known = {columns[i].name for i in named}
    for i, column in named.items() if known == {""} or len(known) < min(2, len(named)) else ():
        columns[i] = replace(column, unit=column.unit or columns[i].unit)
    for i, unit in enumerate(units[: table.width]):
        columns[i] = replace(columns[i], unit=bare_unit(unit)) if unit else columns[i]
    rows = tuple(row for row in (found.units, *found.others, found.names) if row is not None)
    return Header(tuple(columns), tuple(sorted(rows, reverse=True)), found.first or body.first, tuple(notes))


def _row(head: Sequence[str], number: int | None, table: HeadTable) -> Row | None:
    if not number or number > len(head):
        return None
    text = head[number - 1]
    text = text.strip(" \t").lstrip("#%/").strip() if is_comment(text) else text
    return number, header_cells(text, table.form.delimiter, table.width)


def _chosen(head: Sequence[str], table: HeadTable, body: Body, plan: Plan) -> _Rows | None:
    """The rows that the user or the instrument's rules name; None where they leave it open."""
    if plan.preface.header_row is None:
        return None
    names, units = _row(head, plan.preface.header_row, table), _row(head, plan.preface.unit_row, table)
    if names is None:
        return _Rows(None, units)
    if plan.preface.unit_row is None:
        below = [above for above in reversed(body.above) if above[0] > names[0]]
        units = next((above for above in below if are_units(above[1])), None)
    return _Rows(names, units)


def _find(head: Sequence[str], table: HeadTable, body: Body, plan: Plan, kinds: CellKinds) -> _Rows:
    """The rows of names and units as the lines themselves show them: units are below the names."""
    above = list(body.above)
    commented = None if plan.options.header else _commented_header(head, table, body, kinds)
    if commented is not None and (not above or (len(above) == 1 and commented[0] == above[0][0] - 1)):
        units = next((row for row in above if are_units(row[1])), None)
        if units or not above:
            return _Rows(commented, units, said=f"names from comment line {commented[0]}")
    if not above:
        if (plan.options.header or _is_code_row(table, body)) and len(body.rows) > 1:
            said = f"names from line {body.rows[0][0]}"
            said += "" if plan.options.header else ", codes unlike all numbers below"
            return _Rows(body.rows[0], first=body.rows[1][0], said=said)
        return _Rows()
    if len(above) == 1 and all(is_unit(cell) and len(cell) > 2 for cell in above[0][1]):
        numbered = _row(head, above[0][0] - 1, table)  # `x-axis,1,2` above `second,Volt,Volt`
        if numbered and len(numbered[1]) == len(above[0][1]) and not is_number(numbered[1][0]) and all(numbered[1]):
            above.append(numbered)
    place = next((i for i, (_, cells) in enumerate(above[:-1]) if are_units(cells)), -1)
    # `Unix,CAL,CAL` above the units only says what was done to each column.
    said = [{cell.lower() for cell in cells} for _, cells in above]
    names = next(
        (i for i in range(place + 1, len(above)) if 2 * len(said[i] & _PROCESSING) < len(said[i])), place + 1
    )
    units = above[place] if place >= 0 else None
    if plan.preface.unit_row is not None:
        units = _row(head, plan.preface.unit_row, table)
    return _Rows(above[names], units, tuple(row for i, row in enumerate(above[:names]) if i != place))


def _named(row: Row, table: HeadTable, body: Body) -> tuple[list[Column], list[str]]:
    """The columns by their names; rows may be wider by row names, a trailing separator or unnamed columns."""
    (number, cells), width = row, table.width
    trailing = 0
    while len(cells) + trailing < width and body.types[width - 1 - trailing].kind == "empty":
        trailing += 1
    more = width - trailing - len(cells)
    notes = [f"line {number} holds {len(cells)} names for {width - trailing} columns"]
    if more <= 0:
        names = (*cells, *[""] * trailing)[:width]
        return list(map(named_column, names)), notes if any(cells[width:]) else []
    if len(cells) == width - 1 and _are_row_names(cells[0], body):
        return [Column("", role="row name"), *map(named_column, cells)], notes
    names = (*cells, *[cells[-1] if more > 1 else ""] * more, *[""] * trailing)
    return list(map(named_column, names)), notes


def _are_row_names(first: str, body: Body) -> bool:
    """True where the first column holds texts or counts the rows, as R writes them without a name of their own."""
    cells = [cells[0] for _, cells in body.rows]
    if first.lower() in COUNTING_NAMES or not all(cell.isascii() and cell.isdecimal() for cell in cells):
        return first.lower() not in COUNTING_NAMES and body.types[0].kind == "text"
    return sum(float(b) - float(a) == 1 for a, b in pairwise(cells)) >= 0.9 * (len(cells) - 1)


def _commented_header(head: Sequence[str], table: HeadTable, body: Body, kinds: CellKinds) -> Row | None:
    """The last comment above the data where it is a list of names, as `# time ax ay` of numpy.savetxt."""
    for number in range(body.first - 1, 0, -1):
        text = head[number - 1]
        if is_comment(text):
            names = _commented_cells(text, table.form.delimiter, table.width)
            full = len(names) <= table.width and all(kind.kind == "empty" for kind in body.types[len(names) :])
            listed = full and table.width > 1 and all(_is_name(name, table.form.delimiter) for name in names)
            numeric = any(kinds[name] in ("number", "stamp", "missing") for name in names)
            return (number, names) if listed and not numeric else None
    return None


def _commented_cells(text: str, delimiter: str, width: int) -> Cells:
    """The cells of a comment line, without empty ones at its end; in `#,level,flow` the mark is a name itself."""
    cells = tuple(split_fields(text.strip(" "), delimiter)) if delimiter != " " else ()
    if len(cells) < 2 or cells[0] not in COMMENT_MARKS:
        cells = header_cells(text.strip(" \t").lstrip("#%/").strip(), delimiter, width)
    while len(cells) > 1 and not cells[-1]:
        cells = cells[:-1]
    return cells


def _is_name(text: str, delimiter: str) -> bool:
    """A few words, perhaps with their unit in brackets or after a comma: not a sentence."""
    bare = text.partition("[")[0].partition("(")[0].strip()
    short = 0 < len(bare) <= _COMMENT_NAME_LENGTH and len(bare.split()) <= _COMMENT_NAME_WORDS
    marks = "\t;|" if delimiter in "\t;|" else "\t,;|"
    return short and not bare.endswith(":") and not any(mark in bare for mark in marks)


def _is_code_row(table: HeadTable, body: Body) -> bool:
    """True where the first row can only be codes: `94255 2018 1000 0 2010 …` above fractions of another size.

    The first sample must never be lost. Three columns at least must hold a whole number five times larger
    than anything below, one of them above nothing but fractions.
    """
    decimal = table.form.decimal
    codes, rows = body.rows[0][1], [cells for _, cells in body.rows[1:]]
    if len(rows) < _MIN_CODE_ROWS or not all(is_number(cell) and cell.isdecimal() for cell in codes):
        return False
    sizes = [[abs(parse_number(row[i], decimal) or 0.0) for row in rows] for i in range(len(codes))]
    unlike = [i for i, code in enumerate(codes) if float(code) > 5 * max(*sizes[i], 1.0)]
    return len(unlike) >= 3 and any(all(decimal in row[i] for row in rows) for i in unlike)
