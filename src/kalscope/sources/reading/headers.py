"""Names and units of the columns: from header and units rows, comments, or a row of numeric codes."""

from __future__ import annotations

import math
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
from kalscope.sources.grammar.line_format import LineFormat
from kalscope.sources.grammar.read_options import DELIMITERS
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.reading.columns import COUNTING_NAMES, CellKinds, Cells, Column, Plan, named_column
from kalscope.sources.reading.table import Body, HeadTable, header_cells

_COMMENT_NAME_LENGTH, _COMMENT_NAME_WORDS = 40, 3
_MIN_CODE_ROWS = 20
_MAX_HEADER_PLACE, _MAX_HEADER_LENGTH, _MAX_NAME_LINES = 50, 4000, 12
"""Lines of the head that are looked at for names that break, their length, and lines of one header."""

_NUMBERED_NAME = re.compile(r"[#%* \t]*(?:name|column) ?([0-9]{1,3})[ \t]*[=:][ \t]*(\S.*)", re.IGNORECASE)
_LIST = re.compile(
    r"[#%*; \t]*(?:(?:channel|column|field|signal|sensor)s? )?(labels|columns|channels|fields|names|header|units)"
    r"[ \t]*(?::=|[:=])[ \t]*(\S.*)",
    re.IGNORECASE,
)
_PROCESSING = words("raw cal uncal avg mean smp sample tot total min max std med first last")

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
    said: str = "no header line"


def _listed_above(head: Sequence[str], width: int) -> tuple[Cells, Cells]:
    """Names and units that lines above a table list: `# Labels:= ECG;EDA`, `# name 0 = timeS: Time [seconds]`."""
    numbered: dict[int, str] = {}
    lists: dict[bool, Cells] = {}
    for line in head:
        if len(line) > _MAX_HEADER_LENGTH:
            continue
        if match := _NUMBERED_NAME.fullmatch(line):
            numbered[int(match[1])] = match[2].strip()
        elif match := _LIST.fullmatch(line):
            cells = tuple(cell.strip(" \t\"'[]") for cell in re.split(r"[;,\t|]", match[2]))
            if len(cells) == width > 1 and all(cells):
                lists.setdefault(match[1].lower() == "units", cells)
    if width > 1 and sorted(numbered) == list(range(width)):
        lists[False] = tuple(numbered[i] for i in range(width))
    return lists.get(False, ()), lists.get(True, ())


def named_by_settings(
    head: Sequence[str], columns: list[Column], time: TimeColumn | None, form: LineFormat
) -> list[Column]:
    """The columns with the names and units that settings above or beside the table give to its channels.

    Oscilloscopes write `Source,CH2` and `Vertical Units,V`. Names of columns that differ are kept.
    """
    taken = time.indices if time else ()
    channels = [i for i, column in enumerate(columns) if column.role == "channel" and i not in taken]
    if not channels or form.kind != "table" or form.delimiter == " ":
        return columns
    alike = len({columns[i].name for i in channels}) == 1
    settings: dict[str, list[str]] = {}
    for line in head[:_MAX_HEADER_PLACE]:
        key, *values = split_fields(line, form.delimiter)
        said = [value.rpartition(":")[2] for value in values if value and not is_number(value, form.decimal)]
        settings.setdefault(key.strip(" :=").lower(), said)
    named = list(columns)
    for key in ("source", "channel data"):
        for i, name in zip(channels, settings.get(key, ()), strict=False):
            if alike and len(settings[key]) == len(channels) and (len(channels) > 1 or not columns[i].name):
                named[i] = replace(named[i], name=name)
    for i, unit in zip(channels, settings.get("vertical units", ()), strict=False):
        named[i] = named[i] if named[i].unit else replace(named[i], unit=bare_unit(unit))
    return named


