"""LabVIEW measurement files (.lvm), by "Specification for the LabVIEW Measurement File", ni.com/tutorial/4139.

A file header says how the cells are written; then come segments, one for each call of the writing block, each with
tags (units, start, step), a row of names, and rows. Segments of the same channels follow each other in time.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from kalscope.common.progress import Progress
from kalscope.recording import MAX_ISSUE_LENGTH, MAX_ISSUES, LineIssue
from kalscope.sources.containers.labview.segments import Segment, X, gathered
from kalscope.sources.containers.parts import Part, choose_part
from kalscope.sources.containers.table import Table
from kalscope.sources.grammar.cells import parse_number

MAGIC = "LabVIEW Measurement"

_LINES_PER_REPORT = 4096
_PLAIN = dict.fromkeys(map(ord, "0123456789+-.,eE\t ;"))
"""Characters of a row of numbers, which `str.translate` removes."""


def read_lvm(path: Path, name: str, part: str | None, progress: Progress) -> Table:
    """Read a LabVIEW measurement file.

    Raises:
        BadFile: it holds no numbers.
        BadSetting: there is no such part.
    """
    reader = _Reader(progress)
    with path.open("rb") as file:
        reader.take(_lines(file.read()))
    series = gathered(reader.segments, reader.decimal)
    parts = [Part(", ".join(one.names), sum(map(len, one.times)), len(one.names)) for one in series]
    chosen, notes = choose_part([part for part in parts if part.rows], part, name, "set of channels")
    one = [one for one, part in zip(series, parts, strict=True) if part.rows][chosen]
    segments = f" of {len(one.times)} segments" if len(one.times) > 1 else ""
    even = len(one.times) == 1 and one.periods[0] is not None
    return Table(
        names=one.names,
        units=one.units,
        columns=tuple(np.concatenate(columns) for columns in zip(*one.columns, strict=True)),
        time=None if even else np.concatenate(one.times),
        start=one.start,
        period=one.periods[0] if even else None,
        notes=(f"a LabVIEW measurement file{segments}", *notes),
        headers=reader.headers,
        rejected=reader.rejected,
        bad_cells=reader.bad_cells,
        issues=tuple(reader.issues),
        filled=one.filled,
    )


def _lines(data: bytes) -> list[str]:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


class _Reader:
    """Sorts the lines into segments."""

    def __init__(self, progress: Progress) -> None:
        self.segments: list[Segment] = []
        self.headers = self.rejected = self.bad_cells = 0
        self.issues: list[LineIssue] = []
        self.decimal = "."
        self._separator = "\t"
        self._progress = progress
        self._special = False

    def take(self, lines: list[str]) -> None:
        """Take all lines; the last is empty where the file ends with a newline."""
        file_tags: dict[str, list[str]] = {}
        segment: Segment | None = None
        torn = len(lines) if lines[-1].strip() else 0
        for number, line in enumerate(lines[: len(lines) if torn else -1], 1):
            if number % _LINES_PER_REPORT == 1:
                self._progress(number / len(lines), "reading")
            cells = line.split(self._separator)
            if segment is not None and segment.numeric:
                plain = self._plain_row(segment, line, cells) if number != torn else None
                if plain is not None:
                    segment.rows.append(plain)
                    continue
                if self._is_row(cells):
                    self._take_row(segment, number, line, cells, torn == number)
                    continue
            self.headers += 1
            if self._is_skipped(line):
                continue
            if line.startswith("Separator") and len(line) > len("Separator"):
                self._separator = line[len("Separator")]
                continue
            cells = line.split(self._separator)
            if cells[0] == "Channels":
                segment = Segment(dict(file_tags))
                self.segments.append(segment)
            elif cells[0] == X:
                # A row of names begins a segment even without a segment header.
                if segment is None or segment.names:
                    segment = Segment(dict(file_tags))
                    self.segments.append(segment)
                segment.names = [cell.strip() for cell in cells]
                has_x = segment.tag("X_Columns", 1).lower() != "no"
                named = [j for j, name in enumerate(segment.names) if has_x and name == X]
                segment.numeric = sorted({*named, *segment.channels}) if segment.channels else []
            elif cells[0] == "Decimal_Separator":
                self.decimal = "," if cells[1:] and cells[1].strip() == "," else "."
            if segment is not None and cells[0] in ("Date", "Time"):
                segment.is_dated = True
            (file_tags if segment is None else segment.tags)[cells[0].strip()] = cells

    def _is_skipped(self, line: str) -> bool:
        """Special blocks belong to the program that wrote them."""
        if line.startswith("***Start_Special***"):
            self._special = True
        skipped = self._special or line.startswith(("***", MAGIC)) or not line.strip()
        if line.startswith("***End_Special***"):
            self._special = False
        return skipped

    def _is_row(self, cells: list[str]) -> bool:
        first = cells[0].strip()
        return any(map(str.strip, cells)) and (not first or parse_number(first, self.decimal) is not None)

    def _plain_row(self, segment: Segment, line: str, cells: list[str]) -> list[float] | None:
        """The numbers of a row that holds nothing else; None for any other line."""
        if line.translate(_PLAIN) or len(cells) <= segment.numeric[-1]:
            return None
        if self.decimal == ",":
            cells = [cell.replace(",", ".") for cell in cells]
        try:
            numbers = [float(cells[j]) for j in segment.numeric]
        except ValueError:
            return None
        row = [math.nan] * len(segment.names)
        for j, value in zip(segment.numeric, numbers, strict=True):
            row[j] = value
        return row if all(map(math.isfinite, numbers)) else None

    def _take_row(self, segment: Segment, number: int, line: str, cells: list[str], is_torn: bool) -> None:
        channels = segment.channels
        row = [np.nan] * len(segment.names)
        if is_torn or not channels or len(cells) <= channels[-1]:
            reason = (
                "must end with a newline (torn: the file ends inside this line)"
                if is_torn
                else f"must have {len(segment.names)} fields (got {len(cells)})"
            )
            self.rejected += 1
            self._note(LineIssue(number, reason, line[:MAX_ISSUE_LENGTH]))
            if not is_torn and segment.tag("X_Columns", 1).lower() == "no":
                segment.rows.append(row)  # the sensor did sample then
                segment.filled += 1
            return
        for j in segment.numeric:
            cell = cells[j].strip()
            value = parse_number(cell, self.decimal)
            row[j] = np.nan if value is None else value
            if value is None and j in channels:
                self.bad_cells += 1
                self._note(LineIssue(number, "must be a number", cell[:MAX_ISSUE_LENGTH], segment.names[j]))
        segment.rows.append(row)

    def _note(self, issue: LineIssue) -> None:
        if len(self.issues) < MAX_ISSUES:
            self.issues.append(issue)
