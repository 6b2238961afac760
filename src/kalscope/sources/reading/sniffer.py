"""How a log is written, found from its first lines: delimiter, decimal mark, names, units, time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from kalscope.common.numbers import Array
from kalscope.recording import Assumption
from kalscope.sources.grammar.cells import NumberForm, parse_number, split_measure
from kalscope.sources.grammar.line_format import LineFormat, split_teleplot
from kalscope.sources.grammar.read_options import DEFAULTS, WORD_OF_DECIMAL, WORD_OF_DELIMITER, ReadOptions
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.reading.columns import (
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
from kalscope.sources.reading.headers import Header, join_quoted, named_by_settings, read_header, settings_of
from kalscope.sources.reading.preface import told_delimiter
from kalscope.sources.reading.table import (
    SCALE,
    Body,
    HeadTable,
    candidate_lines,
    candidate_tables,
    find_body,
    marked_begin,
    weigh,
)
from kalscope.sources.reading.time_columns import chosen_time, find_time, stamps_of

# Labels that come in turn, one or a few per line: `Temp: 21.5`, then `Hum: 40`, then the next `Temp`.


MIN_CYCLES = 4
"""How often all labels must come in turn."""
_MIN_COMPLETE = 0.9
"""Share of the turns that must hold every label."""
MAX_INSIDE = 0.25
"""Largest share of the time between two turns that may pass between the first and the last line of one."""


def leading_label(rows: Sequence[Cells], labels: Sequence[int], stamps: Array | None) -> int | None:
    """The label that begins each turn, an index into the cells; None where each line is a row of its own.

    Args:
        rows: Cells of the lines, "" where a line lacks the label.
        labels: Which of the cells hold values.
        stamps: Of the lines, shape (n,), NaN where unreadable; None where they have none.
    """
    held = [{i for i in labels if row[i]} for row in rows]
    first = next((i for i in labels if held and i in held[0]), None)
    begins = [k for k, here in enumerate(held) if first in here]
    if first is None or len(begins) < MIN_CYCLES or len(begins) > 0.75 * len(held):
        return None
    turns = [held[a:b] for a, b in pairwise(begins)]
    complete = sum(sorted(i for here in turn for i in here) == sorted(labels) for turn in turns)
    if complete < _MIN_COMPLETE * len(turns):
        return None
    if stamps is None:
        return first
    # Little time passes between the first line of a turn and the last.
    inside = np.array([stamps[b - 1] - stamps[a] for a, b in pairwise(begins)])
    between = np.diff(stamps[begins])
    known = np.isfinite(inside) & np.isfinite(between)
    is_turn = known.any() and float(np.median(inside[known])) <= MAX_INSIDE * float(np.median(between[known]))
    return first if is_turn else None


# The sentences that explain a layout, and that name another one that could be meant.


def explain(head: Sequence[str], table: HeadTable, plan: Plan, body: Body, second: HeadTable | None) -> list[str]:
    """How the lines are split, what is beside the data, and which other way comes close."""
    form = table.form
    notes = [f"written by {plan.preface.instrument}"] if plan.preface.instrument else []
    if form.kind == "table":
        mark = {"\t": "tabs", " ": "blanks"}.get(form.delimiter, f'"{form.delimiter}"')
        notes.append(f'columns are separated by {mark}, the decimal mark is "{form.decimal}"')
    if form.checksum:
        notes.append("each line ends with a checksum, which is checked")
    if form.stamped:
        notes.append("the stamp before each line is the time")
    if body.beside:
        notes.append(f"columns of metadata beside the data: {', '.join(str(i + 1) for i in sorted(body.beside))}")
    if table.narrow:
        fields = " or ".join(map(str, sorted(table.narrow)))
        notes.append(f"successive rows of {fields} fields lack the last columns, which the logger added later")
    if second is not None:
        other = second.form
        count = "1 column" if second.width == 1 else f"{second.width} columns"
        chosen = [f"--delimiter {WORD_OF_DELIMITER[other.delimiter]}"] if other.delimiter != form.delimiter else []
        chosen += [f"--decimal {WORD_OF_DECIMAL[other.decimal]}"] if other.decimal != form.decimal else []
        notes.append(Assumption(f"it could also be {count}: {' '.join(chosen)}"))
    if (factor := next(filter(None, map(SCALE.fullmatch, head[: body.first])), None)) is not None:
        notes.append(Assumption(f"the numbers are not multiplied by the {factor[1]} above them"))
    return notes


def _about_rows(rows: Sequence[Cells], channels: Sequence[int], decimal: str) -> list[str]:
    """The doubt whether columns without names hold one signal, written row by row: they look alike."""
    numbers = np.array([[parse_number(row[i], decimal) for i in channels] for row in rows], dtype=np.float64)
    numbers = numbers[np.isfinite(numbers).all(axis=1)] if len(channels) >= _MIN_ALIKE else numbers[:0]
    if len(numbers) < _MIN_ALIKE:
        return []
    spread, means = numbers.std(axis=0), numbers.mean(axis=0)
    if not (np.ptp(means) < _ALIKE * spread.min() and spread.max() < (1 + _ALIKE) * spread.min()):
        return []
    return [Assumption(f"the {len(channels)} columns look alike: are they one signal, written row by row?")]


def explain_doubt(name: str, form: NumberForm, rival: NumberForm, cells: Sequence[str]) -> str:
    """The question about a column whose numbers could be written in two ways."""
    example = next(cell for cell in cells if differ(form, rival, cell))
    return Assumption(
        f'is "{example}" in "{name}" {form.parse(example):.15g} or {rival.parse(example):.15g}?'
        f" The first was used; --decimal {WORD_OF_DECIMAL[rival.decimal]} selects the second"
    )


# How a log is written, found from its first lines: delimiter, decimal mark, header, units, time column.
#
# Pure functions on text. A file gives its units in the header (`accel (m/s^2)`, `t [us]`, `Distance_cm`), in a
# row of units below the header, or in comment lines of Kalscope's own convention above the data:
#
#     # unit volume: 1e8 m3


_MIN_ALIKE, _ALIKE = 4, 0.3
"""Columns, and rows, of one signal that is written row by row, and how little their means and spreads differ."""

MAX_COLUMNS = 256
"""A table wider than this is not a log of samples (a list per line, an image, one case per line)."""

MAX_STREAM_COLUMNS = MAX_COLUMNS - 1
"""Columns of a stream: its recording holds the time at which each line came as well, and is read as a file."""

_TELEPLOT_TIME = Column("time", "ms")


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
    offset: float = 0.0
    """Stamp of the first sample in s where no column is the time: an oscilloscope counts from its trigger."""
    lead: int | None = None
    """Column of the label that begins a row where several lines make up one; None where each line is a row."""

    @property
    def channels(self) -> list[int]:
        """Indices of the columns that are channels."""
        return [i for i, column in enumerate(self.columns) if column.role == "channel"]

    @property
    def least(self) -> int:
        """Fewest fields of a whole line: a spreadsheet's trailing empty columns may be left out."""
        roles = [column.role for column in self.columns]
        return max(1, *(i for i, role in enumerate(roles, 1) if role != "empty"), 1)


