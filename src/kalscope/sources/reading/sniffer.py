"""How a log is written, found from its first lines: delimiter, decimal mark, names, units, time."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice, pairwise, zip_longest

import numpy as np

from kalscope.recording import Assumption
from kalscope.sources.grammar.cells import (
    NumberForm,
    are_units,
    bare_unit,
    is_number,
    is_unit,
    parse_number,
    split_fields,
    split_measure,
    words,
)
from kalscope.sources.grammar.line_format import LineFormat, find_object, split_teleplot
from kalscope.sources.grammar.read_options import DEFAULTS, DELIMITERS, ReadOptions, word_of_mark
from kalscope.sources.grammar.timestamps import TimeColumn, find_epoch
from kalscope.sources.reading.columns import (
    COUNTING_NAMES,
    CellKinds,
    Cells,
    Column,
    HeadLine,
    Plan,
    differ,
    make_plan,
    mark_series,
    named_column,
    number_form,
    role_of,
    settle_roles,
)
from kalscope.sources.reading.table import (
    SCALE,
    Body,
    HeadTable,
    Row,
    best_table,
    find_body,
    header_cells,
)
from kalscope.sources.reading.time_columns import find_time, time_name

# Labels that come in turn, one or a few per line: `Temp: 21.5`, then `Hum: 40`, then the next `Temp`.


MIN_CYCLES = 4
"""How often all labels must come in turn."""
MAX_INSIDE = 0.25
"""Largest share of the time between two turns that may pass between the first and the last line of one."""


def leading_label(rows: Sequence[Cells], labels: Sequence[int]) -> int | None:
    """The label that begins each turn, an index into the cells; None where each line is a row of its own.

    Args:
        rows: Cells of the lines, "" where a line lacks the label.
        labels: Which of the cells hold values.
    """
    held = [[i for i in labels if row[i]] for row in rows]
    first = next(iter(held[0]), None) if held else None
    begins = [k for k, here in enumerate(held) if first in here]
    if len(begins) < MIN_CYCLES or len(begins) > 0.75 * len(held):
        return None
    turns = [[i for here in held[a:b] for i in here] for a, b in pairwise(begins)]
    # A label that is in some turns only, such as the signal of the radio, is of the turn in which it comes.
    usual = [i for i in labels if sum(i in turn for turn in turns) >= 0.9 * len(turns)]
    whole = sum({*usual} <= {*turn} and len({*turn}) == len(turn) for turn in turns)
    return first if len(usual) > 1 and whole >= 0.9 * len(turns) else None


# The sentences that explain a layout, and that name another one that could be meant.


def explain(head: Sequence[str], table: HeadTable, body: Body, second: HeadTable | None) -> list[str]:
    """How the lines are split, what is beside the data, and which other way comes close."""
    form = table.form
    mark = {"\t": "tabs", " ": "blanks"}.get(form.delimiter, f'"{form.delimiter}"')
    beside, fields = ", ".join(str(i + 1) for i in sorted(body.beside)), " or ".join(map(str, sorted(table.narrow)))
    facts = (
        (form.kind == "table", f'columns are separated by {mark}, the decimal mark is "{form.decimal}"'),
        (form.checksum, "each line ends with a checksum, which is checked"),
        (form.stamped, "the stamp before each line is the time"),
        (beside, f"columns of metadata beside the data: {beside}"),
        (fields, f"successive rows of {fields} fields lack the last columns, which the logger added later"),
    )
    notes = [said for holds, said in facts if holds]
    if second is not None:
        other = second.form
        count = "1 column" if second.width == 1 else f"{second.width} columns"
        marks = (("delimiter", other.delimiter, form.delimiter), ("decimal", other.decimal, form.decimal))
        chosen = [f"--{what} {word_of_mark(mark, what)}" for what, mark, known in marks if mark != known]
        notes.append(Assumption(f"it could also be {count}: {' '.join(chosen)}"))
    if (factor := next(filter(None, map(SCALE.fullmatch, head[: body.first])), None)) is not None:
        notes.append(Assumption(f"the numbers are not multiplied by the {factor[1]} above them"))
    return notes


def _about_rows(rows: Sequence[Cells], channels: Sequence[int], decimal: str) -> list[str]:
    """The doubt whether columns without names hold one signal, written row by row: they look alike."""
    numbers = np.array([[parse_number(row[i], decimal) for i in channels] for row in rows], dtype=np.float64)
    numbers = numbers[np.isfinite(numbers).all(axis=1)] if len(channels) >= 4 else numbers[:0]
    if len(numbers) < 4:
        return []
    spread, means = numbers.std(axis=0), numbers.mean(axis=0)
    if not (np.ptp(means) < 0.3 * spread.min() and spread.max() < 1.3 * spread.min()):
        return []
    return [Assumption(f"the {len(channels)} columns look alike: are they one signal, written row by row?")]


def explain_doubt(name: str, form: NumberForm, rival: NumberForm, cells: Sequence[str]) -> str:
    """The question about a column whose numbers could be written in two ways."""
    example = next(cell for cell in cells if differ(form, rival, cell))
    return Assumption(
        f'is "{example}" in "{name}" {form.parse(example):.15g} or {rival.parse(example):.15g}?'
        f" The first was used; --decimal {word_of_mark(rival.decimal, 'decimal')} selects the second"
    )


# Names and units of the columns: from rows above the data, comments, settings, or a row of numeric codes.


_MAX_HEADER_PLACE = 50
"""Lines of the head that are looked at for settings and for names that break."""
_MAX_HEADER_LENGTH = 4000
"""Their length."""

_SETTING = re.compile(r'[#%*; \t"]*+([A-Za-z][^:=,;|\t"]{0,60}+)"?[ \t]*(?::=|[:=,;|\t])[ \t]*+(\S.*)')
_NO_SAMPLE = re.compile(r"_?(?:bad|missing|no[ _]?data|fill)[ _]?(?:flag|value|code)")
_PROCESSING = words("raw cal uncal avg mean smp sample tot total min max std med first last")
_NAMES = re.compile(
    r"(?:(?:channel|column|field|signal|sensor)s? ?)?(?:labels|columns|channels|fields|names|header|titles?)"
)


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
    for i, line in enumerate(head[: max(_MAX_HEADER_PLACE, first - 1)], 1):
        match = _SETTING.fullmatch(line) if len(line) <= _MAX_HEADER_LENGTH else None
        if match:
            found.setdefault(match[1].strip().lower(), match[2].strip())
        elif line.startswith("[") and i < len(head):  # `[column names]` of VBOX above them
            found.setdefault(line.strip("[] ").lower(), head[i].strip())
        for name, value in (find_object(line[2:]) or []) if line.startswith("# {") else ():
            # `# {"98:D3": {"column": ["nSeq", "A1"]}}` of OpenSignals: "column 0" is nSeq
            found.setdefault(name.rpartition(".")[2].replace("[", " ").rstrip("]").lower(), value)
    return found


def _listed(settings: dict[str, str], table: HeadTable, body: Body) -> tuple[Cells, Cells]:
    """Names and units that lines above a table or beside it list, or give one by one."""
    width, filled = table.width, [i for i, kind in enumerate(body.types) if kind.kind != "empty"]
    names = tuple(settings.get(f"name {i}") or settings.get(f"column {i}", "") for i in range(width))
    found: dict[bool, Cells] = {False: names} if width > 1 and all(names[i] for i in filled) else {}
    marks = r"[;,\t|]" if table.form.delimiter != " " else r"[;,\t|]\s*|\s+"
    for key, value in settings.items():
        cells = tuple(cell.strip(" \t\"'[]") for cell in re.split(marks, value))
        said = tuple(cell for cell in cells if cell and not is_number(cell, table.form.decimal))
        is_list = width > 1 and len(said) == len(cells) and 0 <= width - len(cells) <= ("title" in key)
        if is_list and (_NAMES.fullmatch(key) or key.endswith("units")):
            found.setdefault(key.endswith("units"), ("",) * (width - len(cells)) + cells)
        # Of oscilloscopes, `Source,CH2` and `Vertical Units,V` describe the last columns.
        if key in ("source", "channel data", "vertical units") and 0 < len(said) < max(2, len(filled)):
            at = dict(zip(filled[-len(said) :], said, strict=True))
            found.setdefault(key == "vertical units", tuple(at.get(i, "") for i in range(width)))
    return found.get(False, ()), found.get(True, ())


def _declared(head: Sequence[str], body: Body) -> Cells:
    """Names from `FMT, 129, 31, IMU, Qff, TimeUS,GyrX,GyrY` of ArduPilot, for rows that begin with IMU."""
    kinds = {cells[0]: None for _, cells in body.rows}
    formats = (split_fields(line, ",") for line in head if line.startswith("FMT,"))
    names = [(cells[3], *cells[5:]) for cells in formats if len(cells) > 5 and cells[3] in kinds]
    # Rows of several kinds share few names: the time.
    return tuple(same.pop() if len(same := {*place}) == 1 else "" for place in zip_longest(*names, fillvalue=""))


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


def read_header(head: Sequence[str], settings: dict[str, str], table: HeadTable, body: Body, plan: Plan) -> Header:
    """Find the names and units of a table's columns."""
    above, first = _find(head, table, body, plan)
    spare = table.form.delimiter != " "  # `seconds pressure` below a sentence are names themselves
    level = (len(row[1]) <= len(upper[1]) + spare for row, upper in pairwise(above))
    said = [{cell.lower() for cell in cells} for _, cells in above]
    places = [i for i, fits in enumerate(level) if fits and are_units(above[i][1])]
    # `,,Min,Avg` of Campbell below the units: minima, not minutes.
    place = next((i for i in places if not said[i] - {""} <= _PROCESSING), min(places, default=-1))
    # `Unix,CAL,CAL` above the units only says what was done to each column; `5s 15s 20d` of the USGS are widths.
    codes = [all(cell[:1].isdecimal() for cell in found) for found in said]
    idle = [code or 2 * len(found & _PROCESSING) >= len(found) for code, found in zip(codes, said, strict=True)]
    told = (i for i in range(place + 1, len(above)) if not idle[i])
    rows = above[: next(told, place + 1) + 1]
    unit_row = above[place] if place >= 0 else None
    if plan.options.unit_row is not None:
        unit_row = _row(head, plan.options.unit_row, table)
    listed, listed_units = _listed(settings, table, body)
    listed = listed or _declared(head, body)
    names, notes, columns = listed, ["no header line"], [Column("")] * table.width
    if rows:
        (number, cells), (_, upper) = rows[-1], [*above, rows[-1]][len(rows)]
        if len(cells) == len(upper):  # `temp,temp` above `,quality`
            cells = tuple(cell or other for cell, other in zip(cells, upper, strict=True))
        columns, notes = _named((number, cells), table, body)
        notes[0] += f", units from line {unit_row[0]}" if unit_row else ""
    elif names:
        notes = ["names from the lines above the table"]
    units = unit_row[1] if unit_row is not None else listed_units
    named = {i: named_column(name) for i, name in enumerate(names) if name}
    known = {columns[i].name for i in named}
    for i, column in named.items() if known == {""} or len(known) < min(2, len(named)) else ():
        columns[i] = replace(column, unit=column.unit or columns[i].unit)
    for i, unit in enumerate(units[: table.width]):
        columns[i] = replace(columns[i], unit=bare_unit(unit)) if unit else columns[i]
    distinct = dict([*rows, *([unit_row] if unit_row else [])])
    return Header(tuple(columns), tuple(sorted(distinct.items(), reverse=True)), first, tuple(notes))


