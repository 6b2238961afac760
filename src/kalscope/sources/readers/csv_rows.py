"""The lines of a log into rows of numbers, every line in exactly one count."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from kalscope.common.progress import Progress
from kalscope.sources.lines.cells import is_blank, is_number
from kalscope.sources.lines.line_format import plain_row_parser
from kalscope.sources.lines.line_reader import TAIL_LINES, LineEvent, LineReader
from kalscope.sources.lines.read_options import DEFAULTS, ReadOptions
from kalscope.sources.lines.timestamps import LARGEST_STAMP
from kalscope.sources.readers.text_file import last_lines, open_text

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from kalscope.recording import LineIssue
    from kalscope.sources.lines.sniffer import Layout

MAX_ISSUES = 100
"""Issues kept word for word; all are counted."""

LINES_PER_LOOK = 16_384
"""Lines between two looks at progress and cancel: some 30 ms."""


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
    ending: str = ""
    """A sentence about a last line without newline; "" where it has one."""

    def take(self, event: LineEvent) -> None:
        """Count one line and keep its issues, up to MAX_ISSUES."""
        if event.kind == "row":
            self.rows += 1
            self.bad_cells += len(event.issues)
        elif event.kind == "rejected":
            self.rejected += 1
        elif event.kind == "blank":
            self.blank += 1
        elif event.kind == "header":
            self.headers += 1
        else:
            self.comments += 1
        self.issues.extend(event.issues[: MAX_ISSUES - len(self.issues)])

    def take_last(self, event: LineEvent) -> None:
        """Count a last line that has no newline, and say what became of it."""
        self.take(event)
        if event.kind == "rejected":
            self.ending = f"line {event.number}, the last, is torn: it has no newline, and was left out"
        elif event.kind == "row":
            self.ending = (
                f"line {event.number}, the last, has no newline; it was kept, because its last number has as many"
                " decimals as all before, or its checksum is right"
            )


def read_rows(
    data: bytes, encoding: str, layout: Layout, options: ReadOptions = DEFAULTS, progress: Progress | None = None
) -> tuple[NDArray[np.float64], Tally]:
    """All rows, shape (rows, width), NaN in the columns that are not read, and the account."""
    tally, progress, width = Tally(), progress or Progress(), len(layout.columns)
    rows = TeleplotRows(layout) if layout.form.kind == "teleplot" else Rows(layout)
    fast, reader = fast_parser(layout, options), LineReader(layout, options.without_numbers())
    number = 0
    text = open_text(data, encoding)
    for number, line in enumerate(text, 1):
        if number % LINES_PER_LOOK == 0:
            progress(text.buffer.tell() / len(data), "reading")
        if number < layout.first_data:
            count_preamble(number, line, layout, tally)
            continue
        values = fast(line)
        if values is not None:
            tally.rows += 1
            rows.out.extend(values)
        elif line.endswith("\n"):
            event = reader.read(number, line)
            tally.take(event)
            rows.add(event)
        else:
            event = reader.read_last(number, line, last_lines(data, encoding, TAIL_LINES))
            tally.take_last(event)
            rows.add(event, last=True)
    tally.lines = number
    rows.finish()
    return np.frombuffer(rows.out, dtype=np.float64).reshape(-1, width), tally


class Rows:
    """Collects the rows of a log, flat."""

    def __init__(self, layout: Layout) -> None:
        self.out = array("d")
        # The sensor did sample then: without time a rejected line keeps the place of its sample.
        self._gap = [math.nan] * len(layout.columns) if layout.time is None else []

    def add(self, event: LineEvent, *, last: bool = False) -> None:
        """Take what a line brings; a rejected last line has no neighbours whose places it could keep."""
        for row in event.rows:
            self.out.extend(row)
        if event.kind == "rejected" and not last:
            self.out.extend(self._gap)

    def finish(self) -> None:
        """All lines were added."""


class TeleplotRows(Rows):
    """Gathers the variables of Teleplot, one a line, into rows: those of one stamp, or one of each name."""

    def __init__(self, layout: Layout) -> None:
        super().__init__(layout)
        self._time = None if layout.time is None else layout.time.index
        self._row: list[float] = []

    def add(self, event: LineEvent, *, last: bool = False) -> None:  # noqa: ARG002 (no gaps here)
        """Take the samples of a line; a rejected one leaves no gap, because others make up the row."""
        for row in event.rows:
            if self._row and self._belongs(row):
                self._row = [a if math.isnan(b) else b for a, b in zip(self._row, row, strict=True)]
            else:
                self.finish()
                self._row = list(row)

    def _belongs(self, row: tuple[float, ...]) -> bool:
        if self._time is not None and row[self._time] != self._row[self._time]:
            return False
        pairs = enumerate(zip(self._row, row, strict=True))
        return all(math.isnan(a) or math.isnan(b) or i == self._time for i, (a, b) in pairs)

    def finish(self) -> None:
        """The row at hand is complete."""
        self.out.extend(self._row)
        self._row = []


def count_preamble(number: int, line: str, layout: Layout, tally: Tally) -> None:
    """Count a line above the first data line."""
    if is_blank(line, layout.form.delimiter):
        tally.blank += 1
    elif number in layout.headers:
        tally.headers += 1
    else:
        tally.comments += 1  # comments and boot text


def fast_parser(layout: Layout, options: ReadOptions) -> Callable[[str], list[float] | None]:
    """The fast path, where every column is a number; stamps out of range are left to the slow path."""
    time = layout.time
    words = any(is_number(text, layout.form.decimal) for text in options.missing_texts)
    if words or any(column.role == "text" for column in layout.columns) or (time and time.kind != "number"):
        return lambda _: None
    parse = plain_row_parser(layout.form, len(layout.columns))
    if time is None:
        return parse
    index = time.index

    def checked(line: str) -> list[float] | None:
        values = parse(line)
        return values if values is not None and abs(values[index]) <= LARGEST_STAMP else None

    return checked
