"""LabVIEW measurement files (.lvm), by "Specification for the LabVIEW Measurement File", ni.com/tutorial/4139.

A file header says how the cells are written; then come segments, one for each call of the writing block, each with
tags (units, start, step), a row of names, and rows. The rows of one set of channels become text for the ordinary
rules, with the seconds since the first segment in front; all other lines become comments.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from kalscope.common.numbers import Array
from kalscope.common.progress import Progress
from kalscope.sources.containers.table import Part, Text, choose_part
from kalscope.sources.grammar.cells import parse_number
from kalscope.sources.grammar.timestamps import parse_calendar

_X = "X_Value"
"""Name of the columns of x."""


@dataclass
class _Segment:
    """One segment."""

    tags: dict[str, list[str]]
    """Cells of each tag, by column; those of the file header where the segment gives none."""
    names: list[str]
    """The row of names."""
    rows: list[tuple[int, list[str]]] = field(default_factory=list[tuple[int, "list[str]"]])
    """(line from 0, cells) of each row."""

    def tag(self, name: str, column: int = 1) -> str:
        """The cell of a tag above a column; a tag of the file header has one cell for all."""
        cells = self.tags.get(name, [])
        return "".join(cells[1:2] if len(cells) <= 2 else cells[column : column + 1])

    def start(self, column: int) -> float | None:
        """Seconds since 1970 of the start; LabVIEW gives local time without a zone. None where x counts on."""
        clock = self.tag("Time", column).replace(",", ".")[:15]  # to the microsecond
        stamp = parse_calendar(f"{self.tag('Date', column)} {clock}")
        return None if stamp is None or self.tag("Time_Pref").lower() == "relative" else stamp / 1e6

    def channels(self) -> Iterable[list[int]]:
        """Columns of the channels of each step: all that are named, but not x and a comment at the end."""
        found: dict[str, list[int]] = {}
        for j, name in enumerate(self.names):
            if name not in ("", _X) and not (name == "Comment" and j == len(self.names) - 1):
                found.setdefault(self.tag("Delta_X", j), []).append(j)
        return found.values()

    def axis(self, column: int, decimal: str) -> tuple[Array | None, float]:
        """Seconds of each row, None where there is no time, and the step.

        X0 + i Delta_X, unless the x column differs by more than half a step: x is rounded, Delta_X is not.
        """
        step, first = (parse_number(self.tag(tag, column), decimal) or 0.0 for tag in ("Delta_X", "X0"))
        even = first + np.arange(len(self.rows), dtype=np.float64) * step if step > 0.0 else None
        if _X in self.names[:column] and self.tag("X_Columns").lower() != "no":
            x = column - 1 - self.names[:column][::-1].index(_X)
            cells = (parse_number(cells[x], decimal) if x < len(cells) else None for _, cells in self.rows)
            given = np.array([np.nan if cell is None else cell for cell in cells])
            if np.isfinite(given).any() and not (even is not None and np.all(np.abs(given - even) <= 0.5 * step)):
                return given, 0.0
        return even, step


def read_lvm(path: Path, name: str, part: str | None, progress: Progress) -> Text:
    """Read the channels of one time axis as text.

    Raises:
        BadFile: it holds no numbers.
        BadSetting: there is no such part.
    """
    data = path.read_bytes()
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    lines = re.split("\r\n|\r|\n", text)
    segments, decimal = _segments(lines, progress)
    series: dict[tuple[str, ...], list[tuple[_Segment, list[int]]]] = {}
    for segment in segments:
        for columns in segment.channels() if segment.rows else ():
            series.setdefault(tuple(segment.names[j] for j in columns), []).append((segment, columns))
    parts = [Part(", ".join(key), sum(len(one.rows) for one, _ in held), len(key)) for key, held in series.items()]
    chosen, notes = choose_part(parts, part, name, "set of channels")
    names, found = list(series.items())[chosen]
    first, columns = found[0]
    titles = [
        title if not unit or f"({unit})" in title else f"{title} [{unit}]"
        for title, unit in zip(names, (first.tag("Y_Unit_Label", j) for j in columns), strict=True)
    ]
    written = ["#"] * (len(lines) - (not lines[-1]))
    has_time = first.axis(columns[0], decimal)[0] is not None
    written[first.rows[0][0] - 1] = "\t".join([*(["time (s)"] * has_time), *titles])
    origin, end = first.start(columns[0]), None
    for segment, columns in found:
        (time, step), start, shift = segment.axis(columns[0], decimal), segment.start(columns[0]), 0.0
        if start is not None and origin is not None and start > origin:
            shift = start - origin
        elif time is not None and end is not None and time[0] <= end:
            shift = end + step - time[0]
        end = None if time is None else time[-1] + shift
        for i, (line, cells) in enumerate(segment.rows):
            stamp = [] if time is None else ["" if np.isnan(time[i]) else repr(float(time[i] + shift))]
            values = (cells[j] for j in columns if j < len(cells))  # a short row is rejected by the reader
            written[line] = "\t".join((*stamp, *(cell.replace(decimal, ".") for cell in values)))
    begin = datetime(1970, 1, 1) + timedelta(seconds=origin or 0.0)
    since = "" if origin is None else f" that starts at {begin.isoformat()}"
    segments_read = f" of {len(found)} segments" if len(found) > 1 else ""
    return Text(written, (f"a LabVIEW measurement file{segments_read}{since}", *notes), "\t")


def _segments(lines: list[str], progress: Progress) -> tuple[list[_Segment], str]:
    """The segments, and the decimal mark."""
    separator, decimal, special = "\t", ".", False
    of_file: dict[str, list[str]] | None = None  # known at the end of the first header
    tags: dict[str, list[str]] = {}
    segments: list[_Segment] = []
    rows: list[tuple[int, list[str]]] | None = None
    for number, line in enumerate(lines):
        if number % 4096 == 0:
            progress(number / len(lines), "reading")
        cells = [cell.strip() for cell in line.split(separator)]
        if line.startswith("***") or special:  # special blocks belong to the program that wrote them
            special = (special or line.startswith("***Start_Special")) and not line.startswith("***End_Special")
            of_file = dict(tags) if of_file is None and line.startswith("***End_of_Header") else of_file
        elif not any(cells):
            continue
        elif rows is not None and (not cells[0] or parse_number(cells[0], decimal) is not None):
            rows.append((number, cells))
        elif cells[0] == _X:  # begins a segment even without a segment header
            tags = dict(of_file or {}) if rows is not None else tags
            segments.append(_Segment(tags, cells))
            rows = segments[-1].rows
        else:
            if rows is not None:
                tags, rows = dict(of_file or {}), None
            tags[cells[0]] = cells
            if line.startswith("Separator"):
                separator = line[len("Separator") :][:1] or separator
            elif cells[0] == "Decimal_Separator":
                decimal = "," if cells[1:2] == [","] else "."
    return segments, decimal
