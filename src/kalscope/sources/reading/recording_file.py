"""Read CSV logs of every common dialect into a Recording, with an account of every line."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from kalscope.common.files import Unpacking, does_not_fit
from kalscope.common.numbers import Array, Indices
from kalscope.common.progress import OnProgress, Progress
from kalscope.errors import BadFile, NoMemory
from kalscope.recording import Assumption, Recording
from kalscope.sources.containers.registry import Container, find_container, read_container, storage_of
from kalscope.sources.containers.table import Part, Table, choose_part, refuse_part
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.reading.account import no_channel, no_table, refuse_foreign
from kalscope.sources.reading.assemble import Reading, assemble, check_chosen_period, reading_of
from kalscope.sources.reading.columns import UNIT_NAMES, Column, distinct_names
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

# Turn a long table, one named value per row, into channels: those that share their stamps are one part.


_MAX_LISTED = 4
_MIN_WHOLE_TURNS = 0.9
"""Share of the turns in which each name comes once."""
_MIN_SHARED = 0.5
"""Share of the stamps of the shorter of two series that the other has as well, where both belong to one part."""


def is_long(layout: Layout) -> bool:
    """True where rows hold one value each, beside its name."""
    return any(column.role == "series" for column in layout.columns)


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
    known = [
        code
        for code in range(len(tally.series))
        if any(np.isfinite(values[codes == code]).any() for _, values in measures)
    ]
    groups = _groups({code: keys[codes == code] for code in known})
    described = _described(tally.series, layout)
    names = [_listed([described[code].name for code in group]) for group in groups]
    for one, group in zip(names, groups, strict=True):
        part = one if part in {described[code].name for code in group} else part
    sizes = zip(names, groups.items(), strict=True)
    parts = [Part(one, len(times), len(group) * len(measures)) for one, (group, times) in sizes]
    if not parts:
        raise BadFile(f"{name} must hold a named value that is a number (got {len(tally.series)} names without)")
    chosen, notes = choose_part(parts, part, name, "set of names")
    group, places = list(groups.items())[chosen]
    times, notes = distinct[places // most], tuple(map(Assumption, notes))
    silent = [described[code].name for code in range(len(tally.series)) if code not in known]
    if silent:
        notes = (*notes, f"names without numbers: {_listed(silent)}")
    time = None if layout.time is None else replace(layout.time, index=0, parts=())
    data: dict[int, Array] = {} if time is None else {0: times.astype(np.float64)}
    columns = [] if time is None else [Column("time", role="time")]
    for code in group:
        here = codes == code
        for measure, values in measures:
            column = np.full(len(times), np.nan)
            column[np.searchsorted(places, keys[here])] = values[here]
            data[len(columns)] = column
            columns.append(_of_series(described[code], measure, single=len(measures) == 1))
    first = len(columns) - len(group) * len(measures)
    for i, one in enumerate(distinct_names([column.name for column in columns[first:]]), first):
        columns[i] = replace(columns[i], name=one)
    return Reading(data, tally, replace(layout, columns=tuple(columns), time=time, notes=(*layout.notes, *notes)))


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
    if kinds < 2 or len(begins) < MIN_CYCLES or np.mean(ends - begins == kinds) < _MIN_WHOLE_TURNS:
        return stamps
    inside, between = stamps[ends - 1] - stamps[begins], np.diff(stamps[begins])
    if not 0 <= np.median(inside) <= MAX_INSIDE * np.median(between):
        return stamps
    return np.repeat(stamps[begins], ends - begins)


def _listed(names: list[str]) -> str:
    return ", ".join(names[:_MAX_LISTED]) + (f" and {len(names) - _MAX_LISTED} more" if names[_MAX_LISTED:] else "")


def _counted(codes: Indices) -> Indices:
    """How often each value came before, shape (n,)."""
    order = np.argsort(codes, kind="stable")
    first = np.flatnonzero(np.diff(codes[order], prepend=-1))
    turns = np.empty(len(codes), dtype=np.int64)
    turns[order] = np.arange(len(codes)) - np.repeat(first, np.diff(np.append(first, len(codes))))
    return turns


def _groups(stamps: dict[int, Indices]) -> dict[tuple[int, ...], Indices]:
    """The names that share most of their stamps, with all their stamps; those with most stamps first."""
    groups: list[tuple[list[int], Indices]] = []
    for code in sorted(stamps, key=lambda code: (-len(stamps[code]), code)):
        own = np.unique(stamps[code])
        for i, (members, times) in enumerate(groups):
            if np.isin(own, times, assume_unique=True).mean() >= _MIN_SHARED:
                members.append(code)
                groups[i] = (members, np.union1d(times, own))
                break
        else:
            groups.append(([code], own))
    return {tuple(sorted(members)): times for members, times in groups}


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
    docs/files/reading-files.md says what is read, and how.

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
            reading = (
                _read_text(raw, options, progress)
                if container is None
                else _read_container(container, raw, options, progress)
            )
            recording = assemble(reading, options, sample_period, name)
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
    if is_long(layout) and tally.lines["row"]:
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
