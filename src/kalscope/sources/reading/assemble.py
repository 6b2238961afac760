"""From the columns and counts that a reader found to the Recording, its time axis and its notes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kalscope.common.numbers import Array, check_sample_period
from kalscope.common.text import count, duration
from kalscope.errors import BadFile, BadSetting
from kalscope.recording import Assumption, ReadReport, Recording, Timing
from kalscope.sources.containers.table import Table
from kalscope.sources.grammar.line_format import LineFormat
from kalscope.sources.grammar.read_options import ReadOptions, option, option_words
from kalscope.sources.grammar.timestamps import TimeColumn, judge
from kalscope.sources.reading.account import no_rows
from kalscope.sources.reading.axis import GivenPeriod, TimeAxis, counted_time, fill_gaps, read_time
from kalscope.sources.reading.columns import Column, named_column, settle_roles
from kalscope.sources.reading.rows import Tally
from kalscope.sources.reading.sniffer import Layout
from kalscope.sources.reading.time_columns import chosen_time, find_time

# Values that may stand for "no sample", such as −200 or 400: found and asked about, never removed unasked.
#
# A code is a number that nothing measures by chance, far from all that is measured. Some numbers are always codes
# there (−999, 32767). Others are readings as well (0, 400): they are codes only where they appear for a moment, and
# the signal then continues where it was. A stopped motor or a lamp that is off stays so.


Extremes = tuple[Array, Array]
"""Smallest and largest sample of each channel, shape (channels,) each; NaN where all are missing."""

MIN_SURE = 2
"""Least count of a number that is always a code."""
MIN_UNSURE = 3
"""Least count of any other, and in a long recording one sample in 2000."""
MAX_ZEROS = 0.1
"""Largest share of the samples that may be a code of 0; more is a state."""
MAX_RUN = 3
"""Longest run in samples, in the median, of a code that may be a reading."""
MIN_RETURNS = 0.75
"""Least share of its runs after which the signal continues where it was."""
MAX_CODES = 4
"""Most codes of one channel."""
_MIN_DISTINCT = 3
"""With fewer values beside it there is nothing to be far from: a switch, an event marker."""
_SAMPLE = 20_000

_SURE = {
    *(32767.0, -32768.0, 65535.0, 8388607.0, -8388608.0, 2147483647.0, -2147483648.0, 4294967295.0),
    *(-127.0, 85.0, -7999.0, 7999.0, -6999.0, 6999.0, -273.15, -273.0, 8190.0, 8191.0),
}
"""Limits of a processor's integers; DS18B20: not connected, not converted; Campbell: NAN; absolute zero; VL53L0X:
out of range."""
_UNSURE = {0.0, -1.0, 99.0, -99.0, 255.0, 1023.0, 4095.0}
"""Zero, an error value of C, and limits of short integers."""
HUGE = 1e20
"""Fill values of binary formats are beyond this: 1e30, 9.97e36, 3.4e38."""


def suggest_missing(values: Array, names: Sequence[str], ends: Extremes) -> list[str]:
    """Questions about values that may be missing samples.

    Args:
        values: Samples, shape (n, channels), NaN where missing.
        names: Channel names.
        ends: Their smallest and largest samples.

    Returns:
        One sentence for each value that is the smallest or largest of a channel, a code, and further from the rest
        than the middle half of the rest is wide, and half of all of it.
    """
    found: dict[float, list[int]] = {}
    for i, (low, high) in enumerate(zip(*ends, strict=True)):
        for value in _codes(values[:, i], float(low), float(high)):
            found.setdefault(value, []).append(i)
    questions: list[str] = []
    for value, channels in found.items():
        often = sum(int(np.count_nonzero(values[:, i] == value)) for i in channels)
        where = _quoted([names[i] for i in channels])
        questions.append(
            Assumption(
                f"is {value:.15g} a missing value? It occurs {count(often)} times in {where},"
                f" far from the rest; if so, read with --missing {value:.15g}"
            )
        )
    return questions


def _codes(samples: Array, low: float, high: float) -> list[float]:
    """The codes of one channel, from the ends of its samples inwards: each hides how far the next one is."""
    found: list[float] = []
    rest = samples
    while len(found) < MAX_CODES:
        sure = {value for value in (low, high) if _is_sure(value)}
        codes = [value for value in dict.fromkeys((low, high)) if _stands_out(rest, value, sure)]
        if not codes:
            break
        found += codes
        rest = np.where(np.isin(rest, codes), np.nan, rest)
        low, high = float(np.nanmin(rest)), float(np.nanmax(rest))
    return found


def _is_sure(value: float) -> bool:
    """Whether nothing measures this number by chance: −9999.9, 888.8, 32767, 1e30."""
    digits = f"{abs(value):.10g}".replace(".", "")
    repeated = len(digits) >= 3 and set(digits) in ({"9"}, {"8"})
    return repeated or value in _SURE or abs(value) >= HUGE or (value < 0.0 and _is_round(value))


def _is_round(value: float) -> bool:
    """One digit and two zeros at least: 400, −200, 20000."""
    digits = f"{abs(value):.10g}"
    return digits.isdecimal() and len(digits) >= 3 and not digits[1:].strip("0")


def _stands_out(samples: Array, value: float, sure: set[float]) -> bool:
    """Whether a code occurs often enough, far from the rest, and, unless it is sure, only for moments."""
    if not (value in sure or value in _UNSURE or _is_round(value)):
        return False
    times = int(np.count_nonzero(samples == value))
    if times < (MIN_SURE if value in sure else max(MIN_UNSURE, samples.size // 2000)):
        return False
    rest = samples[np.isfinite(samples) & ~np.isin(samples, [value, *sure])]
    some = rest[:: max(1, rest.size // _SAMPLE)]
    if np.unique(some).size < _MIN_DISTINCT:
        return False
    nearest = float(np.min(np.abs(rest - value)))
    lower, upper = np.quantile(some, (0.25, 0.75))
    if nearest <= max(float(upper - lower), 0.5 * float(np.ptp(some))):
        return False
    usual = value != 0.0 or times <= MAX_ZEROS * samples.size
    return value in sure or (usual and _comes_for_moments(samples, value, nearest))


def _comes_for_moments(samples: Array, value: float, nearest: float) -> bool:
    """Whether the signal jumps to the value and soon back to where it was."""
    edges = np.diff(np.concatenate(([0], (samples == value).astype(np.int8), [0])))
    first, stop = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    inner = (first > 0) & (stop < samples.size)
    returns = np.abs(samples[stop[inner]] - samples[first[inner] - 1]) <= 0.5 * nearest
    return float(np.median(stop - first)) <= MAX_RUN and returns.sum() >= max(2, MIN_RETURNS * returns.size)


# From the columns and counts that a reader found to the Recording, the same way for every reader.


MAX_BAD = 0.5
"""Largest share of cells that are not numbers in a channel."""
_MIN_FALLING = 8
"""Fewest steps back that show a log that begins with its newest row, where no step goes forward."""

_LESS_EVEN = 0.05
"""Share of even steps that rows may lose by being put in order."""
_MIN_BACK, _MAX_BACK = 2, 0.05
"""Fewest steps back, and share of the steps, of rows that are out of order."""

_FEW_ROWS = 1000
"""Rows of a container by which its time is found."""

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
    layout, debris = _without_debris(reading, name)
    turned = _oldest_first(reading.columns, layout)
    channels = layout.channels
    values, taken = _values(reading.columns, channels, options)
    axis = _axis(reading, len(values), options, sample_period)
    timing, period = axis.timing, axis.timing.period
    notes = [*layout.notes, *debris, *turned, *axis.notes, *taken, *tally.notes]
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
    decided = () if sample_period is None else option("sample-period", repr(sample_period))
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
        read_as=_read_as(layout, time, timing, axis.unit),
        assumptions=tuple(str(note) for note in notes if isinstance(note, Assumption)),
        timing=timing,
        options=(*decided, *option_words(options)),
    )
    names = tuple(layout.columns[i].name for i in channels)
    units = tuple(layout.columns[i].unit for i in channels)
    return Recording(time, names, units, values, period, report, gaps=options.gaps)


def _without_debris(reading: Reading, name: str) -> tuple[Layout, list[str]]:
    """The layout without channels of which most cells are not numbers, and a note about each.

    Raises:
        BadFile: no other channel is left that does more than rise.
    """
    layout, rows = reading.layout, reading.tally.lines["row"]
    bad = {i for i in layout.channels if reading.tally.bad_columns[layout.columns[i].name] > MAX_BAD * rows}
    if not bad or rows < _MIN_FALLING:
        return layout, []
    names = [f'"{layout.columns[i].name}"' for i in sorted(bad)]
    good = [reading.columns[i] for i in layout.channels if i not in bad]
    if all(bool(np.all(np.diff(column) > 0)) for column in good):
        first = next((issue.text for issue in reading.tally.issues if issue.column), "")
        raise BadFile(
            f"{name} must hold numbers in at least half of the cells of a channel (got {first[:40]!r} and other"
            f" texts in most cells of {_some(names)})"
        )
    for i in bad:
        del reading.columns[i]
    columns = tuple(replace(c, role="text") if i in bad else c for i, c in enumerate(layout.columns))
    said = f"most cells of {_some(names)} are not numbers: left out"
    return replace(layout, columns=columns), [Assumption(said)]


def _read_as(layout: Layout, time: Array, timing: Timing, unit: str) -> str:
    """What was taken for what: "300 rows over 10 min; time "t" in ms; channels a, b; left out: "status" (text)"."""
    columns, taken = layout.columns, layout.time
    named = [f'"{column.name or f"column {i + 1}"}"' for i, column in enumerate(columns)]
    said = f"{count(len(time))} row{'' if len(time) == 1 else 's'}"
    if timing.period is not None and len(time) > 1:
        said += f" over {duration(float(time[-1] - time[0]))}"
    how = "no time column"
    if taken is not None:
        how = {"calendar": "as dates", "clock": "as a clock"}.get(taken.kind, f"in {unit}")
        how = f"time {' and '.join(named[i] for i in taken.indices)} {how}"
    channels = [columns[i].name for i in layout.channels]
    parts = [said, how, f"channel{'' if len(channels) == 1 else 's'} {_some(channels)}"]
    out = {"text": "text", "row name": "row names", "row number": "row numbers", "metadata": "metadata"}
    left = [f"{named[i]} ({out[column.role]})" for i, column in enumerate(columns) if column.role in out]
    return "; ".join([*parts, *([f"left out: {_some(left)}"] if left else [])])


def _some(names: list[str]) -> str:
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def _quoted(names: list[str]) -> str:
    return _some([f'"{name}"' for name in names])


def _oldest_first(columns: Columns, layout: Layout) -> list[str]:
    """Put the rows of a log in order of time where many of its steps go back, and return a note.

    Services export the newest row first, or rows as they arrived. Where a device restarts, or a few rows are out of
    order, the order is kept.
    """
    time = layout.time
    if time is None or time.kind == "clock":  # which falls at midnight
        return []
    stamps = columns[time.index]
    back = np.count_nonzero(stamps[1:] < stamps[:-1])
    if back < _MIN_BACK or back <= _MAX_BACK * (len(stamps) - 1) or len(stamps) <= _MIN_FALLING:
        return []
    falls = bool(np.all(stamps[1:] <= stamps[:-1]))
    order = np.arange(len(stamps))[::-1] if falls else np.argsort(stamps, kind="stable")
    if not falls and judge(stamps[order]).even < judge(stamps).even - _LESS_EVEN:
        return []  # the stamps of a device that restarts: in order of time its runs would mix
    for i, column in columns.items():
        columns[i] = column[order]
    found = (
        "the newest row comes first in the file"
        if falls
        else f"{count(int(back))} rows of the file step back in time"
    )
    return [Assumption(f"{found}: the rows were put in order of time")]


def _values(columns: Columns, channels: list[int], options: ReadOptions) -> tuple[Array, list[str]]:
    """Samples, shape (n, channels), without the values that the user declared missing; and how many those were."""
    # Column by column in memory: each channel is filtered, drawn and judged by itself.
    values = np.empty((len(columns[channels[0]]), len(channels)), order="F")
    for j, i in enumerate(channels):
        values[:, j] = columns.pop(i)  # no column is held twice
    notes: list[str] = []
    for number in options.missing_numbers:
        found = values == number
        notes.append(f"samples of {number:.15g} that are missing, as requested: {np.count_nonzero(found)}")
        values[found] = np.nan
    return values, notes


def _axis(reading: Reading, n: int, options: ReadOptions, sample_period: float | None) -> TimeAxis:
    layout, column = reading.layout, reading.layout.time
    given = GivenPeriod(sample_period or (options.rate and 1.0 / options.rate), layout.period)
    if column is None:
        if options.time_unit is not None:
            raise BadSetting(f"time_unit needs a time column (got {options.time_unit!r} and no time)")
        return counted_time(n, given, layout.offset, layout.start)
    stamps = reading.columns[column.index]
    return read_time(stamps, column, options.time_unit, given, options.gaps, layout.start)


def _about_columns(layout: Layout, ends: Extremes, n: int, name: str) -> list[str]:
    """Remarks about the channels; BadFile if no sample is left."""
    low, high = ends
    if not np.isfinite(low).any():
        raise BadFile(f"{name} must hold at least one number in a channel (got only missing samples)")
    notes = ["there is only one sample"] if n == 1 else []
    names = [layout.columns[i].name for i in layout.channels]
    for which, what in ((~np.isfinite(low), "without any number"), ((low == high) & (n > 1), "constant")):
        found = [one for one, chosen in zip(names, which.tolist(), strict=True) if chosen]
        notes += [f"{what}: {_quoted(found)}"] if found else []
    return notes


# From the Table of a container to the Reading that every recording is assembled from.


def reading_of(table: Table, options: ReadOptions) -> Reading:
    """The table with its time: the stamps of the file, or the column that is the time by the rules of text files.

    Raises:
        BadSetting: there is no such time column.
    """
    columns = [_column(name, unit) for name, unit in zip(table.names, table.units, strict=True)]
    data = dict(enumerate(table.columns))
    time = _find_time(table, columns, options)
    columns = [replace(column, role="text") if i in table.dates else column for i, column in enumerate(columns)]
    columns, time, notes = settle_roles(columns, time)
    if time is None and table.period is not None:
        notes = (f"the file gives one sample every {table.period:.9g} s", *notes[1:])
    notes = (*table.notes, *notes)
    layout = Layout(
        LineFormat(), tuple(columns), time, 1, frozenset(), (), notes, start=table.start, period=table.period
    )
    wanted = {*layout.channels, *(time.indices if time else ())}
    return _counted({i: column for i, column in data.items() if i in wanted}, layout, table)


def _column(name: str, unit: str) -> Column:
    """A name may hold its unit, as in a header of text."""
    column = named_column(name)
    if column.unit.isdecimal():  # acc[0] is a name
        column = Column(name)
    return column if unit in ("", column.unit) else replace(column, name=name, unit=unit)


def _find_time(table: Table, columns: list[Column], options: ReadOptions) -> TimeColumn | None:
    named = [column.name for column in columns]
    choice = options.time_column
    index = named.index(choice) if isinstance(choice, str) and choice in named else choice
    if index is None and table.time is not None:
        if options.time_unit is not None:
            raise BadSetting(f"time_unit must be left out: the file gives seconds (got {options.time_unit!r})")
        return TimeColumn(table.time, "number", "s")
    if index is None and table.dates:
        index = min(table.dates)
    if isinstance(index, int) and index in table.dates:
        return TimeColumn(index, "calendar")
    few = [column[:_FEW_ROWS].tolist() for column in table.columns]
    cells = [[f"{value:.17g}" if math.isfinite(value) else "" for value in column] for column in few]
    rows, is_named = list(zip(*cells, strict=True)), any(table.names)
    time = (
        find_time(columns, rows, ".", named=is_named) if index is None else chosen_time(columns, rows, ".", index)
    )
    if time is None or time.kind != "number":
        return None
    column = table.columns[time.index]
    counts = column[0] in (0, 1) and bool(np.all(np.diff(column) == 1))  # beside a rate, the numbers of the samples
    return None if index is None and table.period is not None and not time.unit and counts else time


def _counted(columns: dict[int, Array], layout: Layout, table: Table) -> Reading:
    """Rows without a stamp are rejected; infinite samples are missing ones, counted as bad cells."""
    tally, rejected, n = Tally(), 0, table.shape[0]
    if layout.time is not None:
        known = np.isfinite(columns[layout.time.index])
        rejected = int(np.count_nonzero(~known))
        if rejected:
            columns = {i: column[known] for i, column in columns.items()}
    for i in layout.channels:
        infinite = np.isinf(columns[i])
        if infinite.any():
            tally.bad_cells += int(np.count_nonzero(infinite))
            columns[i] = np.where(infinite, np.nan, columns[i])
    tally.lines.update(row=n - rejected, rejected=rejected)
    return Reading(columns, tally, layout)