def sniff(
    head: Sequence[str], options: ReadOptions = DEFAULTS, samples: Sequence[Sequence[str]] = ()
) -> Layout | None:
    """Find how a log is written.

    Args:
        head: The first lines of the file (64 KiB are plenty), without their newlines.
        options: What is decided already.
        samples: Runs of whole lines from the middle and the end of the file, where there are any.

    Returns:
        None where fewer than MIN_SHARE of the lines look like data, or the head ends above the data.

    Raises:
        BadSetting: there is no such time column, or no such row.
    """
    head = join_quoted(head)
    plan = make_plan(head, options)
    if head and told_delimiter(head[0]):
        head[0] = ""  # no row of names
    lines, marks = candidate_lines(head, samples, marked_begin(head))
    table, second = weigh(lines, candidate_tables(lines, plan))
    if table is None or table.least > MAX_COLUMNS or table.rows[0][0] > len(head):
        return None
    form = replace(table.form, stamped=marks.stamped, checksum=marks.checksum)
    return _layout(head, plan, lines, replace(table, form=form), second)


def _layout(
    head: Sequence[str], plan: Plan, lines: list[HeadLine], table: HeadTable, second: HeadTable | None
) -> Layout | None:
    """The layout of a table among the lines of a file; None where its rows begin below the head."""
    kinds = CellKinds(table.form.decimal, plan.options.missing_texts, table.form.delimiter)
    body = find_body(lines, table, plan, kinds)
    if body.first > len(head):  # lines of the samples have no number of the file
        return None
    is_table = table.form.kind == "table"
    settings = settings_of(head, body.first)
    header = read_header(head, settings, table, body, plan, kinds) if is_table else _labelled_header(table, lines)
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
    time = _find_time(columns, cells, table, header, plan)
    columns = named_by_settings(settings, columns, time, table.form)
    above = sum(number < header.first for number, _ in table.rows) if is_table else 0
    lead = None
    if table.form.kind == "labels" and not table.form.complete:
        taken = time.indices if time else ()
        labels = [i for i, column in enumerate(columns) if column.role == "channel" and i not in taken]
        lead = leading_label(cells, labels, time and stamps_of(time, cells, table.form.decimal))
    columns, about_series = mark_series(columns, cells, time, table.form.decimal)
    named = [column.name for column in columns]
    columns, time, about_columns = settle_roles(columns, time)
    channels = [i for i, column in enumerate(columns) if column.role == "channel"]
    notes = (
        *explain(head, table, plan, body, second),
        *about_numbers,
        *([Assumption(f"{above} lines of numbers above the table are left out")] if above > 1 else []),
        *header.notes,
        *([] if lead is None else [f'several lines make up a row; "{columns[lead].name}" begins each']),
        *about_series,
        *about_columns,
        *(_about_rows(cells, channels, table.form.decimal) if time is None and not any(named) else ()),
        *plan.preface.notes,
    )
    return Layout(
        form=table.form,
        columns=tuple(columns),
        time=time,
        first_data=header.first,
        headers=frozenset(number for number, _ in header.rows),
        header_rows=tuple(cells for _, cells in header.rows),
        notes=notes,
        narrow=table.narrow,
        period=plan.preface.period,
        start=plan.preface.start,
        offset=plan.preface.offset,
        lead=lead,
    )