def join_quoted(head: Sequence[str]) -> list[str]:
    """The lines, with quoted names that span lines joined into the last of them, and those above left empty.

    Spreadsheets write such names. A stray quote in a row of data joins nothing: all cells must be names.
    """
    lines = list(head)
    for first, line in enumerate(lines[:_MAX_HEADER_PLACE]):
        if line.count('"') % 2 == 0 or len(line) > _MAX_HEADER_LENGTH:
            continue
        for last in range(first + 1, min(first + _MAX_NAME_LINES, len(lines))):
            if lines[last].count('"') % 2 == 1 and len(lines[last]) <= _MAX_HEADER_LENGTH:
                joined = " ".join(part.strip() for part in lines[first : last + 1] if part)
                if any(_are_texts(split_fields(joined, mark)) for mark in DELIMITERS if mark != " "):
                    lines[first : last + 1] = [""] * (last - first) + [joined]
                break
    return lines


def _are_texts(cells: list[str]) -> bool:
    return len(cells) > 1 and not any('"' in cell[:1] or is_number(cell) for cell in cells)


def read_header(head: Sequence[str], table: HeadTable, body: Body, plan: Plan, kinds: CellKinds) -> Header:
    """Find the names and units of a table's columns."""
    found = _chosen(head, table, body, plan) or _find(head, table, body, plan, kinds)
    notes = [found.said]
    columns = tuple(Column("") for _ in range(table.width))
    if found.names is not None:
        columns, more = _named(found.names, table, body)
        notes += more
    listed_names, listed_units = _listed_above(head[: body.first - 1], table.width)
    if found.names is None and listed_names:
        columns, notes = tuple(map(named_column, listed_names)), ["names from the lines above the table"]
    if plan.preface.names:
        columns, notes = _by_preface(plan.preface.names, table.width), []
    units = plan.preface.units or (found.units[1] if found.units is not None else listed_units)
    columns = tuple(
        replace(column, unit=bare_unit(units[i])) if i < len(units) and units[i] else column
        for i, column in enumerate(columns)
    )
    rows = tuple(row for row in (found.units, *found.others, found.names) if row is not None)
    return Header(columns, tuple(sorted(rows, reverse=True)), found.first or body.first, tuple(notes))


def _chosen(head: Sequence[str], table: HeadTable, body: Body, plan: Plan) -> _Rows | None:
    """The rows that the user or the instrument's rules name; None where they leave it open."""
    if plan.header_row is None:
        return None

    def row(number: int | None) -> Row | None:
        if not number or number > len(head):
            return None
        text = head[number - 1]
        text = text.strip(" \t").lstrip("#%/").strip() if is_comment(text) else text
        return number, header_cells(text, table.form.delimiter, table.width)

    names, units = row(plan.header_row), row(plan.unit_row)
    if names is None:
        return _Rows(None, units, said="no header line, as requested")
    if plan.unit_row is None:
        below = [above for above in reversed(body.above) if above[0] > names[0]]
        units = next((above for above in below if are_units(above[1])), None)
    said = f"names from line {names[0]}" + (f", units from line {units[0]}" if units else "")
    return _Rows(names, units, said=said)


def _find(head: Sequence[str], table: HeadTable, body: Body, plan: Plan, kinds: CellKinds) -> _Rows:
    """The rows of names and units as the lines themselves show them."""
    above = body.above
    commented = _commented_header(head, table, body, kinds) if not plan.options.header else None
    units_below = commented is not None and len(above) == 1 and commented[0] == above[0][0] - 1
    if above and not (units_below and are_units(above[0][1])):
        return _among(above, plan, head, table)
    if commented is not None:
        units = above[0] if above else None
        said = f"names from comment line {commented[0]}" + (f", units from line {units[0]}" if units else "")
        return _Rows(commented, units, said=said)
    if (plan.options.header or _is_code_row(table, body)) and len(body.rows) > 1:
        said = f"names from line {body.rows[0][0]}"
        said += "" if plan.options.header else ", codes unlike all numbers below"
        return _Rows(body.rows[0], first=body.rows[1][0], said=said)
    return _Rows()


