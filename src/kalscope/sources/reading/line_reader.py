"""One line of a log whose layout is known: rows of numbers, a header, a comment, or why it is none of these.

The file reader, stdin and the live port all end here, so that a recording and the wire agree.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from kalscope.recording import MAX_ISSUE_LENGTH, LineIssue
from kalscope.sources.grammar.cells import (
    MISSING_WORDS,
    NumberForm,
    is_blank,
    is_comment,
    is_damaged,
    is_number,
    parse_number,
    split_fields,
)
from kalscope.sources.grammar.line_format import find_pairs, split_checksum, split_stamp, split_teleplot
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.grammar.timestamps import StampParser, row_stamp_parser, stamp_parser
from kalscope.sources.reading.columns import HOST_AND_DEVICE, MAX_SERIES
from kalscope.sources.reading.sniffer import MAX_STREAM_COLUMNS, Layout

Kind = Literal["row", "rejected", "blank", "comment", "header", "text"]
"""How a line was read; "text" is prose, not an attempt at data: boot text, a program's log."""

TAIL_LINES = 64
"""Rows before a last line without newline by which it is judged."""
_PAIR = re.compile(r"[:=] ?[-+.0-9]")
"""What a cell of another program has, `T:21.5`."""


@dataclass(frozen=True)
class LineEvent:
    """What one line holds."""

    number: int
    """Line number, from 1."""
    kind: Kind
    """How it was read."""
    text: str
    """The line, without its newline, cut at 200 characters."""
    rows: tuple[tuple[float, ...], ...] = ()
    """Rows of one value per column, in the order of the layout; NaN where missing or not read. One for a "row"
    line, except where one line of Teleplot holds several samples."""
    issues: tuple[LineIssue, ...] = ()
    """Why it was rejected, or which of its cells are missing samples."""
    missing: tuple[str, ...] = ()
    """Words in its cells that say "no sample", such as M or unavailable, beside the ordinary ones."""


class _Fault(Exception):
    """The line has the wrong shape; the message says what must hold."""


