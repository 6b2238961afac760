"""How a log is written, found from its first lines: delimiter, decimal mark, header, units, time column.

Pure functions on text. A file says its units in the header (`accel (m/s^2)`, `t [us]`, `Distance_cm`), in a
row of units below the header, or in comment lines of Kalscope's own convention above the data:

    # unit volume: 1e8 m3
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

from kalscope.sources.columns import (
    STAMP_SHAPE,
    Cells,
    Column,
    are_units,
    bare_unit,
    find_time,
    named_column,
    role_of,
    settle_roles,
)
from kalscope.sources.line_parser import (
    MISSING,
    LineFormat,
    is_blank,
    is_comment,
    is_number,
    split_fields,
    split_labels,
    split_stamp,
)
from kalscope.sources.timestamps import TimeColumn

MAX_COLUMNS = 256
"""A table wider than this is no log of samples (a list per line, an image, one case per line)."""
MIN_SHARE = 0.15
"""Of the lines of the head, the share that must look like data: boot text may outweigh a short log."""
MIN_UNIFORM = 0.6
"""Of the lines with numbers, the share that must have one width: records of several lines are no table."""
UNIFORM_LINES = 20
"""Lines it takes to judge that."""


_DELIMITERS = (",", ";", "\t", "|", " ")
_UNIT_COMMENT = re.compile(r"\s*(?:#|%|//)\s*unit\s+(.+?)\s*:\s*(.+?)\s*", re.IGNORECASE)
_COMMENT_NAME = re.compile(r"[^\s,;|]{1,40}(?:\s*[\[(][^\])]*[\])])?")


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
    """Their cells, by which a repeated header is known again."""
    notes: tuple[str, ...]
    """What was decided, each a sentence."""


@dataclass(frozen=True)
class _Line:
    number: int
    text: str
    stamp: str


@dataclass(frozen=True)
class _Table:
    """The data lines of the head, split in one of the possible ways."""

    score: float
    form: LineFormat
    width: int
    rows: tuple[tuple[int, Cells], ...]


def sniff(head: Sequence[str]) -> Layout | None:
    """Find how a log is written.

    Args:
        head: The first lines of the file (64 KiB are plenty), without their newlines.

    Returns:
        None where fewer than MIN_SHARE of the lines look like data.
    """
    lines, stamped = _candidate_lines(head)
    table = _best_table(lines)
    if table is None or table.width > MAX_COLUMNS:
        return None
    first = _first_row(lines, table)
    above = [line for line in lines if line.number < first]
    units = {match[1]: match[2] for line in head if (match := _UNIT_COMMENT.fullmatch(line))}
    if table.form.kind == "labels":
        headers: tuple[tuple[int, Cells], ...] = ()
        columns = [named_column(label) for label in table.form.labels]
        notes = ["each line holds name:value pairs"]
    else:
        headers, columns, notes = _read_header(head, above, table, first)
    rows = [cells for number, cells in table.rows if number >= first]
    columns = [replace(column, unit=units.get(column.name, column.unit)) for column in columns]
    columns = [
        replace(column, role=role_of(column, rows, i, table.form.decimal)) for i, column in enumerate(columns)
    ]
    if stamped:
        stamps = {line.number: line.stamp for line in lines}
        rows = [(stamps[number], *cells) for number, cells in table.rows if number >= first]
        columns.insert(0, Column("time"))
        notes.append("the Arduino IDE's stamp before each line is the time")
    time = find_time(columns, rows, table.form.decimal, named=bool(headers) or table.form.kind == "labels")
    columns, time, more = settle_roles(columns, time)
    header_rows = tuple(cells for _, cells in headers)
    numbers = frozenset(number for number, _ in headers)
    form = replace(table.form, stamped=stamped)
    return Layout(form, tuple(columns), time, first, numbers, header_rows, tuple(notes) + more)


def _candidate_lines(head: Sequence[str]) -> tuple[list[_Line], bool]:
    """Lines that may hold data, with their number; stamps split off where most lines begin with one."""
    lines = [_Line(i, text, "") for i, text in enumerate(head, 1) if not is_blank(text) and not is_comment(text)]
    split = [(line, split_stamp(line.text)) for line in lines]
    stamped = [_Line(line.number, parts[1], parts[0]) for line, parts in split if parts is not None]
    if stamped and len(stamped) > len(lines) / 2:
        return stamped, True
    return lines, False


def _likeness(cells: Cells, decimal: str) -> float:
    """Share of the cells that a data line may hold; 0 where none is a number."""
    numbers = sum(is_number(cell, decimal) for cell in cells)
    if not numbers:
        return 0.0
    others = sum(cell.lower() in MISSING or STAMP_SHAPE.fullmatch(cell) is not None for cell in cells)
    return (numbers + others) / len(cells)


def _best_table(lines: list[_Line]) -> _Table | None:
    candidates = [_labelled(lines)]
    for delimiter in _DELIMITERS:
        split = [(line.number, tuple(split_fields(line.text, delimiter))) for line in lines]
        for decimal in (".", ","):
            if decimal != delimiter:
                candidates.append(_as_table(split, LineFormat("table", delimiter, decimal)))
    found = [table for table in candidates if table is not None and table.score >= MIN_SHARE]
    return max(found, key=lambda table: _rank(lines, table), default=None)


def _rank(lines: list[_Line], table: _Table) -> tuple[float, bool, bool]:
    """Best score; of equals the one whose header has as many cells, then the one with the decimal point."""
    fits = _header_fits(lines, table)
    score = table.score
    if table.form.decimal == "," and table.width == 1 and not fits:
        # Any "12,5" is one number as well as two: the header must speak for the one.
        score /= 2
    return round(score, 6), fits, table.form.decimal == "."


def _as_table(split: list[tuple[int, Cells]], form: LineFormat) -> _Table | None:
    """The lines of the commonest width, weighed by how much they look like data."""
    likeness = {number: _likeness(cells, form.decimal) for number, cells in split}
    weight: defaultdict[int, float] = defaultdict(float)
    for number, cells in split:
        weight[len(cells)] += likeness[number]
    width = max(weight, key=lambda width: weight[width], default=0)
    if not width or not weight[width]:
        return None
    if len(split) >= UNIFORM_LINES and weight[width] < MIN_UNIFORM * sum(weight.values()):
        return None
    fitting = [(number, cells) for number, cells in split if len(cells) == width]
    best = max(likeness[number] for number, _ in fitting)
    rows = tuple((number, cells) for number, cells in fitting if likeness[number] >= best / 2)
    return _Table(weight[width] / len(split), form, width, rows)


def _labelled(lines: list[_Line]) -> _Table | None:
    """The lines of `name:value` pairs whose names come often and with numbers."""
    pairs = [(line.number, dict(found)) for line in lines if (found := split_labels(line.text))]
    count: defaultdict[str, int] = defaultdict(int)
    for _, found in pairs:
        for label, value in found.items():
            count[label] += is_number(value) or STAMP_SHAPE.fullmatch(value) is not None
    labels = tuple(label for label, n in count.items() if n and n >= 0.1 * len(pairs))
    rows = tuple(
        (number, tuple(found.get(label, "") for label in labels))
        for number, found in pairs
        if found.keys() <= set(labels)
    )
    rows = tuple(row for row in rows if _likeness(row[1], "."))
    if not rows:
        return None
    return _Table(len(rows) / len(lines), LineFormat("labels", ",", ".", labels), len(labels), rows)


def _header_fits(lines: list[_Line], table: _Table) -> bool:
    above = [line for line in lines if line.number < table.rows[0][0]]
    if not above or table.form.kind == "labels":
        return False
    cells = split_fields(above[-1].text, table.form.delimiter)
    whole = table.form.decimal != "," or not any("," in cell for cell in cells)
    return whole and len(cells) == table.width and _only_text(cells, table.form.decimal)


def _first_row(lines: list[_Line], table: _Table) -> int:
    """Number of the first data line: lines of missing values right above the first numbers belong to it."""
    first = table.rows[0][0]
    if table.form.kind == "labels":
        return first
    for line in reversed([line for line in lines if line.number < first]):
        cells = [cell.lower() for cell in split_fields(line.text, table.form.delimiter)]
        if len(cells) != table.width or not all(cell in MISSING for cell in cells) or not any(cells):
            break
        first = line.number
    return first


def _only_text(cells: Sequence[str], decimal: str) -> bool:
    """True where no cell is a number, a stamp or a missing value, and one is there at all."""
    return any(cells) and all(
        not cell
        or (not is_number(cell, decimal) and not STAMP_SHAPE.fullmatch(cell) and cell.lower() not in MISSING)
        for cell in cells
    )


def _read_header(
    head: Sequence[str], above: list[_Line], table: _Table, first: int
) -> tuple[tuple[tuple[int, Cells], ...], list[Column], list[str]]:
    """Header and units rows (number, cells), nearest to the data first; the columns; the notes."""
    form, width = table.form, table.width
    rows = [(line.number, tuple(split_fields(line.text, form.delimiter))) for line in reversed(above[-2:])]
    fits = [_only_text(cells, form.decimal) and _names_fit(cells, width) for _, cells in rows]
    if fits == [True, True] and len(rows[0][1]) == width and are_units(rows[0][1]):
        columns = _columns(rows[1][1], width)
        said = [
            replace(c, unit=bare_unit(unit)) if unit else c for c, unit in zip(columns, rows[0][1], strict=True)
        ]
        return (
            (rows[0], rows[1]),
            said,
            [_table_note(form), f"names from line {rows[1][0]}, units from line {rows[0][0]}"],
        )
    if fits and fits[0]:
        number, cells = rows[0]
        notes = [_table_note(form), f"names from line {number}"]
        if len(cells) != width:
            notes.append(f"line {number} holds {len(cells)} names for {width} columns")
        return (rows[0],), _columns(cells, width), notes
    commented = _commented_header(head, form, width, first)
    if commented is not None:
        return (
            (commented,),
            _columns(commented[1], width),
            [_table_note(form), f"names from comment line {commented[0]}"],
        )
    return (), [Column("") for _ in range(width)], [_table_note(form), "no header line"]


def _names_fit(names: Cells, width: int) -> bool:
    """R writes one name too few (the row names have none); some loggers write more names than values."""
    if width == 1:
        return len(names) == 1 and len(names[0]) <= 40  # a longer single cell is a sentence
    return len(names) == width or (width > 2 and width - 1 <= len(names) <= 2 * width)


def _commented_header(head: Sequence[str], form: LineFormat, width: int, first: int) -> tuple[int, Cells] | None:
    """The last comment above the data where it is a list of names, as `# time ax ay` of numpy.savetxt."""
    for number in range(first - 1, 0, -1):
        text = head[number - 1]
        if is_comment(text):
            names = tuple(split_fields(text.strip(" \t").lstrip("#%/").strip(), form.delimiter))
            listed = len(names) == width and all(_COMMENT_NAME.fullmatch(name) for name in names)
            return (number, names) if listed and _only_text(names, form.decimal) and width > 1 else None
    return None


def _table_note(form: LineFormat) -> str:
    mark = {"\t": "tabs", " ": "blanks"}.get(form.delimiter, f'"{form.delimiter}"')
    return f'columns are separated by {mark}, the decimal mark is "{form.decimal}"'


def _columns(names: Cells, width: int) -> list[Column]:
    if len(names) == width - 1:
        return [Column("", role="row name"), *(named_column(name) for name in names)]
    return [named_column(name) for name in names[:width]]
