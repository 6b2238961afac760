"""From the columns and counts that a reader found to the Recording, the same way for every reader."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.common.checks import check_sample_period
from kalscope.errors import BadFile, BadSetting
from kalscope.recording import ReadReport, Recording
from kalscope.sources.grammar.read_options import ReadOptions, option, option_words
from kalscope.sources.layout.sniffer import Layout
from kalscope.sources.readers.csv_rows import Tally
from kalscope.sources.readers.refusals import no_rows
from kalscope.sources.readers.sentinels import Extremes, suggest_missing
from kalscope.sources.times.gaps import fill_gaps
from kalscope.sources.times.time_axis import GivenPeriod, TimeAxis, counted_time, read_time

_MIN_FALLING = 8
"""Fewest steps back that show a log that begins with its newest row, where no step goes forward."""

_HEAD_ROWS = 1000
"""Rows that nearly always show that stamps rise, before all of them are looked at."""

Columns = dict[int, Array]
"""Columns by index, each of shape (n,): the channels and the time."""


@dataclass(frozen=True)
class Reading:
    """What a reader found in a file."""

    columns: Columns
    """The channels and the time, NaN where missing, before numbers of `ReadOptions.missing` are removed;
    `assemble` empties it."""
    tally: Tally
    """The account of all lines."""
    layout: Layout
    """What the columns are."""
    period: float | None = None
    """Sample period in s that the file itself states; None where it gives none."""


def check_chosen_period(options: ReadOptions, sample_period: float | None) -> None:
    """Raise BadSetting if the user chose a sample period, s, or a rate that is out of range, or two that differ."""
    if sample_period is not None:
        check_sample_period(sample_period)
    if options.rate is None:
        return
    period = 1.0 / options.rate
    check_sample_period(period)
    if sample_period is not None and abs(sample_period - period) > 1e-6 * period:
        raise BadSetting(
            f"rate and sample period must agree, or one be left out (got {options.rate:.9g} Hz and"
            f" {sample_period:.9g} s)"
        )


def assemble(reading: Reading, options: ReadOptions, sample_period: float | None, name: str) -> Recording:
    """Build the Recording, without source, title and hash; `check_chosen_period` comes before.

    Raises:
        BadFile: no sample is left.
        BadSetting: an option that this file cannot have.
    """
    tally, layout = reading.tally, reading.layout
    if not tally.lines["row"]:
        raise no_rows(name, tally.lines["rejected"], tally.issues)
    if layout.time is not None:  # looked at many times, which is slow across the rows of a table
        reading.columns[layout.time.index] = np.ascontiguousarray(reading.columns[layout.time.index])
    turned = _oldest_first(reading.columns, layout)
    channels = layout.channels
    values, taken = _values(reading.columns, channels, options)
    axis = _axis(reading, len(values), options, sample_period)
    timing, period = axis.timing, axis.timing.period
    notes = [*layout.notes, *turned, *axis.notes, *taken, *tally.notes]
    with np.errstate(invalid="ignore"):
        ends = np.fmin.reduce(values), np.fmax.reduce(values)
    notes += _about_columns(layout, ends, len(values), name)
    notes += suggest_missing(values, [layout.columns[i].name for i in channels], ends)
    time, inserted = axis.time, 0
    if options.gaps != "rows":
        if period is None or layout.time is None:
            raise BadSetting(f"gaps must be rows where a file has no time (got {options.gaps!r})")
        if options.gaps == "missing":
            time, values, inserted = fill_gaps(time, values, period, axis.pauses)
            notes.append(f"{inserted} rows of missing samples were inserted into the gaps")
    report = ReadReport(
        lines=tally.lines.total(),
        rows=tally.lines["row"],
        rejected=tally.lines["rejected"],
        blank=tally.lines["blank"],
        comments=tally.lines["comment"] + tally.lines["text"],
        headers=tally.lines["header"],
        bad_cells=tally.bad_cells,
        clipped_times=axis.backward,
        inserted=inserted,
        issues=tuple(tally.issues),
        notes=tuple(notes),
        timing=timing,
        options=_options(options, sample_period),
    )
    names = tuple(layout.columns[i].name for i in channels)
    units = tuple(layout.columns[i].unit for i in channels)
    return Recording(time, names, units, values, period, report, gaps=options.gaps)


def _oldest_first(columns: Columns, layout: Layout) -> list[str]:
    """Reverse the rows of a log that begins with its newest one, as services export it, and return a note.

    Only where the stamps always fall: where a device restarts, or a few rows are out of order, the order is kept.
    """
    time = layout.time
    if time is None or time.kind == "clock":  # which falls at midnight
        return []
    stamps = columns[time.index]
    if np.any(np.diff(stamps[:_HEAD_ROWS]) > 0):
        return []
    steps = np.diff(stamps)
    if np.count_nonzero(steps < 0) < _MIN_FALLING or np.any(steps > 0):
        return []
    for i, column in columns.items():
        columns[i] = column[::-1]
    return ["the newest row comes first in the file: the rows were put in order of time"]


def _options(options: ReadOptions, sample_period: float | None) -> tuple[str, ...]:
    """What the user decided, as words of the command line."""
    period = () if sample_period is None else option("sample-period", repr(sample_period))
    return (*period, *option_words(options))


def _values(columns: Columns, channels: list[int], options: ReadOptions) -> tuple[Array, list[str]]:
    """Samples, shape (n, channels), without the values that the user declared missing; and how many those were."""
    # Column by column in memory: each channel is filtered, drawn and judged by itself.
    values = np.empty((len(columns[channels[0]]), len(channels)), order="F")
    for j, i in enumerate(channels):
        values[:, j] = columns.pop(i)  # no column is held twice
    notes: list[str] = []
    for number in options.missing_numbers:
        found = values == number
        often = int(np.count_nonzero(found))
        samples = "1 sample" if often == 1 else f"{often} samples"
        notes.append(f"{samples} of {number:.15g} {'is' if often == 1 else 'are'} missing, as requested")
        values[found] = np.nan
    return values, notes


def _axis(reading: Reading, n: int, options: ReadOptions, sample_period: float | None) -> TimeAxis:
    layout, column = reading.layout, reading.layout.time
    if sample_period is None and options.rate is not None:
        sample_period = 1.0 / options.rate
    given = GivenPeriod(sample_period, reading.period or layout.period)
    if column is None:
        if options.time_unit is not None:
            raise BadSetting(f"time_unit needs a time column (got {options.time_unit!r} and no time)")
        return counted_time(n, given, layout.offset, layout.start)
    stamps = reading.columns[column.index]
    return read_time(stamps, column, options.time_unit, given, options.gaps, layout.start)


def _about_columns(layout: Layout, ends: Extremes, n: int, name: str) -> list[str]:
    """Remarks about the columns; BadFile if no sample is left."""
    low, high = ends
    if not np.isfinite(low).any():
        raise BadFile(f"{name} must hold at least one number in a channel (got only missing samples)")
    names = [column.name or f"column {i + 1}" for i, column in enumerate(layout.columns)]
    what = {"text": "text", "row name": "row names", "row number": "row numbers"}
    notes = [
        f'"{names[i]}" holds {what[column.role]} and is not a channel'
        for i, column in enumerate(layout.columns)
        if column.role in what
    ]
    if n == 1:
        notes.append("there is only one sample")
    empty, constant = ~np.isfinite(low), (low == high) & (n > 1)
    for which, one, many in ((empty, "holds only", "hold only"), (constant, "is", "are")):
        found = [f'"{names[i]}"' for i, chosen in zip(layout.channels, which.tolist(), strict=True) if chosen]
        if found:
            listed = ", ".join(found[:8]) + (f" and {len(found) - 8} more" if len(found) > 8 else "")
            said = "constant" if which is constant else "missing samples"
            notes.append(f"{listed} {one if len(found) == 1 else many} {said}")
    return notes
