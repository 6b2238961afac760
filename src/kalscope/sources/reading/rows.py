"""The lines of a log as rows of numbers, every line in exactly one count; plain rows by compiled loops."""

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
from kalscope.sources.grammar.cells import is_blank, is_number, parse_number
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.reading.kernels import RowForm, read_plain_rows
from kalscope.sources.reading.line_reader import TAIL_LINES, Kind, LineEvent, LineReader
from kalscope.sources.reading.sniffer import Layout
from kalscope.sources.reading.text_file import open_text, read_line

# Blocks of plain rows, read by compiled loops: a hundredth of the time that the line reader needs.


_MAX_NUMBERS = 1 << 18
"""Numbers that are read at once: 2 MiB, which fits a processor's cache."""
_MAX_ROUNDED = 1024
"""Numbers of more digits than the loops hold that are read again at once."""


class BlockParser:
    """Reads plain rows of one layout.

    A line is plain where it holds one number or missing value (nan or nothing) per channel and the line reader
    reads it alike. Whatever is doubtful ends the rows: other bytes, quotes, blank lines, numbers near the ends of
    float64, stamps out of range.
    """

    def __init__(self, layout: Layout) -> None:
        width, delimiter = len(layout.columns), layout.form.delimiter
        self._decimal = layout.form.decimal
        self._form = RowForm(
            marks=(ord(delimiter), ord(self._decimal)),
            wanted=np.array(_are_read(layout), dtype=np.uint8),
            fields=(layout.least, width + (delimiter != " ")),  # a separator may end the line
            stamp=-1 if layout.time is None else layout.time.index,
        )
        self._out = np.empty((max(16, _MAX_NUMBERS // width), width))
        self._rounded = np.zeros((max(_MAX_ROUNDED, width + 1), 4), dtype=np.int64)

    def parse(self, data: bytes, at: int, end: int) -> tuple[Array, int]:
        r"""The plain rows from `at` on, none where the first line is not plain, and the place after them.

        Args:
            data: Lines, UTF-8, each with "\n" at its end, up to `end`.
            at: Where the first begins.
            end: Where the last ends.

        Returns:
            Numbers, shape (rows, columns), NaN where missing or not read, overwritten by the next call; the place.
        """
        lines: NDArray[np.uint8] = np.frombuffer(data, dtype=np.uint8, count=end)
        out = self._out
        rows, stop, again = read_plain_rows(lines, at, self._form, out, self._rounded)
        for row, column, first, last in self._rounded[:again].tolist():
            out[row, column] = float(data[first:last].decode().replace(self._decimal, "."))
        return out[:rows], stop


def block_parser(layout: Layout, options: ReadOptions) -> BlockParser | None:
    """The parser of plain rows of a layout; None where each line needs the line reader."""
    form, time, read = layout.form, layout.time, _are_read(layout)

    def may_be_row(header: tuple[str, ...]) -> bool:
        """Whether a header, which may come again, would be taken for numbers: `state,2019,2020`."""
        cells = (cell for cell, is_read in zip(header, read, strict=False) if is_read)
        return all(parse_number(cell, form.decimal) is not None for cell in cells)

    is_never_plain = bool(
        (form.kind, form.stamped, form.checksum) != ("table", False, False)
        or layout.narrow
        or form.decimal == form.delimiter  # inside quotes
        or (time is not None and time.kind != "number")
        or any(column.role == "series" or column.form is not None for column in layout.columns)
        or any(is_number(text, form.decimal) for text in options.missing_texts)
        or any(map(may_be_row, layout.header_rows))
    )
    return None if is_never_plain else BlockParser(layout)


def _are_read(layout: Layout) -> list[bool]:
    """Whether each column is read: the channels and the time; the others may hold any text."""
    read = {*layout.channels, *(layout.time.indices if layout.time else ())}
    return [i in read for i in range(len(layout.columns))]


# Turn the lines of a log into rows of numbers, every line in exactly one count.


MAX_WORDS = 8
"""Words that say "no sample" of which the report gives the count."""

BLOCK_SIZE = 1 << 19
"""Characters read at once, between two progress reports."""

MAX_BYTES_BY_LINE = 1 << 15
"""A file up to this size is read line by line, in less time than the compiled loops take to load."""

BLOCK_NUMBERS = 1 << 16
"""Numbers that are gathered row by row before they are put into their columns."""

ROOM_EVERY = 1 << 26
"""Bytes of a file between two checks of the free memory."""

MAX_SLOW = 64
"""Most lines read one by one before plain rows are looked for again, where there are none."""


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

    def take(self, event: LineEvent) -> None:
        """Count one line and keep its issues, up to MAX_ISSUES."""
        self.lines[event.kind] += 1
        if event.kind == "row":
            self.bad_cells += len(event.issues)
            self.missing.update(event.missing)
            self.bad_columns.update(issue.column for issue in event.issues if issue.column)
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
        """Count a last line that has no newline, and note whether it was kept."""
        self.take(event)
        what = {"rejected": "it is torn and was left out", "row": "it was kept, because it has all its values"}
        if event.kind in what:
            self.ending = f"line {event.number}, the last, has no newline: {what[event.kind]}"


def read_rows(
    path: Path, encoding: str, layout: Layout, options: ReadOptions = DEFAULTS, progress: Progress | None = None
) -> tuple[list[Array], Tally]:
    """All columns, each of shape (rows,), empty where not read; and the account.

    Raises:
        NoMemory: there will not be enough memory for them, by what the first ones take.
    """
    size, progress = path.stat().st_size, progress or Progress()
    reader = _TableReader(layout, options, by_line=size <= MAX_BYTES_BY_LINE)
    # The next block is read and decoded on another thread while the loops, which release the GIL, parse this one.
    with path.open("rb") as file, ThreadPoolExecutor(1) as ahead:
        text = open_text(file, encoding)
        block = ahead.submit(_read_block, text)
        while data := block.result():
            progress(file.tell() / size, "reading")
            block = ahead.submit(_read_block, text)
            reader.take(data, growing=not data.endswith(b"\n") and path.stat().st_size > size)
            reader.require_room(file.tell(), size, path.name)
    return reader.finish(), reader.tally


def _read_block(text: TextIO) -> bytes:
    """The next whole lines, of which only the last of the file may lack its newline; b"" at the end."""
    return (text.read(BLOCK_SIZE) + read_line(text)).encode()


class _TableReader:
    """Takes the lines of a log in blocks: plain rows at once, all others one by one."""

    def __init__(self, layout: Layout, options: ReadOptions, *, by_line: bool) -> None:
        self.tally = Tally()
        self._layout = layout
        is_gathered = layout.form.kind == "teleplot" or layout.lead is not None
        self._rows = GatheredRows(layout) if is_gathered else Rows(layout)
        self._plain = None if by_line else block_parser(layout, options)
        self._reader = LineReader(layout, options.without_numbers())
        self._number = 1
        self._above = b""
        self._room_at = ROOM_EVERY

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
        self._take_rows(data, at, whole)
        if at <= whole < len(data):
            above = (self._above + data[:whole]).decode().split("\n")[-1 - TAIL_LINES : -1]
            event = self._reader.read_last(self._number, data[whole:].decode(), [] if growing else above)
            self.tally.take_last(event)
            self._rows.add(event, last=True)
        self._above = data

    def require_room(self, done: int, size: int, name: str) -> None:
        """Raise NoMemory if all `size` bytes of the file will not fit in memory, by what the first `done` take."""
        if done < self._room_at:
            return
        self._room_at = done + ROOM_EVERY
        taken = self._rows.nbytes
        require_memory(MEMORY_FACTOR * taken * size / done - taken, name, f"{size / 1e9:.1f} GB of text")

    def finish(self) -> list[Array]:
        """The columns, each of shape (rows,)."""
        self.tally.series = tuple(self._reader.series)
        return self._rows.finish()

    def _take_rows(self, data: bytes, at: int, end: int) -> None:
        """Take whole lines: plain rows, and in between one line, or more and more of them where none is plain."""
        slow = 1
        while at < end:
            if self._plain is not None:
                rows, at = self._plain.parse(data, at, end)
                slow = 1 if len(rows) else min(2 * slow, MAX_SLOW)
                self._number += len(rows)
                self.tally.lines["row"] += len(rows)
                if len(rows):
                    self._rows.extend(rows)
            for _ in range(slow):
                if at < end:
                    line, at = _line_at(data, at)
                    event = self._reader.read(self._number, line)
                    self.tally.take(event)
                    self._rows.add(event)
                    self._number += 1


def _line_at(data: bytes, at: int) -> tuple[str, int]:
    """The line that begins at `at`, and where the next one does."""
    end = data.find(b"\n", at) + 1 or len(data)
    return data[at:end].decode(), end


class Rows:
    """Collects the rows of a log, column by column: they are never held twice, as one table and as its columns."""

    def __init__(self, layout: Layout) -> None:
        time = () if layout.time is None else layout.time.indices
        series = (i for i, column in enumerate(layout.columns) if column.role == "series")
        self._kept = sorted({*layout.channels, *time, *series})
        self._columns = [array("d") for _ in layout.columns]
        self._block = array("d")  # rows, flat
        # The sensor did sample then: without time a rejected line keeps the place of its sample.
        self._gap = [math.nan] * len(layout.columns) if layout.time is None else []

    def add(self, event: LineEvent, *, last: bool = False) -> None:
        """Take the rows of a line; a rejected last line has no neighbours whose places it could keep."""
        for row in event.rows:
            self.append(row)
        if event.kind == "rejected" and not last:
            self.append(self._gap)

    def append(self, row: Sequence[float]) -> None:
        """Take one row, or nothing."""
        self._block.extend(row)
        if len(self._block) >= BLOCK_NUMBERS:
            self._empty_block()

    def extend(self, rows: Array) -> None:
        """Take rows, shape (rows, width)."""
        self._empty_block()
        for i in self._kept:
            self._columns[i].frombytes(np.ascontiguousarray(rows[:, i]).data.cast("B"))

    @property
    def nbytes(self) -> int:
        """Bytes that the columns take."""
        return sum(8 * len(self._columns[i]) for i in self._kept)

    def _empty_block(self) -> None:
        if self._block:
            rows = np.frombuffer(self._block).reshape(-1, len(self._columns))
            self._block = array("d")
            self.extend(rows)

    def finish(self) -> list[Array]:
        """The columns, each of shape (rows,), once all lines were added."""
        self._empty_block()
        return [np.frombuffer(column, dtype=np.float64) if column else np.empty(0) for column in self._columns]


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
                self.append(self._row)
                self._row = list(row)

    def _belongs(self, row: tuple[float, ...]) -> bool:
        begins = self._lead is not None and not math.isnan(row[self._lead])
        later = self._lead is None and self._time is not None and row[self._time] != self._row[self._time]
        if begins or later:
            return False
        pairs = enumerate(zip(self._row, row, strict=True))
        return all(math.isnan(a) or math.isnan(b) or i == self._time for i, (a, b) in pairs)

    def finish(self) -> list[Array]:
        """The columns, including the row being gathered."""
        self.append(self._row)
        return super().finish()
