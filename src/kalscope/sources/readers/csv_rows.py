"""The lines of a log into rows of numbers, every line in exactly one count."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from kalscope.common.array import Array
from kalscope.common.progress import Progress
from kalscope.recording import MAX_ISSUES, LineIssue
from kalscope.sources.grammar.cells import is_blank
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.layout.sniffer import Layout
from kalscope.sources.lines.line_reader import TAIL_LINES, Kind, LineEvent, LineReader
from kalscope.sources.readers.plain_block import block_parser
from kalscope.sources.readers.text_file import open_text

MAX_WORDS = 8
"""Words that say "no sample" of which the report gives the count."""

BLOCK_SIZE = 1 << 18
"""Characters read at once, between two progress reports."""

BLOCK_PARTS = 8
"""A block that is not plain is tried again in so many parts, and these in parts, down to single lines."""


@dataclass
class Tally:
    """The counts of a ReadReport while they grow."""

    lines: Counter[Kind] = field(default_factory=Counter["Kind"])
    """Lines of each kind."""
    bad_cells: int = 0
    """Cells of rows that are no number."""
    issues: list[LineIssue] = field(default_factory=list["LineIssue"])
    """The first MAX_ISSUES."""
    missing: Counter[str] = field(default_factory=Counter[str])
    """Cells of each word that says "no sample", beside the ordinary ones."""
    series: tuple[tuple[str, ...], ...] = ()
    """The names of a long table, in the order of their numbers."""
    ending: str = ""
    """A sentence about a last line without newline; "" where it has one."""

    def take(self, event: LineEvent) -> None:
        """Count one line and keep its issues, up to MAX_ISSUES."""
        self.lines[event.kind] += 1
        if event.kind == "row":
            self.bad_cells += len(event.issues)
            self.missing.update(event.missing)
        self.issues.extend(event.issues[: MAX_ISSUES - len(self.issues)])

    @property
    def notes(self) -> list[str]:
        """Sentences about words that say "no sample" and about a last line without newline."""
        said = [
            f'"{word}" is a missing sample: {count} {"cell" if count == 1 else "cells"}'
            for word, count in self.missing.most_common(MAX_WORDS)
        ]
        return [*said, *([self.ending] if self.ending else [])]

    def take_last(self, event: LineEvent) -> None:
        """Count a last line that has no newline, and note what became of it."""
        self.take(event)
        if event.kind == "rejected":
            self.ending = f"line {event.number}, the last, is torn: it has no newline and was left out"
        elif event.kind == "row":
            self.ending = (
                f"line {event.number}, the last, has no newline; it was kept, because its last number has as many"
                " decimals as all before, or its checksum is right"
            )


def read_rows(
    path: Path, encoding: str, layout: Layout, options: ReadOptions = DEFAULTS, progress: Progress | None = None
) -> tuple[Array, Tally]:
    """All rows, shape (rows, width), NaN in the columns that are not read, and the account."""
    reader = _TableReader(layout, options)
    size, progress = path.stat().st_size, progress or Progress()
    with path.open("rb") as file:
        text = open_text(file, encoding)
        while lines := text.readlines(BLOCK_SIZE):
            progress(file.tell() / size, "reading")
            reader.take(lines)
    return reader.finish(), reader.tally


class _TableReader:
    """Takes the lines of a log in blocks: plain rows at once, all others one by one."""

    def __init__(self, layout: Layout, options: ReadOptions) -> None:
        self.tally = Tally()
        self._layout = layout
        is_gathered = layout.form.kind == "teleplot" or layout.lead is not None
        self._rows = GatheredRows(layout) if is_gathered else Rows(layout)
        self._parse = block_parser(layout, options)
        self._reader = LineReader(layout, options.without_numbers())
        self._above: list[str] = []

    def take(self, lines: list[str]) -> None:
        """Take the next lines, of which only the last of the file may lack its newline."""
        number = self.tally.lines.total() + 1
        preamble = min(max(self._layout.first_data - number, 0), len(lines))
        for i in range(preamble):
            self.tally.lines[_kind_above_data(number + i, lines[i], self._layout)] += 1
        whole = len(lines) - (not lines[-1].endswith("\n"))
        self._take_rows(lines[preamble:whole], number + preamble)
        self._above = [*self._above, *lines[max(0, whole - TAIL_LINES) : whole]][-TAIL_LINES:]
        if preamble <= whole < len(lines):
            event = self._reader.read_last(number + whole, lines[-1], self._above)
            self.tally.take_last(event)
            self._rows.add(event, last=True)

    def finish(self) -> Array:
        """The rows, shape (rows, width)."""
        self._rows.finish()
        self.tally.series = tuple(self._reader.series)
        return np.frombuffer(self._rows.out, dtype=np.float64).reshape(-1, len(self._layout.columns))

    def _take_rows(self, lines: list[str], number: int) -> None:
        """Take whole lines, the first of which is line `number`; a block with other lines in parts."""
        if not lines:
            return
        if self._parse is None:
            for i, line in enumerate(lines, number):
                self._take_line(i, line)
        elif (rows := self._parse(lines)) is not None and self._reader.may_follow(rows.fields):
            self.tally.lines["row"] += len(lines)
            self._reader.skip(rows.fields)
            self._rows.out.frombytes(rows.values.data.cast("B"))
        elif len(lines) == 1:
            self._take_line(number, lines[0])
        else:
            part = -(-len(lines) // BLOCK_PARTS)
            for start in range(0, len(lines), part):
                self._take_rows(lines[start : start + part], number + start)

    def _take_line(self, number: int, line: str) -> None:
        event = self._reader.read(number, line)
        self.tally.take(event)
        self._rows.add(event)


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


class GatheredRows(Rows):
    """Gathers labels that come in turn, on several lines, into rows; those of Teleplot by their stamps as well."""

    def __init__(self, layout: Layout) -> None:
        super().__init__(layout)
        self._time = None if layout.time is None else layout.time.index
        self._lead = layout.lead
        self._row: list[float] = []

    def add(self, event: LineEvent, *, last: bool = False) -> None:  # noqa: ARG002 (no gaps here)
        """Take the samples of a line; a rejected one leaves no gap, because others make up the row."""
        for row in event.rows:
            if self._row and self._belongs(row):
                self._row = [b if math.isnan(a) else a for a, b in zip(self._row, row, strict=True)]
            else:
                self.finish()
                self._row = list(row)

    def _belongs(self, row: tuple[float, ...]) -> bool:
        if self._lead is not None:
            if not math.isnan(row[self._lead]):
                return False
        elif self._time is not None and row[self._time] != self._row[self._time]:
            return False
        pairs = enumerate(zip(self._row, row, strict=True))
        return all(math.isnan(a) or math.isnan(b) or i == self._time for i, (a, b) in pairs)

    def finish(self) -> None:
        """The row at hand is complete."""
        self.out.extend(self._row)
        self._row = []


def _kind_above_data(number: int, line: str, layout: Layout) -> Kind:
    """What a line above the first data line is."""
    if is_blank(line, layout.form.delimiter):
        return "blank"
    return "header" if number in layout.headers else "text"
