"""Read logs of every common dialect into a Recording, with its time, its notes and an account of every line."""

from __future__ import annotations

import io
import math
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from kalscope.common.files import Unpacking, does_not_fit
from kalscope.common.numbers import Array, Indices, check_sample_period
from kalscope.common.progress import OnProgress, Progress
from kalscope.common.text import count, duration
from kalscope.errors import BadFile, BadSetting, NoMemory
from kalscope.recording import Assumption, ReadReport, Recording, Timing
from kalscope.sources.containers.registry import Container, find_container, read_container, storage_of
from kalscope.sources.containers.table import Part, Table, choose_part, refuse_part
from kalscope.sources.grammar.line_format import LineFormat
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions, option, option_words
from kalscope.sources.grammar.timestamps import TimeColumn, judge
from kalscope.sources.reading.account import no_channel, no_rows, no_table, refuse_foreign
from kalscope.sources.reading.axis import GivenPeriod, counted_time, fill_gaps, read_time
from kalscope.sources.reading.columns import UNIT_NAMES, Column, distinct_names, named_column, settle_roles
from kalscope.sources.reading.rows import Tally, read_rows
from kalscope.sources.reading.sniffer import MAX_INSIDE, MIN_CYCLES, Layout, sniff
from kalscope.sources.reading.text_file import (
    RawFile,
    find_encoding,
    open_raw,
    open_text,
    plain_lines,
    sample_lines,
    text_as_file,
    unusual_marks,
)
from kalscope.sources.reading.time_columns import find_time

# Values that may stand for "no sample", such as −200 or 400: found and asked about. What the lines above a table
# call so is removed, and so are nines that are very far from all else, such as −9999.
#
# A code is a number that nothing measures by chance, far from all that is measured. Some numbers are always codes
# there (−999, 32767). Others are readings as well (0, 400): they are codes only where they appear for a moment, and
# the signal then continues where it was. A stopped motor or a lamp that is off stays so.


Extremes = tuple[Array, Array]
"""Smallest and largest sample of each channel, shape (channels,) each; NaN where all are missing."""

_SURE = {
    *(32767.0, -32768.0, 65535.0, 8388607.0, -8388608.0, 2147483647.0, -2147483648.0, 4294967295.0),
    *(-127.0, 85.0, -7999.0, 7999.0, -6999.0, 6999.0, -273.15, -273.0, 8190.0, 8191.0),
}
"""Limits of a processor's integers; DS18B20: not connected, not converted; Campbell: NAN; absolute zero; VL53L0X:
out of range."""
_UNSURE = {0.0, -1.0, 99.0, -99.0, 255.0, 1023.0, 4095.0}
"""Zero, an error value of C, and limits of short integers."""
_NINES = re.compile(r"(?:-9{3,}|9{4,}|-8{3,})(?:\.9{1,3})?")
"""Codes that are removed unasked where they are very far from the rest."""
_OVERFLOWS = {9.9e37, 9.91e37, 1e38}
"""Overload and NaN of instruments (SCPI), of either sign: always removed."""


def find_missing(values: Array, names: Sequence[str], ends: Extremes, *, is_declared: bool = False) -> list[str]:
    """Replace values that are certainly no samples by NaN, in place, and ask about others that may be none.

    Args:
        values: Samples, shape (n, channels), NaN where missing.
        names: Channel names.
        ends: Their smallest and largest samples.
        is_declared: Whether the user has declared what is missing: then no code of nines is removed unasked.

    Returns:
        One sentence for each value that is the smallest or largest of a channel, a code, and further from the rest
        than the middle half of the rest is wide, and half of all of it.
    """
    found: dict[tuple[float, bool], dict[int, int]] = {}
    for i, (low, high) in enumerate(zip(*ends, strict=True)):
        for value in {float(low), float(high)}:
            sure = min(_surety(value), 2 if is_declared else 3)
            certain = abs(value) in _OVERFLOWS or (sure == 3 and _stands_out(values[:, i], value, sure))
            if certain or _stands_out(values[:, i], value, min(sure, 2)):
                here = values[:, i] == value
                found.setdefault((value, certain), {})[i] = int(np.count_nonzero(here))
                values[here & certain, i] = np.nan
    notes: list[str] = []
    for (value, certain), often in found.items():
        where = _listed([f'"{names[i]}"' for i in often])
        times = f"{count(sum(often.values()))} times in {where}, far from the rest"
        asked = f"is {value:.15g} a missing value? It occurs {times}; if so, read with --missing {value:.15g}"
        undo = "" if abs(value) in _OVERFLOWS else "; if not, read with --missing none"
        notes.append(Assumption(f"{value:.15g} is a missing value: it occurs {times}{undo}" if certain else asked))
    return notes