def _row(head: Sequence[str], number: int, table: HeadTable) -> Row | None:
    """The cells of a line above the table; None where there is no such line."""
    cells = header_cells(head[number - 1], table.form.delimiter, table.width) if 0 < number <= len(head) else None
    return None if cells is None else (number, cells)


def _find(head: Sequence[str], table: HeadTable, body: Body, plan: Plan) -> tuple[list[Row], int]:
    """The rows of units, of what was done to each column, and of names, nearest to the data first; the first row.

    What the user or the rule of an instrument chooses comes first.
    """
    above, chosen = list(body.above), plan.preface.header_row
    if chosen is not None:
        units = [row for row in above if row[0] > chosen and are_units(row[1]) and plan.options.unit_row is None]
        names = _row(head, chosen, table)
        return ([*units[-1:], names] if names else []), body.first
    if not above and _is_code_row(table, body):
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
    two = len(cells) == width - 1 and body.types[0].kind == body.types[1].kind == "stamp"
    if two and time_name(named_column(cells[0])).strength and not time_name(named_column(cells[1])).strength:
        return [named_column(cells[0]), Column(""), *map(named_column, cells[1:])], notes  # date and clock
    if more == 2 and [kind.kind for kind in body.types[:2]] == ["stamp"] * 2:  # date and clock of a frame of pandas
        return [Column(""), Column(""), *map(named_column, cells)], notes
    since = np.array([parse_number(body.rows[0][1][0], table.form.decimal) or 0.0])
    is_dated = body.types[0].kind == "stamp" or find_epoch(since) is not None
    if len(cells) == width - 1 and is_dated and not time_name(named_column(cells[0])).strength:
        return [Column(""), *map(named_column, cells)], notes
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


