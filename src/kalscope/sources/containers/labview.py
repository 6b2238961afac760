"""The segments of a LabVIEW measurement file: their tags, and the channels of one time axis gathered from all."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from kalscope.common.numbers import Array
from kalscope.common.progress import Progress
from kalscope.recording import MAX_ISSUE_LENGTH, MAX_ISSUES, LineIssue
from kalscope.sources.containers.table import Part, Table, choose_part
from kalscope.sources.grammar.cells import parse_number

X = "X_Value"
"""Name of the columns of x."""


@dataclass
class Segment:
    """One segment while it is read."""

    tags: dict[str, list[str]] = field(default_factory=dict[str, "list[str]"])
    """Cells of each tag, by column; those of the file header where the segment gives none."""
    names: list[str] = field(default_factory=list[str])
    """The row of names; empty until it is read."""
    numeric: list[int] = field(default_factory=list[int])
    """Columns of the channels and of the x axes."""
    rows: list[list[float]] = field(default_factory=list["list[float]"])
    """The numbers, one per column; NaN in columns of text."""
    filled: int = 0
    """Rows of missing samples that keep the place of a rejected line."""
    is_dated: bool = False
    """True where it gives a start of its own, not only that of the file."""

    def tag(self, name: str, column: int, default: str = "") -> str:
        """The cell of a tag above a column; a tag of the file header has one cell for all."""
        cells = self.tags.get(name, [])
        cell = cells[1:2] if len(cells) <= 2 else cells[column : column + 1]
        return "".join(cell).strip() or default

    @property
    def channels(self) -> list[int]:
        """Columns of the channels: all that are named, except the x columns and a comment column at the end."""
        names = self.names
        return [
            j
            for j, name in enumerate(names)
            if name and name != X and not (name == "Comment" and j == len(names) - 1)
        ]


@dataclass
class Series:
    """Channels of one time axis, gathered from all segments."""

    names: tuple[str, ...]
    """Name of each channel."""
    units: tuple[str, ...]
    """Unit of each channel, "" where none is given."""
    times: list[Array] = field(default_factory=list["Array"])
    """Stamps of each segment in s since `start`."""
    columns: list[list[Array]] = field(default_factory=list["list[Array]"])
    """Samples of each segment, by channel."""
    periods: list[float | None] = field(default_factory=list["float | None"])
    """Sample period of each segment in s; None where the stamps are not even."""
    start: float | None = None
    """When the first segment starts, in s since 1970; None where it gives none."""
    filled: int = 0
    """Rows of missing samples that keep the places of rejected lines."""


def gathered(segments: list[Segment], decimal: str) -> list[Series]:
    """The channels of each time axis, those of the same names from all segments together."""
    series: dict[tuple[str, ...], Series] = {}
    for segment in segments:
        if not segment.rows:
            continue
        table = np.array(segment.rows)
        for columns, time, period in _axes(segment, table, decimal):
            names = tuple(segment.names[j] for j in columns)
            units = tuple(segment.tag("Y_Unit_Label", j) for j in columns)
            one = series.setdefault(names, Series(names, units))
            start = _start(segment, columns[0])
            one.start = start if not one.times else one.start
            one.times.append(time + _offset(one, segment, start, time, period))
            one.periods.append(period)
            one.filled += segment.filled
            one.columns.append([table[:, j] for j in columns])
    return list(series.values())


def _axes(segment: Segment, table: Array, decimal: str) -> Iterator[tuple[list[int], Array, float | None]]:
    """(columns, seconds, period where they are even) of the channels of each x axis."""
    found: list[tuple[list[int], Array, float | None]] = []
    has_x = segment.tag("X_Columns", 1, "One").lower() != "no"
    for j in segment.channels:
        before = [i for i in range(j) if segment.names[i] == X] if has_x else []
        time, period = _x_axis(segment, j, table[:, before[-1]] if before else None, len(table), decimal)
        same = next((columns for columns, other, _ in found if np.array_equal(other, time, equal_nan=True)), None)
        if same is None:
            found.append(([j], time, period))
        else:
            same.append(j)
    yield from found


def _x_axis(segment: Segment, column: int, x: Array | None, n: int, decimal: str) -> tuple[Array, float | None]:
    """X0 + i Delta_X, unless an x column differs from it by more than half a step: x is rounded, Delta_X is not."""
    step = parse_number(segment.tag("Delta_X", column), decimal)
    first = parse_number(segment.tag("X0", column), decimal)
    even: Array | None = None
    if step is not None and step > 0.0:
        even = np.arange(n, dtype=np.float64) * step
        even += first if first is not None and np.isfinite(first) else 0.0
    if x is None or not np.isfinite(x).any():
        return (np.arange(n, dtype=np.float64), None) if even is None else (even, step)
    if even is not None and np.abs(x - even).max() <= 0.5 * float(even[-1] - even[0]) / max(n - 1, 1):
        return even, step
    return x, None


def _offset(one: Series, segment: Segment, start: float | None, time: Array, period: float | None) -> float:
    """Seconds from the first segment to this one, by its own clock; else it follows the last without a gap."""
    if not one.times:
        return 0.0
    if (
        segment.is_dated
        and start is not None
        and one.start is not None
        and segment.tag("Time_Pref", 1).lower() != "relative"
    ):
        return start - one.start
    last = float(one.times[-1][-1])
    return 0.0 if time[0] > last else last + (period or 0.0) - float(time[0])


def _start(segment: Segment, column: int) -> float | None:
    """Seconds since 1970 of the start; LabVIEW gives local time without a zone."""
    clock = segment.tag("Time", column).replace(",", ".").split(":")
    try:
        day = datetime.strptime(segment.tag("Date", column), "%Y/%m/%d").replace(tzinfo=UTC)
        hour, minute, second = int(clock[0]), int(clock[1]), float(clock[2])
    except (ValueError, IndexError):
        return None
    seconds = day.timestamp() + 3600 * hour + 60 * minute + second
    return seconds if np.isfinite(seconds) else None


# LabVIEW measurement files (.lvm), by "Specification for the LabVIEW Measurement File", ni.com/tutorial/4139.
#
# A file header says how the cells are written; then come segments, one for each call of the writing block, each
# with tags (units, start, step), a row of names, and rows. Segments of the same channels follow each other in time.


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