def _surety(value: float) -> int:
    """3 for −9999.9; 2 for others that nothing measures by chance, 888.8, −200, 1e30; 1 for 400, 255; else 0."""
    if _NINES.fullmatch(f"{value:.10g}"):
        return 3
    digits = f"{abs(value):.10g}"
    bare = digits.replace(".", "")
    is_round = digits.isdecimal() and len(digits) >= 3 and not digits[1:].strip("0")
    repeated = len(bare) >= 3 and set(bare) in ({"9"}, {"8"})
    # Fill values of binary formats are huge: 1e30, 9.97e36, 3.4e38.
    if repeated or value in _SURE or abs(value) >= 1e20 or (is_round and value < 0):
        return 2
    return int(is_round or value in _UNSURE)


@np.errstate(over="ignore", invalid="ignore")  # near the ends of float64
def _stands_out(samples: Array, value: float, sure: int) -> bool:
    """Whether a code occurs often enough, far from the rest, and, unless it is sure, only for moments."""
    if not sure:
        return False
    here, rest = samples == value, samples[np.isfinite(samples) & (samples != value)]
    some = rest[:: max(1, rest.size // 20_000)]
    least = max(3, samples.size // 2000) if sure == 1 else 4 - sure
    if np.count_nonzero(here) < least or np.unique(some).size < 3:  # a switch, an event marker
        return False
    nearest = float(np.min(np.abs(rest - value)))
    lower, upper = np.quantile(some, (0.25, 0.75))
    if nearest <= max(float(upper - lower), (10.0 if sure == 3 else 0.5) * float(np.ptp(some))):
        return False
    edges = np.flatnonzero(np.diff(np.concatenate(([0], here.astype(np.int8), [0]))))
    brief = np.median(edges[1::2] - edges[::2]) <= 3 and here.mean() <= 0.3  # else it is a state
    return sure > 1 or bool(brief)


# From the columns and counts that a reader found to the Recording, the same way for every reader.


MAX_BAD = 0.5
"""Largest share of cells that are not numbers in a channel."""
_MIN_FALLING = 8
"""Fewest steps back that show a log that begins with its newest row, where no step goes forward."""

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
    periods = [period for period in (sample_period, options.rate and 1.0 / options.rate) if period is not None]
    for period in periods:
        check_sample_period(period)
    if len(periods) == 2 and abs(periods[0] - periods[1]) > 1e-6 * periods[1]:
        got = f"{options.rate:.9g} Hz and {sample_period:.9g} s"
        raise BadSetting(f"rate and sample period must agree, or one be left out (got {got})")


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
    values, taken = _values(reading.columns, layout, options)
    given = GivenPeriod(sample_period or (options.rate and 1.0 / options.rate), layout.period)
    if layout.time is None:
        if options.time_unit is not None:
            raise BadSetting(f"time_unit needs a time column (got {options.time_unit!r} and no time)")
        axis = counted_time(len(values), given, layout.start)
    else:
        stamps = reading.columns[layout.time.index]
        axis = read_time(stamps, layout.time, options.time_unit, given, options.gaps, layout.start)
    timing, period = axis.timing, axis.timing.period
    notes = [*layout.notes, *debris, *turned, *axis.notes, *taken, *tally.notes]
    with np.errstate(invalid="ignore"):
        ends = np.fmin.reduce(values), np.fmax.reduce(values)
    notes += _about_columns(layout, ends, len(values), name)
    names = tuple(layout.columns[i].name for i in channels)
    notes += find_missing(values, names, ends, is_declared=bool(options.missing))
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
            f" texts in most cells of {_listed(names)})"
        )
    for i in bad:
        del reading.columns[i]
    columns = tuple(replace(c, role="text") if i in bad else c for i, c in enumerate(layout.columns))
    said = f"most cells of {_listed(names)} are not numbers: left out"
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
    parts = [said, how, f"channel{'' if len(channels) == 1 else 's'} {_listed(channels)}"]
    out = {"text": "text", "row name": "row names", "row number": "row numbers", "metadata": "metadata"}
    left = [f"{named[i]} ({out[column.role]})" for i, column in enumerate(columns) if column.role in out]
    return "; ".join([*parts, *([f"left out: {_listed(left)}"] if left else [])])


def _listed(names: list[str], most: int = 6) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _oldest_first(columns: Columns, layout: Layout) -> list[str]:
    """Put the rows of a log in order of time where most of its steps go back or that makes them more even; say so.

    Services export the newest row first, pages of rows, or rows as they arrived. Where a device restarts, the order
    is kept: in order of time its runs would mix.
    """
    if layout.time is None:
        return []
    stamps, turn_s = columns[layout.time.index], layout.time.turn_s
    back = int(np.count_nonzero(stamps[1:] < stamps[:-1]))
    if back < 2 or len(stamps) <= _MIN_FALLING:
        return []
    if np.all(stamps[1:][stamps[1:] < stamps[:-1]] == stamps[0]):  # runs of a simulation
        return []
    falls = 2 * back > len(stamps)
    order = np.arange(len(stamps))[:: -1 if falls else 1]
    stamps = np.unwrap(stamps[order], period=1e6 * turn_s) if turn_s else stamps[order]
    rising = np.argsort(stamps, kind="stable")
    if not falls and judge(stamps[rising]).even <= judge(stamps).even:
        return []
    for i, column in columns.items():
        columns[i] = column[order[rising]]
    return [Assumption(f"{count(back)} rows of the file step back in time: the rows were put in order of time")]


def _values(columns: Columns, layout: Layout, options: ReadOptions) -> tuple[Array, list[str]]:
    """Samples, shape (n, channels), without those that the user or the file declared missing; and how many."""
    # Column by column in memory: each channel is filtered, drawn and judged by itself.
    values = np.empty((len(columns[layout.channels[0]]), len(layout.channels)), order="F")
    for j, i in enumerate(layout.channels):
        values[:, j] = columns.pop(i)  # no column is held twice
    notes: list[str] = []
    said = dict.fromkeys(layout.missing, "as stated") | dict.fromkeys(options.missing_numbers, "as requested")
    for number, why in said.items():
        found = values == number
        notes.append(f"samples of {number:.15g} that are missing, {why}: {np.count_nonzero(found)}")
        values[found] = np.nan
    return values, notes


def _about_columns(layout: Layout, ends: Extremes, n: int, name: str) -> list[str]:
    """Remarks about the channels; BadFile if no sample is left."""
    low, high = ends
    if not np.isfinite(low).any():
        raise BadFile(f"{name} must hold at least one number in a channel (got only missing samples)")
    notes = ["there is only one sample"] if n == 1 else []
    names = [layout.columns[i].name for i in layout.channels]
    for which, what in ((~np.isfinite(low), "without any number"), ((low == high) & (n > 1), "constant")):
        found = [f'"{one}"' for one, chosen in zip(names, which.tolist(), strict=True) if chosen]
        notes += [f"{what}: {_listed(found)}"] if found else []
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
        notes[0] = f"the file gives one sample every {table.period:.9g} s"
    notes = (*table.notes, *notes)
    layout = Layout(LineFormat(), tuple(columns), time, 1, frozenset(), (), notes, start=table.start)
    layout = replace(layout, period=table.period)
    wanted = {*layout.channels, *(time.indices if time else ())}
    return _of_table({i: column for i, column in data.items() if i in wanted}, layout, table)


def _column(name: str, unit: str) -> Column:
    """A name may hold its unit, as in a header of text."""
    column = named_column(name)
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
    few = [column[:1000].tolist() for column in table.columns]
    cells = [[f"{value:.17g}" if math.isfinite(value) else "" for value in column] for column in few]
    rows, is_named = list(zip(*cells, strict=True)), any(table.names)
    time = find_time(columns, rows, ".", named=is_named, choice=index)
    if time is None or time.kind != "number" or time.parts:
        return None
    column = table.columns[time.index]
    counts = column[0] in (0, 1) and bool(np.all(np.diff(column) == 1))  # beside a rate, the numbers of the samples
    return None if index is None and table.period is not None and not time.unit and counts else time


def _of_table(columns: dict[int, Array], layout: Layout, table: Table) -> Reading:
    """Rows without a stamp are rejected; infinite samples are missing ones, counted as bad cells."""
    tally, rejected, n = Tally(), 0, len(table.columns[0])
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


# Turn a long table, one named value per row, into channels: those that share their stamps are one part.


_MAX_LISTED = 4
"""Names of a part that its own name lists."""


def widened(table: list[Array], tally: Tally, layout: Layout, part: str | None, name: str) -> Reading:
    """One part of a long table, a column for each name.

    Args:
        table: Its columns, each of shape (rows,), with the index of the name in the first "series" one.
        tally: The account of its lines, with the names.
        layout: What its columns are.
        part: `ReadOptions.part`: a name.
        name: The file.

    Raises:
        BadFile: no name has a number.
        BadSetting: there is no such part.
    """
    codes = table[next(i for i, column in enumerate(layout.columns) if column.role == "series")]
    kept = np.isfinite(codes)
    codes = codes[kept].astype(np.int64)
    measures = [(layout.columns[i], table[i][kept]) for i in layout.channels]
    stamps = _counted(codes) if layout.time is None else _in_turns(codes, table[layout.time.index][kept])
    distinct, ranks = np.unique(stamps, return_inverse=True)
    # Several samples of one name at one stamp: the first ones belong together, then the second ones, and so on.
    turns = _counted(codes * len(distinct) + ranks)
    most = int(turns.max(initial=0)) + 1
    keys = ranks * most + turns
    read = np.isfinite(np.column_stack([values for _, values in measures])).any(axis=1)
    known = {code: keys[codes == code] for code in np.unique(codes[read]).tolist()}
    groups = _groups(known)
    described = _described(tally.series, layout)
    parts: list[Part] = []
    for group, times in groups:
        names = [described[code].name for code in group]
        parts.append(Part(_listed(names, _MAX_LISTED), len(times), len(group) * len(measures)))
        part = parts[-1].name if part in names else part
    chosen, notes = choose_part(parts, part, name, "set of names")
    notes = tuple(map(Assumption, notes))
    silent = [described[code].name for code in range(len(tally.series)) if code not in known]
    if silent:
        notes = (*notes, f"names without numbers: {_listed(silent, _MAX_LISTED)}")
    group, places = groups[chosen]
    columns, data = list[Column](), list[Array]()
    named = len(tally.series) > 1 or (len(measures) == 1 and described[0].name)
    for code in group:
        here = codes == code
        for measure, values in measures:
            if np.isnan(values[here]).all():
                continue  # measured by others only
            data.append(np.full(len(places), np.nan))
            data[-1][np.searchsorted(places, keys[here])] = values[here]
            column = _of_series(described[code], measure, single=len(measures) == 1)
            columns.append(column if named else measure)
    names = distinct_names([column.name for column in columns])
    columns = [replace(column, name=one) for column, one in zip(columns, names, strict=True)]
    time = None
    if layout.time is not None:
        time = replace(layout.time, index=0, parts=())
        columns.insert(0, Column("time", role="time"))
        data.insert(0, distinct[places // most].astype(np.float64))
    layout = replace(layout, columns=tuple(columns), time=time, notes=(*layout.notes, *notes))
    return Reading(dict(enumerate(data)), tally, layout)


def _of_series(series: Column, measure: Column, *, single: bool) -> Column:
    """The channel of one series, and of one of its measures where there are several: "kitchen temp" in °C."""
    if single:
        return series if series.unit else replace(series, unit=measure.unit)
    return replace(measure, name=f"{series.name} {measure.name}".strip(), form=None)


def _in_turns(codes: Indices, stamps: Array) -> Array:
    """The stamps, where the names come in turn those of the first of each turn: all of one turn are one row."""
    begins = np.flatnonzero(codes == codes[0]) if codes.size else codes
    ends = np.append(begins[1:], len(codes))
    kinds = np.unique(codes).size
    if kinds < 2 or len(begins) < MIN_CYCLES or np.mean(ends - begins == kinds) < 0.9:
        return stamps
    inside, between = stamps[ends - 1] - stamps[begins], np.diff(stamps[begins])
    if not 0 <= np.median(inside) <= MAX_INSIDE * np.median(between):
        return stamps
    return np.repeat(stamps[begins], ends - begins)


def _counted(codes: Indices) -> Indices:
    """How often each value came before, shape (n,)."""
    order = np.argsort(codes, kind="stable")
    first = np.flatnonzero(np.diff(codes[order], prepend=-1))
    turns = np.empty(len(codes), dtype=np.int64)
    turns[order] = np.arange(len(codes)) - np.repeat(first, np.diff(np.append(first, len(codes))))
    return turns


def _groups(stamps: dict[int, Indices]) -> list[tuple[list[int], Indices]]:
    """The names that share half of their stamps or more, with all their stamps; those with most stamps first."""
    groups: list[tuple[list[int], Indices]] = []
    for code in sorted(stamps, key=lambda code: (-len(stamps[code]), code)):
        own = np.unique(stamps[code])
        for i, (members, times) in enumerate(groups):
            if np.isin(own, times, assume_unique=True).mean() >= 0.5:
                members.append(code)
                groups[i] = (members, np.union1d(times, own))
                break
        else:
            groups.append(([code], own))
    return [(sorted(members), times) for members, times in groups]


def _described(series: tuple[tuple[str, ...], ...], layout: Layout) -> list[Column]:
    """Name and unit of each series: of the parts of its name only those that differ between series."""
    columns = [column.name.lower() for column in layout.columns if column.role == "series"]
    naming = [i for i, column in enumerate(columns) if column not in UNIT_NAMES]
    telling = [i for i in naming if len({key[i] for key in series}) > 1]
    telling = telling or [i for i in naming if "field" in columns[i]] or naming
    order = sorted(telling, key=lambda i: "field" in columns[i])  # measurement and tags, then the field
    units = [i for i, column in enumerate(columns) if column in UNIT_NAMES]
    return [Column(".".join(key[i] for i in order), "".join(key[i] for i in units)) for key in series]


# Read CSV logs of every common dialect into a Recording, with an account of every line.
#
# Rules. A line of the right shape keeps its place in time; a cell of it that is not a number is a missing sample,
# reported with line, column and text. A line of the wrong shape is rejected and reported; where there is no
# time column it still leaves one missing sample, because the sensor did sample then. A last line without a
# newline is torn, its last number may have been cut: it is kept only where it shows that nothing was cut. A line
# whose stamp cannot be read is rejected: its samples have no place.
#
# Plain rows are read by compiled loops, all other lines by the line reader, with the same values and account.


HEAD_BYTES = (65536, 1 << 20)
"""How much is sniffed: 64 KiB, and where that shows no data (a long preamble) 1 MiB."""
HEAD_LINES = 1 << 15
"""Lines of them at most: a head of short lines would take seconds to be judged."""


def read_recording(
    path: str | Path,
    options: ReadOptions = DEFAULTS,
    *,
    sample_period: float | None = None,
    progress: OnProgress | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> Recording:
    """Read a recording: a table of text, the lines that boards print, a file of an instrument, or a container.

    Text: encoding, delimiter, decimal mark, header, units, comments and the time column are detected, `.gz` and
    `.zst` are unpacked, and the files of known instruments are read by their own rules. Containers: zip, JSON,
    LabVIEW `.lvm`, MATLAB `.mat`, NumPy; with `kalscope[formats]` Parquet, spreadsheets, TDMS, HDF5, MCAP, ROS
    bags and ULog.
    docs/files.md says what is read, and how.

    Args:
        path: The file.
        options: What is decided by the caller instead.
        sample_period: Nominal sample period in s, > 0; overrides that of the stamps, and gives a file
            without a time column its time. `options.rate` gives the same in Hz.
        progress: Called from the first second on with the fraction done, 0…1, and what is being done.
        cancelled: Called as often; True stops the reading.

    Returns:
        A Recording: values (n, channels) with NaN for missing samples, time (n,) in s, `report` with the
        account of all lines and, among its notes, questions such as whether −200 is a missing value.

    Raises:
        BadFile: the file cannot be read, or holds no number.
        BadSetting: `sample_period` is not between 1e-50 and 1e50 s, or contradicts `options.rate`; an option that
            this file cannot have.
        Cancelled: `cancelled()` was true.
        NoMemory: it does not fit into the memory that is free.
    """
    check_chosen_period(options, sample_period)
    name = Path(path).name or str(path)
    path = storage_of(Path(path))
    progress = Progress(progress, cancelled, unpacking=Unpacking(path, options.unpack_gb))
    try:
        with open_raw(path, progress) as raw:
            container = find_container(raw.head, name)
            read = _read_text if container is None else partial(_read_container, container)
            recording = assemble(read(raw, options, progress), options, sample_period, name)
            # An absolute path, so that a tuning file reopens it from any folder.
            return replace(recording, source=os.path.abspath(path), title=name, sha256=raw.digest.result())
    except NoMemory:
        raise
    except MemoryError:
        raise does_not_fit(name) from None


def _read_text(raw: RawFile, options: ReadOptions, progress: Progress) -> Reading:
    encoding = find_encoding(raw, progress)
    notes = unusual_marks(raw)
    if not notes:
        return _read_lines(raw, encoding, options, progress)
    with text_as_file(plain_lines(raw, encoding), raw, progress.part(0.0, 0.5), newline="") as text:
        reading = _read_lines(text, "utf-8", options, progress.part(0.5, 1.0))
    return replace(reading, layout=replace(reading.layout, notes=(*notes, *reading.layout.notes)))


def _read_lines(raw: RawFile, encoding: str, options: ReadOptions, progress: Progress) -> Reading:
    layout = _sniff_head(raw, encoding, options)
    table, tally = read_rows(raw.path, encoding, layout, options, progress)
    if tally.series:
        return widened(table, tally, layout, options.part, raw.name)
    refuse_part(options.part, raw.name)
    columns = {i: table[i] for i in (*layout.channels, *(layout.time.indices if layout.time else ()))}
    table.clear()
    return Reading(columns, tally, layout)


def _read_container(container: Container, raw: RawFile, options: ReadOptions, progress: Progress) -> Reading:
    held = read_container(container, raw.path, raw.name, options.part, progress.part(0.0, 0.5))
    if isinstance(held, Table):
        return reading_of(held, options)
    options = replace(options, delimiter=held.delimiter or options.delimiter, part=held.part)
    with text_as_file(held.lines, raw, progress.part(0.5, 0.75)) as text:
        reading = _read_text(text, options, progress.part(0.75, 1.0))
    return replace(reading, layout=replace(reading.layout, notes=(*held.notes, *reading.layout.notes)))


def _sniff_head(raw: RawFile, encoding: str, options: ReadOptions) -> Layout:
    lines: list[str] = []
    for size in HEAD_BYTES:
        lines = list(islice(open_text(io.BytesIO(raw.head[:size]), encoding), HEAD_LINES))
        refuse_foreign(raw.name, lines)
        is_whole = raw.size <= size and len(lines) < HEAD_LINES
        if not is_whole and len(lines) > 1:
            lines.pop()  # cut by the limit
        samples = () if is_whole else sample_lines(raw, encoding)
        layout = sniff([line.rstrip("\n") for line in lines], options, samples)
        if layout is not None:
            if layout.channels:
                return layout
            raise no_channel(raw.name, lines)
        if raw.size <= size:
            break
    raise no_table(raw.name, lines, options)