def _is_code_row(table: HeadTable, body: Body) -> bool:
    """True where the first row can only be codes: `94255 2018 1000 0 2010 …` above fractions of another size.

    The first sample must never be lost. Three columns at least must hold a whole number five times larger
    than anything below, one of them above nothing but fractions.
    """
    decimal = table.form.decimal
    codes, rows = body.rows[0][1], [cells for _, cells in body.rows[1:]]
    if len(rows) < 20 or not all(is_number(cell) and cell.isdecimal() for cell in codes):
        return False
    sizes = [[abs(parse_number(row[i], decimal) or 0.0) for row in rows] for i in range(len(codes))]
    unlike = [i for i, code in enumerate(codes) if float(code) > 5 * max(*sizes[i], 1.0)]
    return len(unlike) >= 3 and any(all(decimal in row[i] for row in rows) for i in unlike)


# How a log is written, found from its first lines: delimiter, decimal mark, header, units, time column.
#
# Pure functions on text. A file gives its units in the header (`accel (m/s^2)`, `t [us]`, `Distance_cm`), in a
# row of units below the header, or in comment lines of Kalscope's own convention above the data:
#
#     # unit volume: 1e8 m3


MAX_COLUMNS = 256
"""A table wider than this is not a log of samples (a list per line, an image, one case per line)."""

