"""CSV logs of every common dialect into a Recording, with an account of every line.

Rules. A line of the right shape keeps its place in time; a cell of it that is no number is a missing sample,
reported with line, column and text. A line of the wrong shape is rejected and reported; where there is no
time column it still leaves one missing sample, because the sensor did sample then. A last line without a
newline is torn: its last number may have been cut, so none is taken. A line whose stamp cannot be read is
rejected: its samples have no place.
"""

from __future__ import annotations

import hashlib
import math
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kalscope.errors import BadFile, BadSetting
from kalscope.recording import ReadReport, Recording
from kalscope.sources.csv_rows import Tally, read_rows
from kalscope.sources.line_parser import is_blank, is_comment
from kalscope.sources.sniffer import Layout, sniff
from kalscope.sources.text_file import find_encoding, open_text, read_bytes, unpack
from kalscope.sources.timestamps import nominal_period, to_seconds

HEAD_BYTES = (65536, 1 << 20)
"""How much is sniffed: 64 KiB, and where that shows no data (a long preamble) 1 MiB."""


def read_recording(path: str | Path, *, sample_period: float | None = None) -> Recording:
    """Read a CSV log.

    Delimiter (`, ; TAB |` or blanks), decimal mark, header, units, comment lines (# % //) and time column are
    found by looking; UTF-8 with or without BOM, UTF-16 with BOM and Latin-1; any line ends; .gz as well.
    Lines of `name:value` pairs and the Arduino IDE's `12:00:00.023 -> ` stamps are understood.

    Args:
        path: The file.
        sample_period: Nominal sample period in s, > 0; overrides the median step of the time column, and
            gives a file without one its time.

    Returns:
        A Recording: values (n, channels) with NaN for missing samples, time (n,) in s, `report` with the
        account of all lines.

    Raises:
        BadFile: the file cannot be read, or holds no number.
        BadSetting: `sample_period` is no positive finite number.
    """
    if sample_period is not None and not (math.isfinite(sample_period) and sample_period > 0):
        raise BadSetting(f"sample_period must be a positive number of seconds (got {sample_period!r})")
    name = Path(path).name or str(path)
    packed = read_bytes(path)
    data = unpack(packed, name)
    encoding = find_encoding(data, name)
    layout = _sniff_head(data, encoding, name)
    table, tally = read_rows(data, encoding, layout)
    channels, notes = _keep_channels(table, tally, layout, name)
    time, period, backward, said = _read_time(table, layout, sample_period)
    report = ReadReport(
        lines=tally.lines,
        rows=tally.rows,
        rejected=tally.rejected,
        blank=tally.blank,
        comments=tally.comments,
        headers=tally.headers,
        bad_cells=tally.bad_cells,
        clipped_times=backward,
        issues=tuple(tally.issues),
        notes=layout.notes + said + notes,
    )
    return Recording(
        time=time,
        names=tuple(layout.columns[i].name for i in channels),
        units=tuple(layout.columns[i].unit for i in channels),
        values=table[:, channels],
        sample_period=period,
        report=report,
        source=os.path.abspath(path),  # so that a tuning file reopens it from any folder
        title=name,
        sha256=hashlib.sha256(packed).hexdigest(),
    )


def _sniff_head(data: bytes, encoding: str, name: str) -> Layout:
    lines: list[str] = []
    for size in HEAD_BYTES:
        lines = list(open_text(data[:size], encoding))
        if len(data) > size and len(lines) > 1:
            lines.pop()  # cut by us
        layout = sniff([line.rstrip("\n") for line in lines])
        if layout is not None:
            if any(column.role == "channel" for column in layout.columns):
                return layout
            raise BadFile(f"{name} must hold a column of numbers besides the time (got only text)")
        if len(data) <= size:
            break
    said = [line for line in lines if not is_blank(line) and not is_comment(line)]
    if not said:
        raise BadFile(f"{name} must hold lines of numbers (got {len(lines)} blank or comment lines)")
    if len(said) <= 2:
        raise BadFile(f"{name} must hold numbers below its header (got only {said[0].strip()[:80]!r})")
    raise BadFile(
        f"{name} must be a table of numbers, one sample a line (got text such as {said[-1].strip()[:60]!r})"
    )


def _keep_channels(
    table: NDArray[np.float64], tally: Tally, layout: Layout, name: str
) -> tuple[list[int], tuple[str, ...]]:
    """Columns that are channels and what to say about them; BadFile where no sample is left."""
    if tally.rows == 0:
        last = tally.issues[-1].reason if tally.issues else "no data lines"
        raise BadFile(f"{name} must hold a whole line of numbers (got {tally.rejected} rejected lines: {last})")
    names = [column.name or f"column {i + 1}" for i, column in enumerate(layout.columns)]
    channels = [i for i, column in enumerate(layout.columns) if column.role == "channel"]
    finite = np.isfinite(table)
    if not finite[:, channels].any():
        raise BadFile(f"{name} must hold at least one number in a channel (got only missing samples)")
    notes = [
        f'"{names[i]}" holds {"text" if column.role == "text" else "row names"}, it is not a channel'
        for i, column in enumerate(layout.columns)
        if column.role in ("text", "row name")
    ]
    if tally.rows == 1:
        notes.append("there is only one sample")
    for i in channels:
        samples = table[finite[:, i], i]
        if samples.size == 0:
            notes.append(f'"{names[i]}" holds only missing samples')
        elif samples.size > 1 and samples.min() == samples.max():
            notes.append(f'"{names[i]}" is constant')
    return channels, tuple(notes)


def _read_time(
    table: NDArray[np.float64], layout: Layout, sample_period: float | None
) -> tuple[NDArray[np.float64], float | None, int, tuple[str, ...]]:
    """Time in s, nominal sample period, steps backward, and what to say about them."""
    if layout.time is None:
        rows = np.arange(len(table), dtype=np.float64)
        return rows * (sample_period or 1.0), sample_period, 0, ()
    time, said = to_seconds(table[:, layout.time.index], layout.time)
    backward = int(np.count_nonzero(np.diff(time) < 0))
    notes = (said, f"time steps back {backward} times") if backward else (said,)
    return time, sample_period or nominal_period(time), backward, notes