def _among(above: tuple[Row, ...], plan: Plan, head: Sequence[str], table: HeadTable) -> _Rows:
    """The names and the units among lines of text above the data, nearest first: units are below the names."""
    rows = list(above)
    units = next(
        (
            i
            for i, (_, cells) in enumerate(rows[:-1])
            if are_units(cells) and _stand_below(cells, rows[i + 1][1], table.form.delimiter)
        ),
        None,
    )
    if len(rows) == 1 and units is None and all(is_unit(cell) and len(cell) > 2 for cell in rows[0][1]):
        numbered = _numbered_names(head, rows[0], table)
        if numbered is not None:
            rows, units = [rows[0], numbered], 0
    start = 0 if units is None else units + 1
    names = next((i for i in range(start, len(rows)) if _is_telling(rows[i][1])), start)
    found = None if units is None else rows[units]
    if plan.unit_row is not None:
        number = plan.unit_row
        found = (number, tuple(split_fields(head[number - 1], table.form.delimiter))) if number else None
    elif found is None:
        found = _commented_units(head, rows[names], rows[0][0], table)
    said = f"names from line {rows[names][0]}" + (f", units from line {found[0]}" if found else "")
    others = tuple(row for i, row in enumerate(rows[:names]) if i != units)
    return _Rows(rows[names], found, others, said=said)


def _numbered_names(head: Sequence[str], units: Row, table: HeadTable) -> Row | None:
    """The line above a row of units that names the channels by numbers: `x-axis,1,2`."""
    number = units[0] - 1
    cells = tuple(split_fields(head[number - 1], table.form.delimiter)) if number else ()
    named = bool(cells) and len(cells) == len(units[1]) and not is_number(cells[0]) and all(cells)
    return (number, cells) if named else None


def _commented_units(head: Sequence[str], names: Row, last: int, table: HeadTable) -> Row | None:
    """A row of units right below the names that begins with an empty cell and %, and so looks like a comment."""
    for number in range(names[0] + 1, min(last + 2, len(head) + 1)):
        text = head[number - 1]
        cells = tuple(split_fields(text, table.form.delimiter))
        if is_comment(text) and len(cells) in (len(names[1]), table.width) and are_units(cells):
            return number, cells
    return None


def _stand_below(units: Cells, names: Cells, delimiter: str) -> bool:
    """True where these may be units below these names: `seconds pressure` below a sentence are names themselves."""
    bracketed = all(cell != bare_unit(cell) for cell in units if cell)
    spare = abs(len(names) - len(units))
    return bracketed or spare == 0 or (spare == 1 and delimiter != " ")


def _is_telling(cells: Cells) -> bool:
    """True for a row of names: `Avg,Avg,Smp` and `Unix,CAL,CAL` only say what was done to each column."""
    said = [cell.lower() for cell in cells if cell]
    return 2 * len(set(said)) >= len(said) and 2 * sum(cell in _PROCESSING for cell in said) <= len(said)


def _named(row: Row, table: HeadTable, body: Body) -> tuple[tuple[Column, ...], list[str]]:
    """The columns by their names; rows may be wider by row names, a trailing separator or unnamed columns."""
    (number, cells), width = row, table.width
    if cells in ((), ("",)):
        return tuple(Column("") for _ in range(width)), [f"line {number} is empty"]
    trailing = 0
    while len(cells) + trailing < width and body.types[width - 1 - trailing].kind == "empty":
        trailing += 1
    if len(cells) + trailing >= width:
        notes: list[str] = []
        if trailing:
            notes.append("each row ends in a separator that the line of names lacks")
        elif any(cells[width:]):
            notes.append(f"line {number} holds {len(cells)} names for {width} columns")
        return tuple(named_column(name) for name in (*cells, *[""] * trailing)[:width]), notes
    notes = [f"line {number} holds {len(cells)} names for {width - trailing} columns"]
    if len(cells) == width - 1 and _are_row_names(cells[0], body):
        return (Column("", role="row name"), *map(named_column, cells)), notes
    more = width - trailing - len(cells)
    names = (*cells, *[cells[-1] if more > 1 else ""] * more, *[""] * trailing)
    return tuple(map(named_column, names)), notes