MAX_STREAM_COLUMNS = MAX_COLUMNS - 1
"""Columns of a stream: its recording holds the time at which each line came as well, and is read as a file."""

_TELEPLOT_TIME = Column("time", "ms")
_SPECTRUM = re.compile(r"spectr(?:um|al|o)|wave(?:length|number)|raman", re.IGNORECASE)
"""Above a table without names: what rises evenly is no time."""


@dataclass(frozen=True)
class Layout:
    """How one log is written."""

    form: LineFormat
    """Delimiter, decimal mark, kind."""
    columns: tuple[Column, ...]
    """One per field of a data line."""
    time: TimeColumn | None
    """The time column; None where there is none."""
    first_data: int
    """Line number of the first data line, from 1."""
    headers: frozenset[int]
    """Line numbers above the data that are header or units rows."""
    header_rows: tuple[Cells, ...]
    """Their cells, by which a repeated header is recognised."""
    notes: tuple[str, ...]
    """What was decided, each a sentence."""
    narrow: frozenset[int] = frozenset()
    """Widths of rows that lack their last fields, where several such rows follow each other."""
    period: float | None = None
    """Sample period in s that the file itself gives; None where it gives none."""
    start: float | None = None
    """What second 0 of the stamps is, or the first sample where there are none, in s since 1970; None: unknown."""
    lead: int | None = None
    """Column of the label that begins a row where several lines make up one; None where each line is a row."""
    missing: tuple[float, ...] = ()
    """Numbers that lines above the table call missing samples."""

    @property
    def channels(self) -> list[int]:
        """Indices of the columns that are channels."""
        return [i for i, column in enumerate(self.columns) if column.role == "channel"]

    @property
    def least(self) -> int:
        """Fewest fields of a whole line: a spreadsheet's trailing empty columns may be left out."""
        roles = [column.role for column in self.columns]
        return max(1, *(i for i, role in enumerate(roles, 1) if role != "empty"), 1)


