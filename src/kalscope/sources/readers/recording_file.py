"""Read CSV logs of every common dialect into a Recording, with an account of every line.

Rules. A line of the right shape keeps its place in time; a cell of it that is not a number is a missing sample,
reported with line, column and text. A line of the wrong shape is rejected and reported; where there is no
time column it still leaves one missing sample, because the sensor did sample then. A last line without a
newline is torn, its last number may have been cut: it is kept only where it shows that nothing was cut. A line
whose stamp cannot be read is rejected: its samples have no place.

Plain rows are read by compiled loops, all other lines by the line reader, with the same values and account.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path

from kalscope.common.memory import does_not_fit
from kalscope.common.progress import OnProgress, Progress
from kalscope.common.unpacking import Unpacking
from kalscope.errors import NoMemory
from kalscope.recording import Recording
from kalscope.sources.containers.parts import refuse_part
from kalscope.sources.containers.registry import Container, find_container, read_container, storage_of
from kalscope.sources.containers.table import Table
from kalscope.sources.grammar.read_options import DEFAULTS, ReadOptions
from kalscope.sources.layout.sniffer import Layout, sniff
from kalscope.sources.readers.assemble import Reading, assemble, check_chosen_period
from kalscope.sources.readers.csv_rows import read_rows
from kalscope.sources.readers.long_table import is_long, widened
from kalscope.sources.readers.refusals import no_channel, no_table, refuse_markup
from kalscope.sources.readers.table_reading import reading_of
from kalscope.sources.readers.text_file import (
    RawFile,
    find_encoding,
    open_raw,
    open_text,
    plain_lines,
    sample_lines,
    text_as_file,
    unusual_marks,
)

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
    LabVIEW `.lvm`, MATLAB `.mat`; with `kalscope[formats]` Parquet, spreadsheets, TDMS, HDF5, MCAP, ROS bags, ULog.
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
    if is_long(layout):
        return widened(table, tally, layout, options.part, raw.name)
    refuse_part(options.part, raw.name)
    columns = {i: table[i] for i in (*layout.channels, *(layout.time.indices if layout.time else ()))}
    table.clear()
    return Reading(columns, tally, layout, layout.period)


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
        refuse_markup(raw.name, lines)
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
