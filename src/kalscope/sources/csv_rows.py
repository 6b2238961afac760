"""The lines of a log into rows of numbers, every line in exactly one count."""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kalscope.recording import LineIssue
from kalscope.sources.line_parser import (
    is_blank,
    is_comment,
    parse_number,
    plain_row_parser,
    split_fields,
    split_line,
)
from kalscope.sources.sniffer import Layout
from kalscope.sources.text_file import open_text
from kalscope.sources.timestamps import LARGEST_STAMP, parse_clock, stamp_parser

MAX_ISSUES = 100
"""Issues kept word for word; all are counted."""

_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")


@dataclass
class Tally:
    """The counts of a ReadReport while they grow."""

    lines: int = 0
    rows: int = 0
    rejected: int = 0
    blank: int = 0
    comments: int = 0
    headers: int = 0
    bad_cells: int = 0
    issues: list[LineIssue] = field(default_factory=list)

    def note_issue(self, line: int, reason: str, text: str, column: str | None = None) -> None:
        """Keep one issue, up to MAX_ISSUES."""
        if len(self.issues) < MAX_ISSUES:
            self.issues.append(LineIssue(line, reason, text.rstrip("\n")[:200], column))


def read_rows(data: bytes, encoding: str, layout: Layout) -> tuple[NDArray[np.float64], Tally]:
    """All rows, shape (rows, width), NaN in the columns that are not read, and the account."""
    tally, out, width = Tally(), array("d"), len(layout.columns)
    gap = [math.nan] * width if layout.time is None else []
    fast = _fast_parser(layout)
    slow = _SlowParser(layout, tally)
    number = 0
    for number, line in enumerate(open_text(data, encoding), 1):
        if number >= layout.first_data:
            values = fast(line)
            if values is None:
                values = slow(number, line)
                if values is None:
                    continue
            tally.rows += bool(values)
            out.extend(values or gap)
        elif is_blank(line, layout.form.delimiter):
            tally.blank += 1
        elif number in layout.headers:
            tally.headers += 1
        else:
            tally.comments += 1  # comments and boot text
    tally.lines = number
    return np.frombuffer(out, dtype=np.float64).reshape(-1, width), tally


def _fast_parser(layout: Layout) -> Callable[[str], list[float] | None]:
    """The fast path, where every column is a number; stamps out of range are left to the slow path."""
    time = layout.time
    if any(column.role == "text" for column in layout.columns) or (time and time.kind != "number"):
        return lambda _: None
    parse = plain_row_parser(layout.form, len(layout.columns))
    if time is None:
        return parse
    index = time.index

    def checked(line: str) -> list[float] | None:
        values = parse(line)
        return values if values is not None and abs(values[index]) <= LARGEST_STAMP else None

    return checked


class _SlowParser:
    """Takes any line apart and gives it its place in the account."""

    def __init__(self, layout: Layout, tally: Tally) -> None:
        self.layout = layout
        self.tally = tally
        self.width = len(layout.columns)
        self.channels = [i for i, column in enumerate(layout.columns) if column.role == "channel"]
        self.parse_stamp = stamp_parser(layout.time, layout.form.decimal) if layout.time else None

    def __call__(self, number: int, line: str) -> list[float] | None:
        """Numbers of a row; [] for a rejected line; None for a blank, a comment or a header."""
        layout, tally = self.layout, self.tally
        if is_blank(line, layout.form.delimiter):
            tally.blank += 1
            return None
        if is_comment(line):
            tally.comments += 1
            return None
        if layout.header_rows and tuple(split_fields(line, layout.form.delimiter)) in layout.header_rows:
            tally.headers += 1
            return None
        cells, fault = self._cells(line)
        stamp = self._stamp(cells) if not fault else None
        if stamp is None:
            tally.rejected += 1
            tally.note_issue(number, fault or "must have a readable time stamp", line)
            return []
        return self._row(number, cells, stamp)

    def _cells(self, line: str) -> tuple[list[str], str]:
        """Cells of a line of the right shape, or what is wrong with it."""
        if not line.endswith("\n"):
            return [], "must end with a newline (torn: the file ends inside this line)"
        if _CONTROL.search(line):
            # Damaged on the wire or on the disk: nor can the other cells be trusted.
            return [], "must be printable text (got control bytes)"
        cells = split_line(line, self.layout.form)
        if cells is None:
            return [], "must be written as the other lines are"
        if len(cells) != self.width:
            return [], f"must have {self.width} fields (got {len(cells)})"
        return cells, ""

    def _stamp(self, cells: list[str]) -> float | None:
        """The stamp in the unit of its column, NaN where there is no time column, None where unreadable."""
        time = self.layout.time
        if time is None or self.parse_stamp is None:
            return math.nan
        stamp = self.parse_stamp(cells[time.index])
        if stamp is None or time.clock_index is None:
            return stamp
        clock = parse_clock(cells[time.clock_index])
        return None if clock is None else stamp + clock

    def _row(self, number: int, cells: list[str], stamp: float) -> list[float]:
        values = [math.nan] * self.width
        for i in self.channels:
            value = parse_number(cells[i], self.layout.form.decimal)
            if value is None:
                self.tally.bad_cells += 1
                self.tally.note_issue(number, "must be a number", cells[i], self.layout.columns[i].name)
            else:
                values[i] = value
        if self.layout.time is not None:
            values[self.layout.time.index] = stamp
        return values