def _are_row_names(first: str, body: Body) -> bool:
    """True where the first column holds texts or counts the rows, as R writes them without a name of their own."""
    if first.lower() in COUNTING_NAMES or body.types[0].kind == "text":
        return first.lower() not in COUNTING_NAMES
    cells = [cells[0] for _, cells in body.rows]
    if not all(cell.isascii() and cell.isdecimal() and len(cell) < 18 for cell in cells):
        return False
    return sum(int(b) - int(a) == 1 for a, b in pairwise(cells)) >= 0.9 * (len(cells) - 1)


def _by_preface(names: Cells, width: int) -> tuple[Column, ...]:
    return tuple(named_column(name) for name in (*names, *[""] * width)[:width])


def _commented_header(head: Sequence[str], table: HeadTable, body: Body, kinds: CellKinds) -> Row | None:
    """The last comment above the data where it is a list of names, as `# time ax ay` of numpy.savetxt."""
    below = body.rows[0][1]
    for number in range(body.first - 1, 0, -1):
        text = head[number - 1]
        if is_comment(text):
            names = _commented_cells(text, table.form.delimiter, table.width)
            full = len(names) <= table.width and all(kind.kind == "empty" for kind in body.types[len(names) :])
            listed = full and table.width > 1 and all(_is_name(name, table.form.delimiter) for name in names)
            return (number, names) if listed and _are_names(names, below, kinds) else None
    return None


def _commented_cells(text: str, delimiter: str, width: int) -> Cells:
    """The cells of a comment line, without empty ones at its end; in `#,level,flow` the mark is a name itself."""
    cells = tuple(split_fields(text.strip(" "), delimiter)) if delimiter != " " else ()
    if len(cells) < 2 or cells[0] not in COMMENT_MARKS:
        cells = header_cells(text.strip(" \t").lstrip("#%/").strip(), delimiter, width)
    while len(cells) > 1 and not cells[-1]:
        cells = cells[:-1]
    return cells


def _are_names(names: Cells, below: Cells, kinds: CellKinds) -> bool:
    """True where no cell is a number, a stamp or a missing value; one "Na" beside a name of a number is sodium."""
    others = [name for name in names if name.lower() != "na"]
    if any(kinds[name] in ("number", "stamp", "missing") for name in others):
        return False
    named = any(
        name.lower() != "na" and kinds[under] == "number" for name, under in zip(names, below, strict=False)
    )
    return len(others) == len(names) or (named and len(others) == len(names) - 1)


def _is_name(text: str, delimiter: str) -> bool:
    """A few words, perhaps with their unit in brackets or after a comma: not a sentence."""
    bare = text.partition("[")[0].partition("(")[0].strip()
    few = len(bare.split()) <= _COMMENT_NAME_WORDS
    return (
        0 < len(bare) <= _COMMENT_NAME_LENGTH
        and few
        and not bare.endswith(":")
        and not any(c in bare for c in ("\t;|" if delimiter in "\t;|" else "\t,;|"))
    )


def _is_code_row(table: HeadTable, body: Body) -> bool:
    """True where the first row can only be codes: `94255 2018 1000 0 2010 …` above fractions of another size.

    The first sample must never be lost. Three columns at least must hold a whole number five times larger
    than anything below, one of them above nothing but fractions.
    """
    decimal = table.form.decimal
    codes, rows = body.rows[0][1], [cells for _, cells in body.rows[1:]]
    if len(rows) < _MIN_CODE_ROWS or not all(is_number(cell) and cell.isdecimal() for cell in codes):
        return False
    unlike, above_fractions = 0, False
    for i, code in enumerate(codes):
        values = [parse_number(row[i], decimal) for row in rows]
        sizes = [abs(value) for value in values if value is not None and not math.isnan(value)]
        if sizes and float(code) > 5 * max(*sizes, 1.0):
            unlike += 1
            above_fractions |= all(decimal in row[i] for row in rows)
    return unlike >= 3 and above_fractions
