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
from kalscope.sources.reading.table import Body, HeadTable, Row, header_cells

_COMMENT_NAME_LENGTH, _COMMENT_NAME_WORDS = 40, 3
_MIN_CODE_ROWS = 20
_MAX_HEADER_PLACE, _MAX_HEADER_LENGTH = 50, 4000
"""Lines of the head that are looked at for settings and for names that break, and their length."""

_SETTING = re.compile(r'[#%*; \t"]*+([A-Za-z][^:=,;|\t"]{0,60}+)"?[ \t]*(?::=|[:=,;|\t])[ \t]*+(\S.*)')
_PROCESSING = words("raw cal uncal avg mean smp sample tot total min max std med first last")
_NAMES = re.compile(r"((?:channel|column|field|signal|sensor)s? )?(?:labels|columns|channels|fields|names|header)")
_LAST_NAMES, _LAST_UNITS = ("source", "channel data"), ("vertical units",)
"""Settings of oscilloscopes that give the names and units of the last columns: `Source,CH2`, `Vertical Units,V`."""


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
    likely = enumerate(lines[:_MAX_HEADER_PLACE])
    odd = [i for i, line in likely if line.count('"') % 2 and len(line) <= _MAX_HEADER_LENGTH]
    for first, last in zip(odd[::2], odd[1::2], strict=False):
        joined = " ".join(part.strip() for part in lines[first : last + 1] if part)
        ways = (split_fields(joined, mark) for mark in DELIMITERS if mark != " ")
        if any(len(cells) > 1 and not any(cell[:1] == '"' or is_number(cell) for cell in cells) for cells in ways):
            lines[first : last + 1] = [""] * (last - first) + [joined]
    return lines


def read_header(
    head: Sequence[str], settings: dict[str, str], table: HeadTable, body: Body, plan: Plan, kinds: CellKinds
) -> Header:
    """Find the names and units of a table's columns."""
    above, first = _find(head, table, body, plan, kinds)
    place = next((i for i, (_, cells) in enumerate(above[:-1]) if are_units(cells)), -1)
    # `Unix,CAL,CAL` above the units only says what was done to each column.
    said = [{cell.lower() for cell in cells} for _, cells in above]
    told = (i for i in range(place + 1, len(above)) if 2 * len(said[i] & _PROCESSING) < len(said[i]))
    rows = above[: next(told, place + 1) + 1]
    unit_row = above[place] if place >= 0 else None
    if plan.preface.unit_row is not None:
        unit_row = _row(head, plan.preface.unit_row, table)
    listed, listed_units = _listed(settings, table, body)
    names, notes, columns = plan.preface.names or listed, ["no header line"], [Column("")] * table.width
    if plan.preface.names:
        notes = []
    elif rows:
        columns, notes = _named(rows[-1], table, body)
        notes[0] += f", units from line {unit_row[0]}" if unit_row else ""
    elif names:
        notes = ["names from the lines above the table"]
    units = plan.preface.units or (unit_row[1] if unit_row is not None else listed_units)
    named = {i: named_column(name) for i, name in enumerate(names) if name}
    known = {columns[i].name for i in named}
    for i, column in named.items() if known == {""} or len(known) < min(2, len(named)) else ():
        columns[i] = replace(column, unit=column.unit or columns[i].unit)
    for i, unit in enumerate(units[: table.width]):
        columns[i] = replace(columns[i], unit=bare_unit(unit)) if unit else columns[i]
    distinct = dict([*rows, *([unit_row] if unit_row else [])])
    return Header(tuple(columns), tuple(sorted(distinct.items(), reverse=True)), first, tuple(notes))


def _row(head: Sequence[str], number: int | None, table: HeadTable) -> Row | None:
    """The cells of a line above the table, a comment or not; in `#,level,flow` the mark is a name itself."""
    if not number or number > len(head):
        return None
    text, delimiter = head[number - 1].strip(" \t"), table.form.delimiter
    if is_comment(text) and (delimiter == " " or split_fields(text, delimiter)[0] not in COMMENT_MARKS):
        text = text.lstrip("#%/").strip()
    return number, header_cells(text, delimiter, table.width)


def _find(head: Sequence[str], table: HeadTable, body: Body, plan: Plan, kinds: CellKinds) -> tuple[list[Row], int]:
    """The rows of units, of what was done to each column, and of names, nearest to the data first; the first row.

    What the user or the rules of an instrument choose comes first.
    """
    above, chosen = list(body.above), plan.preface.header_row
    if chosen is not None:
        units = [row for row in above if row[0] > chosen and are_units(row[1]) and plan.preface.unit_row is None]
        names = _row(head, chosen, table)
        return ([*units[-1:], names] if names else []), body.first
    commented = None if plan.options.header else _commented_header(head, table, body, kinds)
    beside = len(above) == 1 and commented is not None and commented[0] == above[0][0] - 1
    if commented is not None and (not above or (beside and are_units(above[0][1]))):
        above.append(commented)
    if not above and (plan.options.header or _is_code_row(table, body)) and len(body.rows) > 1:
        return [body.rows[0]], body.rows[1][0]
    if len(above) == 1 and all(is_unit(cell) and len(cell) > 2 for cell in above[0][1]):
        numbered = _row(head, above[0][0] - 1, table)  # `x-axis,1,2` above `second,Volt,Volt`
        if numbered and len(numbered[1]) == len(above[0][1]) and not is_number(numbered[1][0]) and all(numbered[1]):
            above.append(numbered)
    return above, body.first


def _named(row: Row, table: HeadTable, body: Body) -> tuple[list[Column], list[str]]:
    """The columns by their names; rows may be wider by row names, a trailing separator or unnamed columns."""
    (number, cells), width = row, table.width
    trailing = 0
    while len(cells) + trailing < width and body.types[width - 1 - trailing].kind == "empty":
        trailing += 1
    more = width - trailing - len(cells)
    notes = [f"names from line {number}", f"line {number} holds {len(cells)} names for {width - trailing} columns"]
    if more <= 0:
        names = (*cells, *[""] * trailing)[:width]
        return list(map(named_column, names)), notes[: 1 + any(cells[width:])]
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
    number = next((number for number in range(body.first - 1, 0, -1) if is_comment(head[number - 1])), 0)
    row = _row(head, number, table) if table.width > 1 else None
    names = row[1] if row else ()
    while len(names) > 1 and not names[-1]:
        names = names[:-1]
    full = 0 < len(names) <= table.width and all(kind.kind == "empty" for kind in body.types[len(names) :])
    numeric = any(kinds[name] in ("number", "stamp", "missing") for name in names)
    return (number, names) if full and not numeric and all(map(_is_name, names)) else None


def _is_name(text: str) -> bool:
    """A few words, perhaps with their unit in brackets or after a comma: not a sentence."""
    bare = text.partition("[")[0].partition("(")[0].strip()
    short = 0 < len(bare) <= _COMMENT_NAME_LENGTH and len(bare.split()) <= _COMMENT_NAME_WORDS
    return short and not bare.endswith(":") and not any(mark in bare for mark in "\t;|")


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