class LineReader:
    """Reads lines of one layout."""

    def __init__(self, layout: Layout, options: ReadOptions = DEFAULTS) -> None:
        self.layout = layout
        self._form = layout.form
        self._width = len(layout.columns)
        self._least = layout.least
        plain = NumberForm(layout.form.decimal)
        self._channels = channels = layout.channels
        self._parsers: dict[int, StampParser] = {i: (layout.columns[i].form or plain).parse for i in channels}
        self._silent = options.missing_texts
        self._numbers = frozenset((*options.missing_numbers, *map(plain.parse, self._silent))) - {None, math.nan}
        self._stamp = self._time = None
        if layout.time is not None:
            self._time = layout.time.index
            self._stamp = row_stamp_parser(layout.time, self._form.decimal)
            self._parsers[self._time] = stamp_parser(layout.time, self._form.decimal)
        self._series = [i for i, column in enumerate(layout.columns) if column.role == "series"]
        self.series: dict[tuple[str, ...], int] = {}
        """The names of a long table and their numbers, which are in its first "series" column."""
        self._before = -2
        """Fields of the row before; −1 at the first row."""
        self._number = 0
        self._text: str | None = None
        self._cells: list[str] = []
        self._issues: list[LineIssue] = []
        self._missing: list[str] = []

    def read(self, number: int, line: str) -> LineEvent:
        """Take one whole line, with or without its newline."""
        text = line.rstrip("\r\n")
        self._number, self._issues, self._missing = number, [], []
        kind, rows = self._kind_without_data(text), None
        if kind is None:
            try:
                rows = self._rows(text)
            except _Fault as fault:
                prose = len(text.split()) >= 4 and not any(map(str.isdigit, text))
                if self._form.kind != "table" or not (prose or self._are_words(self._split(text))):
                    return rejected(number, text, str(fault))
                kind, self._issues = "text", []
        kind = kind or ("text" if rows is None else "row")
        issues, missing = tuple(self._issues), tuple(self._missing)
        return LineEvent(number, kind, text[:MAX_ISSUE_LENGTH], rows or (), issues, missing)

    def _kind_without_data(self, text: str) -> Kind | None:
        if is_blank(text, self._form.delimiter if self._form.kind == "table" else ""):
            return "blank"
        if is_comment(text):
            return "comment"
        rows = self.layout.header_rows
        if rows and tuple(self._split(text)) in rows:
            return "header"
        is_name = self._form.kind == "teleplot" and (plot := split_teleplot(text)) and plot.only_names
        return "header" if is_name else None

    def _rows(self, text: str) -> tuple[tuple[float, ...], ...] | None:
        """The rows of a line; None for prose; _Fault for a wrong shape."""
        if is_damaged(text):
            which = "NUL" if "\0" in text else "control"
            raise _Fault(f"must be printable text (got {which} bytes)")
        head: list[str] = []
        if self._form.stamped:
            stamped = split_stamp(text)
            if stamped is None:
                raise _Fault("must begin with a stamp, as the other lines do")
            head, text = [stamped[0]], stamped[1]
        parts = split_checksum(text)
        if parts is None and self._form.checksum:
            raise _Fault("must end with its checksum, as the other lines do")
        if parts is not None:
            text, written, right = parts
            if written != right:
                raise _Fault(f"must end with the checksum *{right:02X} (got *{written:02X})")
        if self._form.kind == "teleplot":
            return self._teleplot(text)
        cells = self._split(text) if self._form.kind == "table" else self._labelled(text)
        return None if cells is None else (self._row(head + cells),)

    def _split(self, text: str) -> list[str]:
        """The cells of a line of a table; a line that is no header is not split twice."""
        if text is not self._text:
            self._text, self._cells = text, split_fields(text, self._form.delimiter)
        return self._cells

    def _are_words(self, cells: list[str]) -> bool:
        """Whether cells of a table of several columns are names or remarks, none a number; ERR,ERR is a row."""
        numeric = any(is_number(cell, self._form.decimal) or _PAIR.search(cell) for cell in cells)
        return self._width > 1 < len({*cells}) and not numeric and any(cell[:1].isalpha() for cell in cells)

    def _labelled(self, text: str) -> list[str] | None:
        """Cells in column order; a value without a column is an issue; None for prose."""
        labels = self._form.labels
        found = find_pairs(text)
        if found is None:
            bare = "".join(text.split())
            known = ("".join(label.split()) + mark for label in labels if label.strip() for mark in ":=")
            if any(text in bare for text in known) or bare.startswith("{"):
                raise _Fault("must be written as the other lines are")
            return None
        values = dict(found)
        if len(values) != len(found):
            raise _Fault("must hold each label once")
        lacking = [label for label in labels if label not in values]
        if len(lacking) == len(labels):
            if all(parse_number(value) is None for value in values.values()):
                return None
            raise _Fault(f"must hold one of the labels ({', '.join(labels[:8])})")
        if self._form.complete and lacking and not text.lstrip().startswith("{"):  # an object is not torn
            raise _Fault(f"must hold all labels, as the other lines do (got none of {', '.join(lacking[:8])})")
        for label, value in found:
            if label not in labels:
                self._report("must have a known label; it is left out", f"{label}:{value}", "")
        return [values.get(label, "") for label in labels]

    def _report(self, reason: str, text: str, column: str) -> None:
        self._issues.append(LineIssue(self._number, reason, text[:MAX_ISSUE_LENGTH], column))

    def _teleplot(self, text: str) -> tuple[tuple[float, ...], ...] | None:
        plot = split_teleplot(text)
        if plot is None:
            if not text.lstrip().startswith(">"):
                return None  # on a serial line Teleplot leaves all else to the program's log
            raise _Fault("must be >name:value or >name:ms:value")
        if not plot.samples:
            return None
        if plot.name not in self._form.labels:
            raise _Fault(f"must be of one of the first {MAX_STREAM_COLUMNS} names, or of one that was sent before")
        timed = self.layout.time is not None or self._width > len(self._form.labels)
        at = self._form.labels.index(plot.name) + timed
        rows: list[tuple[float, ...]] = []
        for stamp, value in plot.samples:
            if self._parsers[at](value) is None and value.lower() not in MISSING_WORDS:
                raise _Fault("must be a number, or a word for a missing one")
            cells = [stamp if timed else "", *[""] * (self._width - 1)]
            cells[at] = value
            rows.append(self._row(cells))
        return tuple(rows)

    def _row(self, cells: list[str]) -> tuple[float, ...]:
        cells = self._whole(cells)
        layout = self.layout
        values = [math.nan] * self._width
        if self._time is not None and self._stamp is not None:
            stamp = self._stamp(cells)
            if stamp is None:
                raise _Fault("must have a readable time stamp")
            values[self._time] = stamp
        if self._series:
            name = tuple(cells[i] for i in self._series)
            if name not in self.series and len(self.series) >= MAX_SERIES:
                raise _Fault(f"must be of one of the first {MAX_SERIES} names")
            values[self._series[0]] = self.series.setdefault(name, len(self.series))
        for i in self._channels:
            value = self.value(i, cells[i])
            if value is not None:
                values[i] = value
            elif cells[i].lower() in MISSING_WORDS:
                self._missing.append(cells[i])
            else:
                self._report("must be a number", cells[i], layout.columns[i].name)
        if self._issues and self._time is None and self._are_words([cells[i] for i in self._channels]):
            raise _Fault("must hold a number")
        return tuple(values)

    def value(self, column: int, cell: str) -> float | None:
        """The number in a cell that is read, or its stamp; NaN where it is missing; None for any other text."""
        value = self._parsers[column](cell)
        if value is None and column != self._time and cell[-1:] in ("*", "#") and cell[-2:-1].isdecimal():
            return self.value(column, cell[:-1].rstrip(" "))  # a mark of quality
        if value is None and column != self._time and cell.lower() in self._silent:
            return math.nan
        return math.nan if self._numbers and column != self._time and value in self._numbers else value

    def _whole(self, cells: list[str]) -> list[str]:
        """The cells of a row, one per column: an extra separator at the end removed, missing last cells added.

        One row that is too narrow was torn. Where the row before has its width, or there is none, it is from a
        time when the logger wrote fewer fields.
        """
        count, before = len(cells), self._before
        # The first row alone may hold more: what is the same in all.
        self._before = -1 if before == -2 and count == self._width else count
        if count == self._width + 1 and (not cells[-1] or is_comment(cells[-1])):
            return cells[:-1]
        if count < self._least and count in self.layout.narrow and before in (-2, -1, count):
            return cells + [""] * (self._width - count)
        if not self._least <= count <= self._width:
            raise _Fault(f"must have {self._width} fields (got {count})")
        return cells

    def read_last(self, number: int, line: str, before: Sequence[str]) -> LineEvent:
        """Take a last line that has no newline: a row where it holds as many values as the row before.

        It is torn where its last number has fewer decimals than that of all rows before it.

        Args:
            number: Its line number.
            line: The line.
            before: The lines before it, TAIL_LINES are plenty.
        """
        event = self.read(number, line)
        whole = event.kind == "row" and (split_checksum(line) is not None or self._is_whole(line, event, before))
        if whole or event.kind in ("blank", "comment"):
            return event
        return rejected(number, line, "must end with a newline (torn: the file ends inside this line)")

    def _is_whole(self, line: str, event: LineEvent, before: Sequence[str]) -> bool:
        rows = [(text, above) for text in before if (above := self.read(0, text)).kind == "row"]
        ours = any(column.name == HOST_AND_DEVICE[0] for column in self.layout.columns[:1])
        if ours or event.issues or not rows or _known(event) < _known(rows[-1][1]):
            return False  # our recorder ends each line
        usual = {_decimals(text, self._form.decimal) for text, _ in rows}
        return len(usual) > 1 or _decimals(line, self._form.decimal) >= max(usual)


def rejected(number: int, text: str, reason: str) -> LineEvent:
    """The event of a line of the wrong shape."""
    text = text.rstrip("\r\n")[:MAX_ISSUE_LENGTH]
    return LineEvent(number, "rejected", text, (), (LineIssue(number, reason, text),))


def _known(event: LineEvent) -> int:
    return sum(not math.isnan(value) for row in event.rows for value in row)


def _decimals(line: str, mark: str) -> int:
    """Digits after the decimal mark of the number that ends the line; 0 where none does."""
    whole, _, decimals = line.rstrip(' \t\r\n"').rpartition(mark)
    return len(decimals) if whole[-1:].isdecimal() and decimals.isdecimal() else 0