def sniff(head: Sequence[str], options: ReadOptions = DEFAULTS, samples: Sequence[str] = ()) -> Layout | None:
    """Find how a log is written.

    Args:
        head: The first lines of the file (64 KiB are plenty), without their newlines.
        options: What is decided already.
        samples: Whole lines from the middle and the end of the file, where there are any; "" parts them.

    Returns:
        None where fewer than MIN_SHARE of the lines look like data, or the head ends above the data.

    Raises:
        BadSetting: there is no such time column, or no such row.
    """
    head = join_quoted(head)
    if head and head[0].strip('" \r').lower().startswith("sep="):
        head[0] = ""  # what tells a spreadsheet the delimiter is no row of names
    plan = make_plan(head, options)
    lines, table, second = best_table(head, samples, plan)
    if table is None or table.least > MAX_COLUMNS or table.rows[0][0] > len(head):
        return None
    return _layout(head, plan, lines, table, second)


def _layout(
    head: Sequence[str], plan: Plan, lines: list[HeadLine], table: HeadTable, second: HeadTable | None
) -> Layout | None:
    """The layout of a table among the lines of a file; None where its rows begin below the head."""
    kinds = CellKinds(table.form.decimal, plan.options.missing_texts, table.form.delimiter)
    body = find_body(head, lines, table, plan, kinds)
    if body.first > len(head):  # lines of the samples have no number of the file
        return None
    is_table = table.form.kind == "table"
    settings = settings_of(head, body.first)
    header = read_header(head, settings, table, body, plan) if is_table else _labelled_header(table, lines)
    body = replace(body, rows=tuple(row for row in body.rows if row[0] >= header.first))
    columns, about_numbers = _described(len(head), settings, header, body, kinds, plan)
    if not header.rows and is_table:
        # Only columns after the last number are empty: `1,,3` has a second channel that is still missing.
        last = max((i for i, column in enumerate(columns) if column.role != "empty"), default=-1)
        begin = int(table.form.delimiter == "|")  # `| 1 | 2 |` has no column in front
        columns[begin:last] = [replace(c, role="channel") if c.role == "empty" else c for c in columns[begin:last]]
    cells = [row for _, row in body.rows]
    if table.form.stamped:
        stamps = {line.number: line.stamp for line in lines}
        cells = [(stamps[number], *row) for number, row in body.rows]
        columns.insert(0, Column("time", (split_measure(cells[0][0]) or ("", ""))[1]))
    spectrum = any(map(_SPECTRUM.search, head[: body.first - 1]))
    time = _find_time(columns, cells, table, header, plan, spectrum=spectrum)
    is_json = head[body.first - 1].lstrip(" [").startswith('{"')
    if time is not None and not is_json and (table.form.stamped or not is_table):
        time = replace(time, printed=True)
    columns, about_series = mark_series(columns, cells, time, table.form.decimal)
    named = [column.name for column in columns]
    columns, time, about_columns = settle_roles(columns, time)
    channels = [i for i, column in enumerate(columns) if column.role == "channel"]
    in_turns = table.form.kind == "labels" and not table.form.complete
    lead = leading_label(cells, channels) if in_turns else None
    above = sum(number < header.first for number, _ in table.rows)
    notes = (
        *explain(head, table, body, second),
        *about_numbers,
        *([Assumption(f"{above} lines of numbers above the table are left out")] if above > 1 else []),
        *header.notes,
        *([] if lead is None else [f'several lines make up a row; "{columns[lead].name}" begins each']),
        *about_series,
        *about_columns,
        *(_about_rows(cells, channels, table.form.decimal) if time is None and not any(named) else ()),
        *plan.preface.notes,
    )
    codes = settings_of(head[: header.first - 1], 0).items()
    missing = (parse_number(value) for key, value in codes if _NO_SAMPLE.fullmatch(key) and is_number(value))
    headers, said, stated = frozenset(dict(header.rows)), tuple(cells for _, cells in header.rows), plan.preface
    layout = Layout(table.form, tuple(columns), time, header.first, headers, said, notes, table.narrow)
    layout = replace(layout, missing=tuple(filter(None, missing)))
    return replace(layout, period=stated.period, start=stated.start, lead=lead)


