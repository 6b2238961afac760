"""The segments of a LabVIEW measurement file: their tags, and the channels of one time axis gathered from all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime

import numpy as np

from kalscope.common.array import Array
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
