"""The lines of a log as rows of numbers, every line in exactly one count."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from kalscope.common.files import MEMORY_FACTOR, require_memory
from kalscope.common.numbers import Array
from kalscope.common.progress import Progress
from kalscope.recording import MAX_ISSUES, LineIssue
from kalscope.sources.grammar.cells import is_blank, is_number
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.reading.kernels import CELL, NUMBER, TEXT, RowForm, read_plain_rows
from kalscope.sources.reading.line_reader import TAIL_LINES, Kind, LineEvent, LineReader
from kalscope.sources.reading.sniffer import Layout
from kalscope.sources.reading.text_file import open_text, read_line

BLOCK_SIZE = 1 << 19
"""Characters read at once, between two progress reports."""
MAX_BYTES_BY_LINE = 1 << 15
"""A file up to this size is read line by line, in less time than the compiled loops take to load."""


@dataclass
class Tally:
    """The counts of a ReadReport while they grow."""

    lines: Counter[Kind] = field(default_factory=Counter["Kind"])
    """Lines of each kind."""
    bad_cells: int = 0
    """Cells of rows that are not numbers."""
    issues: list[LineIssue] = field(default_factory=list["LineIssue"])
    """The first MAX_ISSUES."""
    bad_columns: Counter[str] = field(default_factory=Counter[str])
    """The same by the name of their column."""
    missing: Counter[str] = field(default_factory=Counter[str])
    """Cells of each word that says "no sample", beside the ordinary ones."""
    series: tuple[tuple[str, ...], ...] = ()
    """The names of a long table, in the order of their numbers."""
    ending: str = ""
    """A sentence about a last line without newline; "" where it has one."""

    def take(self, event: LineEvent, *, last: bool = False) -> LineEvent:
        """Count one line and keep its issues, up to MAX_ISSUES; the `last` one has no newline."""
        self.lines[event.kind] += 1
        if event.missing:
            self.missing.update(event.missing)
        if event.issues and event.kind == "row":
            self.bad_cells += len(event.issues)
            self.bad_columns.update(issue.column for issue in event.issues if issue.column)
        self.issues.extend(event.issues[: MAX_ISSUES - len(self.issues)])
        what = {"rejected": "it is torn and was left out", "row": "it was kept, because it has all its values"}
        if last and event.kind in what:
            self.ending = f"line {event.number}, the last, has no newline: {what[event.kind]}"
        return event

    @property
    def notes(self) -> list[str]:
        """Sentences about words that say "no sample" and about a last line without newline."""
        often = self.missing.most_common(8)
        said = [f'"{word}" is a missing sample: {n} {"cell" if n == 1 else "cells"}' for word, n in often]
        return [*said, *([self.ending] if self.ending else [])]


def read_rows(
    path: Path, encoding: str, layout: Layout, options: ReadOptions = DEFAULTS, progress: Progress | None = None
) -> tuple[list[Array], Tally]:
    """All columns, each of shape (rows,), empty where not read; and the account.

    Raises:
        NoMemory: there will not be enough memory for them, by what the first ones take.
    """
    size, progress = path.stat().st_size, progress or Progress()
    reader, checked = _TableReader(layout, options, by_line=size <= MAX_BYTES_BY_LINE), 0
    # The next block is read and decoded on another thread while the loops, which release the GIL, parse this one.
    with path.open("rb") as file, ThreadPoolExecutor(1) as ahead:
        text = open_text(file, encoding)
        block = ahead.submit(_read_block, text)
        while data := block.result():
            progress(file.tell() / size, "reading")
            block = ahead.submit(_read_block, text)
            reader.take(data, growing=not data.endswith(b"\n") and path.stat().st_size > size)
            if 1.5 * checked < file.tell() < size:  # the free memory takes as long to find as 200 rows
                checked = file.tell()
                reader.rows.require_room(checked, size, path.name)
    reader.tally.series = tuple(reader.reader.series)
    return reader.rows.finish(), reader.tally


def _read_block(text: TextIO) -> bytes:
    """The next whole lines, of which only the last of the file may lack its newline; b"" at the end."""
    return (text.read(BLOCK_SIZE) + read_line(text)).encode()


class _TableReader:
    """Takes the lines of a log in blocks: compiled loops read plain cells, the line reader all else."""

    def __init__(self, layout: Layout, options: ReadOptions, *, by_line: bool) -> None:
        self.tally = Tally()
        self._layout = layout
        self.rows = Rows(layout)
        self.reader = LineReader(layout, options.without_numbers())
        self._form = None if by_line else row_form(layout, options, self.reader)
        width = len(layout.columns)
        # 2 MiB of numbers at once fit a processor's cache.
        self._out = np.empty((0 if self._form is None else max(16, (1 << 18) // width), width))
        self._odd = np.empty((max(1 << 14, width + 1), 4), dtype=np.int64)
        self._number = 1
        self._above = b""

    def take(self, data: bytes, *, growing: bool = False) -> None:
        """Take the next lines, UTF-8, of which only the last of the file may lack its newline.

        The last line of a file that grows is still being written.
        """
        at, whole = 0, data.rfind(b"\n") + 1
        while at < len(data) and self._number < self._layout.first_data:
            line, at = _line_at(data, at)
            kind: Kind = "header" if self._number in self._layout.headers else "text"
            self.tally.lines["blank" if is_blank(line, self._layout.form.delimiter) else kind] += 1
            self._number += 1
        lines = np.frombuffer(data, dtype=np.uint8, count=whole)
        while at < whole and self._form is not None:
            at = self._take_block(data, lines, at, self._form)
        while at < whole:
            line, at = _line_at(data, at)
            self.rows.add(self.rows.of(self.tally.take(self.reader.read(self._number, line))))
            self._number += 1
        if at < len(data):
            above = (self._above + data[:whole]).decode().split("\n")[-1 - TAIL_LINES : -1]
            event = self.reader.read_last(self._number, data[whole:].decode(), [] if growing else above)
            # A rejected last line has no neighbours whose places it could keep.
            self.rows.add(self.tally.take(event, last=True).rows)
        self._above = data

    def _take_block(self, data: bytes, lines: NDArray[np.uint8], at: int, form: RowForm) -> int:
        """Take many lines at once, one row each, but for those that are none; the place after them."""
        count, end, odd = read_plain_rows(lines, at, form, self._out, self._odd)
        kept, whole = np.ones(count, dtype=np.bool_), set[int]()
        for row, column, first, last in self._odd[:odd].tolist():
            if row in whole:
                continue
            value = None if column < 0 else self.reader.value(column, data[first:last].decode().rstrip(" \t"))
            if value is not None:
                self._out[row, column] = value
                continue
            line, _ = _line_at(data, data.rfind(b"\n", 0, first) + 1)
            rows = self.rows.of(self.tally.take(self.reader.read(self._number + row, line)))
            whole.add(row)
            kept[row] = bool(rows)
            self._out[row] = rows[0] if rows else math.nan
        self._number += count
        self.tally.lines["row"] += count - len(whole)
        self.rows.extend(self._out[:count] if kept.all() else self._out[:count][kept])
        return end


def row_form(layout: Layout, options: ReadOptions, reader: LineReader) -> RowForm | None:
    """How the compiled loops read the rows of a layout; None where each line needs the line reader."""
    form, time = layout.form, layout.time
    read = [*layout.channels, *([] if time is None else [time.index])]
    if (
        (form.kind, form.stamped, form.checksum) != ("table", False, False)
        or layout.narrow
        or form.decimal == form.delimiter  # inside quotes
        or (time is not None and time.parts)
        or any(column.role == "series" for column in layout.columns)
        # A header may come again, and hold only numbers: `state,2019,2020`.
        or any(all(reader.value(i, row[i]) is not None for i in read if i < len(row)) for row in layout.header_rows)
    ):
        return None
    plain = not any(is_number(text, form.decimal) for text in options.missing_texts)
    plain_stamp = time is None or time.kind == "number"
    reads = [TEXT] * len(layout.columns)
    for i in read:
        by_loop = plain and layout.columns[i].form is None and (plain_stamp or i != read[-1])
        reads[i] = NUMBER if by_loop else CELL
    return RowForm(
        marks=(ord(form.delimiter), ord(form.decimal)),
        reads=np.array(reads, dtype=np.uint8),
        fields=(layout.least, len(reads) + (form.delimiter != " ")),  # a separator may end the line
        stamp=-1 if time is None else time.index,
    )


def _line_at(data: bytes, at: int) -> tuple[str, int]:
    """The line that begins at `at`, and where the next one does."""
    end = data.find(b"\n", at) + 1 or len(data)
    return data[at:end].decode(), end


class Rows:
    """Collects the rows of a log, column by column: they are never held twice, as one table and as its columns.

    Labels that come in turn, on several lines, are gathered into rows; those of Teleplot by their stamps as well.
    """

    def __init__(self, layout: Layout) -> None:
        time = () if layout.time is None else layout.time.indices
        series = (i for i, column in enumerate(layout.columns) if column.role == "series")
        self._columns = {i: np.empty(0) for i in {*layout.channels, *time, *series}}
        self._width, self._count = len(layout.columns), 0
        self._block = array("d")  # rows, flat
        self._gathers = layout.form.kind == "teleplot" or layout.lead is not None
        self._lead = layout.lead
        self._time = None if layout.time is None else layout.time.index
        self._row: Sequence[float] = ()  # the one that is gathered
        # The sensor did sample then: without time a rejected line keeps the place of its sample.
        self._gaps = () if self._gathers or layout.time else ((math.nan,) * self._width,)

    def of(self, event: LineEvent) -> Sequence[Sequence[float]]:
        """The rows of a line, and what is in the place of a rejected one."""
        return self._gaps if event.kind == "rejected" else event.rows

    def add(self, rows: Sequence[Sequence[float]]) -> None:
        """Take the rows of one line."""
        for row in rows:
            if self._row and self._belongs(row):
                self._row = [b if math.isnan(a) else a for a, b in zip(self._row, row, strict=True)]
            else:
                self._block.extend(self._row if self._gathers else row)
                self._row = row if self._gathers else ()
        if len(self._block) >= 1 << 16:
            self._empty_block()

    def _belongs(self, row: Sequence[float]) -> bool:
        """Whether the samples of a line are of the row that is gathered."""
        begins = self._lead is not None and not math.isnan(row[self._lead])
        later = self._lead is None and self._time is not None and row[self._time] != self._row[self._time]
        pairs = (pair for i, pair in enumerate(zip(self._row, row, strict=True)) if i != self._time)
        return not (begins or later) and all(math.isnan(a) or math.isnan(b) for a, b in pairs)

    def extend(self, rows: Array) -> None:
        """Take rows, shape (n, width)."""
        end = self._count + len(rows)
        for i, column in self._columns.items():
            if end > len(column):
                self._columns[i] = np.empty(2 * end)
                self._columns[i][: self._count] = column[: self._count]
            self._columns[i][self._count : end] = rows[:, i]
        self._count = end

    def _empty_block(self) -> None:
        rows, self._block = np.array(self._block).reshape(-1, self._width), array("d")
        self.extend(rows)

    def require_room(self, done: int, size: int, name: str) -> None:
        """Raise NoMemory if all `size` bytes of the file will not fit in memory, by what the first `done` take."""
        taken = 8 * len(self._columns) * self._count
        require_memory(MEMORY_FACTOR * taken * size / done - taken, name, f"{size / 1e9:.1f} GB of text")

    def finish(self) -> list[Array]:
        """All columns, each of shape (rows,), empty where not read, once all lines were added."""
        self._block.extend(self._row)
        self._empty_block()
        return [self._columns.get(i, np.empty(0))[: self._count] for i in range(self._width)]