def _described(
    size: int, settings: dict[str, str], header: Header, body: Body, kinds: CellKinds, plan: Plan
) -> tuple[list[Column], list[str]]:
    """The columns with their units, roles and forms of numbers; sentences about forms that differ."""
    columns: list[Column] = []
    notes: list[str] = []
    inside = sum(number <= size for number, _ in body.rows)
    # `O3, ppbv, …` and `Time_Start, seconds, …`, a line for each column, above the names.
    given = {c.name: re.split(r"[,;|\t]", settings.get(c.name.lower(), ""))[0].strip() for c in header.columns}
    given = {name: unit for name, unit in given.items() if is_unit(unit, alone=True)}
    for i, column in enumerate(header.columns):
        cells, kind, form = [row[i] for _, row in body.rows], body.types[i], None
        role = "metadata" if i in body.beside else role_of(column, cells[:inside], i, kind, len(body.types))
        unit = settings.get(
            f"unit {column.name.lower()}", column.unit or (len(given) > 1 and given.get(column.name)) or ""
        )
        if role == "channel":
            name, (best, rival) = column.name or f"column {i + 1}", number_form(cells, kinds, plan.options.decimal)
            if best != NumberForm(kinds.decimal):
                form, unit = best, unit or best.suffix
                notes.append(f'the numbers of "{name}" are written like {next(filter(best.fits, cells), "")!r}')
                bare = (
                    cell for cell in cells if best.suffix not in cell and cell[-1:].isdecimal() and best.fits(cell)
                )
                said = (f'"{cell}" in "{name}" is in {best.suffix} as well' for cell in bare)
                notes += map(Assumption, islice(said, 1))
            if rival is not None:
                notes.append(explain_doubt(name, best, rival, cells))
        columns.append(replace(column, role=role, unit=unit, form=form))
    return columns, notes


def _find_time(
    columns: list[Column], rows: list[Cells], table: HeadTable, header: Header, plan: Plan, *, spectrum: bool
) -> TimeColumn | None:
    choice = plan.preface.time_column if plan.options.time_column is None else plan.options.time_column
    decimal, labels = table.form.decimal, header.rows[-1][1] if header.rows else ()
    named = spectrum or bool(header.rows) or all(column.name for column in columns)
    if choice is None and columns[0] == _TELEPLOT_TIME and table.form.kind == "teleplot":
        return TimeColumn(0, "number", "ms")
    # A field that was added later cannot be the time of the rows before.
    least = len(columns) if choice is not None else min(table.narrow, default=len(columns))
    few = [row[:least] for row in rows]
    return find_time(columns[:least], few, decimal, named=named, choice=choice, labels=labels, options=plan.options)


def _labelled_header(table: HeadTable, lines: list[HeadLine]) -> Header:
    """Names and units that the data lines themselves hold."""
    if table.form.kind == "labels":
        columns = [named_column(label) for label in table.form.labels]
        return Header(tuple(columns), (), table.rows[0][0], ("each line holds name:value pairs",))
    units = {plot.name: plot.unit for line in lines if (plot := split_teleplot(line.text)) and plot.unit}
    columns = [Column(name, units.get(name, "")) for name in table.form.labels]
    if table.width > len(columns):
        columns.insert(0, _TELEPLOT_TIME)
    return Header(tuple(columns), (), table.rows[0][0], ("each line is one variable of Teleplot",))
