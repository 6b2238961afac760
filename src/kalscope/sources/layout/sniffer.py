"""How a log is written, found from its first lines: delimiter, decimal mark, header, units, time column.

Pure functions on text. A file says its units in the header (`accel (m/s^2)`, `t [us]`, `Distance_cm`), in a
row of units below the header, or in comment lines of Kalscope's own convention above the data:

    # unit volume: 1e8 m3
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from kalscope.sources.grammar.cells import is_comment
from kalscope.sources.grammar.line_format import LineFormat, split_teleplot
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.layout.columns import Cells, Column, named_column, role_of, settle_roles
from kalscope.sources.layout.headers import Header, read_header
from kalscope.sources.layout.tables import HeadLine, HeadTable, best_table, candidate_lines
from kalscope.sources.layout.time.time_column import chosen_time, find_time

MAX_COLUMNS = 256
"""A table wider than this is no log of samples (a list per line, an image, one case per line)."""

_MAX_COMMENT_LENGTH = 400


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

    @property
    def channels(self) -> list[int]:
        """Indices of the columns that are channels."""
        return [i for i, column in enumerate(self.columns) if column.role == "channel"]


def sniff(head: Sequence[str], options: ReadOptions = DEFAULTS) -> Layout | None:
    """Find how a log is written.

    Args:
        head: The first lines of the file (64 KiB are plenty), without their newlines.
        options: What is decided already.

    Returns:
        None where fewer than MIN_SHARE of the lines look like data.

    Raises:
        BadSetting: there is no such time column.
    """
    lines, marks = candidate_lines(list(head))
    table = best_table(lines, options)
    if table is None or table.width > MAX_COLUMNS:
        return None
    if table.form.kind == "table":
        header = read_header(head, lines, table, options.header)
    else:
        header = _labelled_header(table, lines)
    said = dict(filter(None, map(_unit_comment, head)))
    rows = [(number, cells) for number, cells in table.rows if number >= header.first]
    columns = [replace(column, unit=said.get(column.name, column.unit)) for column in header.columns]
    cells = [cells for _, cells in rows]
    columns = [
        replace(column, role=role_of(column, cells, i, table.form.decimal)) for i, column in enumerate(columns)
    ]
    if not header.rows and table.form.kind == "table":
        columns = _in_their_places(columns)
    notes = list(header.notes)
    if marks.checksum:
        notes.append("each line ends with a checksum, which is checked")
    if marks.stamped:
        stamps = {line.number: line.stamp for line in lines}
        cells = [(stamps[number], *row) for number, row in rows]
        columns.insert(0, Column("time"))
        notes.append("the Arduino IDE's stamp before each line is the time")
    time = _find_time(columns, cells, table, header, options)
    columns, time, more = settle_roles(columns, time)
    return Layout(
        form=replace(table.form, stamped=marks.stamped, checksum=marks.checksum),
        columns=tuple(columns),
        time=time,
        first_data=header.first,
        headers=frozenset(number for number, _ in header.rows),
        header_rows=tuple(cells for _, cells in header.rows),
        notes=(*notes, *more),
    )


def _unit_comment(line: str) -> tuple[str, str] | None:
    """(name, unit) of `# unit volume: 1e8 m3`; None for any other line."""
    if len(line) > _MAX_COMMENT_LENGTH or not is_comment(line):
        return None
    words = line.strip().lstrip("#%/").split(None, 1)
    if len(words) < 2 or words[0].lower() != "unit":
        return None
    name, _, unit = (part.strip() for part in words[1].partition(":"))
    return (name, unit) if name and unit else None


def _find_time(
    columns: list[Column], rows: list[Cells], table: HeadTable, header: Header, options: ReadOptions
) -> TimeColumn | None:
    if options.time_column is not None:
        labels = header.rows[-1][1] if header.rows else ()
        return chosen_time(columns, rows, table.form.decimal, options.time_column, labels, options)
    named = bool(header.rows) or table.form.kind != "table"
    return find_time(columns, rows, table.form.decimal, named=named, options=options)


def _in_their_places(columns: list[Column]) -> list[Column]:
    """Only columns behind the last number are empty: `1,,3` has a second channel that is missing as yet."""
    last = max((i for i, column in enumerate(columns) if column.role != "empty"), default=-1)
    return [replace(c, role="channel") if c.role == "empty" and i < last else c for i, c in enumerate(columns)]


def _labelled_header(table: HeadTable, lines: list[HeadLine]) -> Header:
    """Names and units that the data lines bring themselves."""
    if table.form.kind == "labels":
        columns = [named_column(label) for label in table.form.labels]
        return Header(tuple(columns), (), table.rows[0][0], ("each line holds name:value pairs",))
    units = {plot.name: plot.unit for line in lines if (plot := split_teleplot(line.text)) and plot.unit}
    columns = [Column(name, units.get(name, "")) for name in table.form.labels]
    if table.width > len(columns):
        columns.insert(0, Column("time", "ms"))
    return Header(tuple(columns), (), table.rows[0][0], ("each line is one variable of Teleplot",))