def _described(
    size: int, settings: dict[str, str], header: Header, body: Body, kinds: CellKinds, plan: Plan
) -> tuple[list[Column], list[str]]:
    """The columns with their units, roles and forms of numbers; sentences about forms that differ."""
    columns: list[Column] = []
    notes: list[str] = []
    inside = sum(number <= size for number, _ in body.rows)
    for i, column in enumerate(header.columns):
        cells, kind = [row[i] for _, row in body.rows], body.types[i]
        role = "metadata" if i in body.beside else role_of(column, cells[:inside], i, kind, len(body.types))
        form, rival = number_form(cells, kinds, plan.options.decimal) if role == "channel" else (None, None)
        name, form = column.name or f"column {i + 1}", None if form == NumberForm(kinds.decimal) else form
        if form is not None:
            notes.append(f'the numbers of "{name}" are written like {next(filter(form.fits, cells), "")!r}')
        if rival is not None:
            notes.append(explain_doubt(name, form or NumberForm(kinds.decimal), rival, cells))
        columns.append(
            replace(
                column,
                role=role,
                unit=settings.get(f"unit {column.name.lower()}", column.unit) or (form.suffix if form else ""),
                form=form,
                words=kind.words,
            )
        )
    return columns, notes


def _find_time(
    columns: list[Column], rows: list[Cells], table: HeadTable, header: Header, plan: Plan
) -> TimeColumn | None:
    choice = plan.options.time_column
    if choice is None and plan.preface.time_column is not None:
        choice = plan.preface.time_column if plan.preface.time_column >= 0 else "none"
    if choice is not None:
        labels = header.rows[-1][1] if header.rows else ()
        time = chosen_time(columns, rows, table.form.decimal, choice, labels, plan.options)
    else:
        named = any(column.name for column in columns) or table.form.kind != "table"
        # A field that was added later cannot be the time of the rows before.
        least = min(table.narrow, default=len(columns))
        rows = [row[:least] for row in rows]
        time = find_time(columns[:least], rows, table.form.decimal, named=named, options=plan.options)
    if time is None and choice is None and columns[0] == _TELEPLOT_TIME and table.form.kind == "teleplot":
        time = TimeColumn(0, "number", "ms")  # so few lines may not show it: they may all be of one moment
    if time is not None and time.kind == "number" and plan.preface.time_unit:
        time = replace(time, unit=plan.preface.time_unit)
    return time


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
