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
from kalscope.sources.grammar.line_format import LineFormat
from kalscope.sources.grammar.read_options import DELIMITERS
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.reading.columns import COUNTING_NAMES, CellKinds, Cells, Column, Plan, named_column
from kalscope.sources.reading.table import Body, HeadTable, header_cells
from kalscope.sources.reading.time_columns import time_name

_COMMENT_NAME_LENGTH, _COMMENT_NAME_WORDS = 40, 3
_MIN_CODE_ROWS = 20
_SINCE_1970 = 1e9
"""A first column that begins beyond this, in s, holds stamps, which may have no name."""
_MAX_HEADER_PLACE, _MAX_HEADER_LENGTH, _MAX_NAME_LINES = 50, 4000, 12
"""Lines of the head that are looked at for names that break, their length, and lines of one header."""

_SETTING = re.compile(r'[#%*; \t"]*+([A-Za-z][^:=,;|\t"]{0,60}+)"?[ \t]*(?::=|[:=,;|\t])[ \t]*+(\S.*)')
_LIST = re.compile(
    r"(?:(?:channel|column|field|signal|sensor)s? )?(labels|columns|channels|fields|names|header|units)"
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


def _listed_above(settings: dict[str, str], width: int) -> tuple[Cells, Cells]:
    """Names and units that lines above a table list, or give one by one."""
    lists: dict[bool, Cells] = {}
    for key, value in settings.items() if width > 1 else ():
        cells = tuple(cell.strip(" \t\"'[]") for cell in re.split(r"[;,\t|]", value))
        if (match := _LIST.fullmatch(key)) and len(cells) == width and all(cells):
            lists.setdefault(match[1] == "units", cells)
    numbered = tuple(settings.get(f"name {i}") or settings.get(f"column {i}", "") for i in range(width))
    return numbered if width > 1 and all(numbered) else lists.get(False, ()), lists.get(True, ())


def named_by_settings(
    settings: dict[str, str], columns: list[Column], time: TimeColumn | None, form: LineFormat
) -> list[Column]:
    """The columns with the names and units that settings above or beside the table give to its channels.

    Oscilloscopes write `Source,CH2` and `Vertical Units,V`. Names of columns that differ are kept.
    """
    taken = time.indices if time else ()
    channels = [i for i, column in enumerate(columns) if column.role == "channel" and i not in taken]
    if not channels or form.kind != "table" or form.delimiter == " ":
        return columns

    def texts(key: str) -> list[str]:
        cells = split_fields(settings.get(key, ""), form.delimiter)
        return [cell for cell in cells if cell and not is_number(cell, form.decimal)]

    named, names = list(columns), texts("source") or texts("channel data")
    alike = len({columns[i].name for i in channels}) == 1
    if alike and len(names) == len(channels) and (len(channels) > 1 or not columns[channels[0]].name):
        for i, name in zip(channels, names, strict=True):
            named[i] = replace(named[i], name=name)
    for i, unit in zip(channels, texts("vertical units"), strict=False):
        named[i] = replace(named[i], unit=named[i].unit or bare_unit(unit))
    return named


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
    found = _chosen(head, table, body, plan) or _find(head, table, body, plan, kinds)
    notes, columns = [found.note], tuple(Column("") for _ in range(table.width))
    if found.names is not None:
        columns, more = _named(found.names, table, body)
        notes += more
    names, units = _listed_above(settings, table.width)
    if found.names is None and names:
        notes = ["names from the lines above the table"]
    if plan.preface.names:
        names, notes = plan.preface.names, []
    if plan.preface.names or (found.names is None and names):
        columns = tuple(named_column(name) for name in (*names, *[""] * table.width)[: table.width])
    units = plan.preface.units or (found.units[1] if found.units is not None else units)
    columns = tuple(
        replace(column, unit=bare_unit(units[i])) if i < len(units) and units[i] else column
        for i, column in enumerate(columns)
    )
    rows = tuple(row for row in (found.units, *found.others, found.names) if row is not None)
    return Header(columns, tuple(sorted(rows, reverse=True)), found.first or body.first, tuple(notes))


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
        return _Rows(None, units, said="no header line, as requested")
    if plan.preface.unit_row is None:
        below = [above for above in reversed(body.above) if above[0] > names[0]]
        units = next((above for above in below if are_units(above[1])), None)
    return _Rows(names, units)


def _find(head: Sequence[str], table: HeadTable, body: Body, plan: Plan, kinds: CellKinds) -> _Rows:
    """The rows of names and units as the lines themselves show them: units are below the names."""
    above = list(body.above)
    commented = None if plan.options.header else _commented_header(head, table, body, kinds)
    if commented and not above and are_units(commented[1]):  # `# t x` above `# s mm`
        upper = _commented_header(head[: commented[0] - 1], table, replace(body, first=commented[0]), kinds)
        if upper and upper[0] == commented[0] - 1 and len(upper[1]) == len(commented[1]):
            return _Rows(upper, commented)
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
    spare = table.form.delimiter != " "  # `seconds pressure` below a sentence are names themselves
    level = (abs(len(row[1]) - len(upper[1])) <= spare for row, upper in pairwise(above))
    place = next((i for i, fits in enumerate(level) if fits and are_units(above[i][1])), None)
    start = 0 if place is None else place + 1
    # `Unix,CAL,CAL` above the units only says what was done to each column; `s V V V V V` are no names either.
    done = [sum(cell.lower() in _PROCESSING for cell in cells) for _, cells in above]
    # `5s 15s 20d` of the USGS are widths.
    telling = (
        2 * done[i] <= len(cells) <= 2 * len(set(cells)) and not all(cell[:1].isdecimal() for cell in cells)
        for i, (_, cells) in enumerate(above)
    )
    names = next((i for i, tells in enumerate(telling) if tells and i >= start), start)
    units = None if place is None else above[place]
    if plan.preface.unit_row is not None:
        units = _row(head, plan.preface.unit_row, table)
    elif units is None and above[names][0] < len(head) and is_comment(text := head[above[names][0]]):
        # A row of units that begins with an empty cell and %, and so looks like a comment.
        cells = tuple(split_fields(text, table.form.delimiter))
        units = (above[names][0] + 1, cells) if len(cells) == len(above[names][1]) and are_units(cells) else None
    return _Rows(above[names], units, tuple(row for i, row in enumerate(above[:names]) if i != place))


def _named(row: Row, table: HeadTable, body: Body) -> tuple[tuple[Column, ...], list[str]]:
    """The columns by their names; rows may be wider by row names, a trailing separator or unnamed columns."""
    (number, cells), width = row, table.width
    if not any(cells):
        return tuple(Column("") for _ in range(width)), [f"line {number} is empty"]
    trailing = 0
    while len(cells) + trailing < width and body.types[width - 1 - trailing].kind == "empty":
        trailing += 1
    more = width - trailing - len(cells)
    notes = [f"line {number} holds {len(cells)} names for {width - trailing} columns"]
    if more <= 0:
        names = (*cells, *[""] * trailing)[:width]
        return tuple(map(named_column, names)), notes if any(cells[width:]) else []
    since = parse_number(body.rows[0][1][0], table.form.decimal) or 0.0
    is_dated = body.types[0].kind == "stamp" or since > _SINCE_1970
    if len(cells) == width - 1 and is_dated and not time_name(named_column(cells[0])).strength:
        return (Column(""), *map(named_column, cells)), notes
    if len(cells) == width - 1 and _are_row_names(cells[0], body):
        return (Column("", role="row name"), *map(named_column, cells)), notes
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


def _commented_header(head: Sequence[str], table: HeadTable, body: Body, kinds: CellKinds) -> Row | None:
    """The last comment above the data where it is a list of names, as `# time ax ay` of numpy.savetxt."""
    for number in range(body.first - 1, 0, -1):
        text = head[number - 1]
        if is_comment(text) and text.strip(" \t#%/"):
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
