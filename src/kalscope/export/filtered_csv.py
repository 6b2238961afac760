"""The filtered recording as CSV: time, and for each channel the raw signal, the filtered one, its variance.

A channel with momentum has its velocity as well, `<ch>_velocity_per_s`, or `_per_sample` where the sample period is
not known. Of fused channels the raw signals come first, then the fused value and its variance.

It reopens in Kalscope, numpy, pandas and a spreadsheet without any option: one header line, commas,
decimal points, UTF-8 without BOM, newlines alone, an empty cell for a missing value. Every number is written
with the digits that bring back the same double. A recording without time has its samples counted instead, in a
column `sample`, and reopens without time.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from kalscope.common.array import Array
from kalscope.common.text import one_line, unused_name
from kalscope.filtering.filter import fuse
from kalscope.filtering.params import FilterParams
from kalscope.filtering.protocol import Filter, StandardFilter
from kalscope.recording import Recording
from kalscope.sources.grammar.cells import MISSING, is_number
from kalscope.sources.layout.columns import ROW_NUMBER_NAME
from kalscope.sources.times.seconds import unit_by_magnitude
from kalscope.tuning.fusion import FusionTuning
from kalscope.tuning.tuning import Tuning

Filters = Mapping[str, Filter | FilterParams]
"""Filters, or parameters of the Kalman filter, by the names of their channels."""

ROWS_PER_CHUNK = 20_000
"""Rows turned into text at a time, so that a long recording is never held as text as a whole."""

_FORMULA = ("=", "+", "-", "@")
"""A spreadsheet runs a cell that begins with one of these as a formula."""


def filtered_csv(recording: Recording, params: Tuning | Filters) -> str:
    """The whole CSV as one text; arguments and errors as `filtered_csv_chunks`."""
    return "".join(filtered_csv_chunks(recording, params))


def filtered_csv_chunks(recording: Recording, params: Tuning | Filters) -> Iterator[str]:
    """Filter a recording and give the CSV in pieces.

    One sample is one step, dt = 1; where the recording's `gaps` is "dt" the true time between samples counts.

    Args:
        recording: n samples of its channels.
        params: The filter of each channel, or its scalar parameters, by its name. Channels without are left out.

    Returns:
        Texts to be written one after the other: the header `time,<ch>,<ch>_filtered,<ch>_variance,…` (time in
        s, variance in unit²; `<ch>_velocity_per_s` or `_per_sample` after the variance of a channel with momentum;
        channels in the order of the recording; `sample` instead of `time` where the recording has no time), then
        the n rows. Cells of a variance that the filter does not know are
        empty. The filter has run when this returns, so an error comes before any text.

    Raises:
        BadSetting: A name in `params` is not a channel of the recording; "dt" was asked for without time.
    """
    chosen = params if isinstance(params, Mapping) else {c.name: c.filter for c in params.channels}
    order = sorted(chosen, key=recording.index)
    dt = recording.steps() if recording.gaps == "dt" else None
    columns: list[Array] = []
    velocities: dict[str, str] = {}
    for name in order:
        z = recording.channel(name)
        one = chosen[name]
        result = (StandardFilter(one) if isinstance(one, FilterParams) else one).run(z, dt)
        columns += [z, result.x, result.p]
        if result.velocity is not None:
            columns.append(result.velocity / (recording.sample_period or 1.0))
            velocities[name] = _velocity_name(recording)
    return _table(recording, lambda time_name: csv_header(order, velocities, time_name=time_name), columns)


def fused_csv_chunks(recording: Recording, fusion: FusionTuning) -> Iterator[str]:
    """Fuse the sensors of a recording and give the CSV in pieces.

    Args:
        recording: n rows; its `gaps` decide what a gap in time is, as in `filtered_csv_chunks`.
        fusion: the filter and the channels that it fuses, at the sample period of the recording.

    Returns:
        Texts to be written one after the other: the header `time,<sensor>,…,<name>,<name>_variance`, then the n
        rows. The filter has run when this returns, so an error comes before any text.

    Raises:
        BadSetting: a sensor is not a channel of the recording; "dt" was asked for without time.
    """
    columns = [recording.index(name) for name in fusion.sensors]
    z = recording.values[:, columns]
    result = fuse(z, fusion.params, recording.steps() if recording.gaps == "dt" else None)
    fused, more = [result.x, result.p], ["variance"]
    if result.velocity is not None:
        fused.append(result.velocity / (recording.sample_period or 1.0))
        more.append(_velocity_name(recording))

    def header(time_name: str) -> str:
        taken = {time_name}
        raw = [unused_name(_harmless(name), taken, "_") for name in fusion.sensors]
        name = unused_name(_harmless(fusion.name), taken, "_")
        return _line([time_name, *raw, name, *(unused_name(f"{name}_{what}", taken, "_") for what in more)])

    return _table(recording, header, [*z.T, *fused])


def _velocity_name(recording: Recording) -> str:
    """What a column of velocities is called after the name of its channel."""
    return "velocity_per_s" if recording.sample_period else "velocity_per_sample"


def _table(recording: Recording, header: Callable[[str], str], columns: list[Array]) -> Iterator[str]:
    """A table of the samples of a recording in pieces: its header line, then its rows.

    Args:
        recording: its time is the first column; its samples are counted there where it has no time.
        header: the header line, from the name of the first column.
        columns: the others, shape (n,) each.
    """
    if recording.sample_period is None:
        return _texts(header(ROW_NUMBER_NAME), columns, counted=True)
    return _texts(header(_time_name(recording.time)), [recording.time, *columns])


def csv_header(names: list[str], velocities: Mapping[str, str] | None = None, *, time_name: str = "time") -> str:
    """The header line: distinct names that no spreadsheet runs and no reader takes for numbers.

    Args:
        names: of the channels.
        velocities: what the column of the velocity is called, by the name of its channel.
        time_name: name of the first column.
    """
    raw = [_harmless(name) for name in names]
    taken = {time_name, *raw}  # where names are equal, the recording's own name stays
    cells = [time_name]
    for i, name in enumerate(raw):
        first = name not in raw[:i] and name != time_name
        cells.append(name if first else unused_name(name, taken, "_"))
        more = [] if velocities is None or names[i] not in velocities else [velocities[names[i]]]
        cells.extend(unused_name(f"{name}_{what}", taken, "_") for what in ("filtered", "variance", *more))
    return _line(cells)


def _line(cells: Sequence[str]) -> str:
    """One line of a CSV, quoted where that is needed."""
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(cells)
    return line.getvalue()


def _texts(header: str, columns: list[Array], *, counted: bool = False) -> Iterator[str]:
    yield header
    n = len(columns[0]) if columns else 0
    for start in range(0, n, ROWS_PER_CHUNK):
        cells = [_cells(column[start : start + ROWS_PER_CHUNK]) for column in columns]
        if counted:
            cells.insert(0, [str(i) for i in range(start, min(start + ROWS_PER_CHUNK, n))])
        yield "\n".join(map(",".join, zip(*cells, strict=True))) + "\n"


def _cells(values: Array) -> list[str]:
    """Each value with the fewest digits that bring it back; empty for NaN and for an infinite variance."""
    texts = [repr(value) for value in values.tolist()]
    for i in np.flatnonzero(~np.isfinite(values)):
        texts[i] = ""
    return texts


def _time_name(time: Array) -> str:
    """`time`; where a reader would take whole stamps such as 0, 5, 10 for milliseconds the name states the unit."""
    return "time" if not len(time) or unit_by_magnitude(time) == "s" else "time_s"


def _harmless(name: str) -> str:
    """A channel's name without line ends, formulas and numbers."""
    name = one_line(name)
    if name.startswith(_FORMULA):
        return f"'{name}"
    if is_number(name, ".") or name.lower() in MISSING:
        return f"channel {name}".rstrip()
    return name
