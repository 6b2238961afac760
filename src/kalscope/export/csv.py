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
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kalscope.common.numbers import Array
from kalscope.common.text import one_line, unused_name
from kalscope.recording import Recording
from kalscope.sources.grammar.cells import MISSING, is_number
from kalscope.sources.reading.axis import unit_by_magnitude
from kalscope.sources.reading.columns import ROW_NUMBER_NAME
from kalscope.tuning.tuning import ChannelTuning

ROWS_PER_CHUNK = 20_000
"""Rows turned into text at a time, so that a long recording is never held as text as a whole."""

_FORMULA = ("=", "+", "-", "@")
"""A spreadsheet runs a cell that begins with one of these as a formula."""


def filtered_csv_chunks(recording: Recording, filters: Iterable[ChannelTuning]) -> Iterator[str]:
    """Filter a recording and give the CSV in pieces.

    One sample is one step, dt = 1; where the recording's `gaps` is "dt" the true time between samples counts.

    Args:
        recording: n samples of its channels.
        filters: The filters of channels, at the sample period of the recording; channels without are left out. Or
            one alone that fuses several.

    Returns:
        Texts to be written one after the other: the header `time,<ch>,<ch>_filtered,<ch>_variance,…` (time in
        s, variance in unit²; `<ch>_velocity_per_s` or `_per_sample` after the variance of a channel with momentum,
        and `<ch>_moving`, a probability, of one with two speeds; channels in the order of the recording; `sample`
        instead of `time` where the recording has no time), or of a fusion `time,<sensor>,…,<name>,<name>_variance`,
        then the n rows. Cells of a variance that the filter does
        not know are empty. The filter has run when this returns, so an error comes before any text.

    Raises:
        BadSetting: A name in `filters` is not a channel of the recording; "dt" was asked for without time.
    """
    chosen = sorted(filters, key=lambda one: recording.index((*one.sensors, one.name)[0]))
    dt = recording.steps() if recording.gaps == "dt" else None
    columns: list[Array] = []
    velocities: dict[str, str] = {}
    for one in chosen:
        z = one.readings(recording)
        result = one.filter.run(z, dt)
        columns += [*np.atleast_2d(z.T), result.x, result.p]
        if result.velocity is not None:
            columns.append(result.velocity / (recording.sample_period or 1.0))
            velocities[one.name] = "velocity_per_s" if recording.sample_period else "velocity_per_sample"
        if result.moving is not None:
            columns.append(result.moving)
            velocities[one.name] = "moving"
    names = [name for one in chosen for name in one.sensors or (one.name,)]
    fused = next((one.name for one in chosen if one.sensors), None)
    time, time_name = recording.time, _time_name(recording.time)
    if recording.sample_period is None:
        time, time_name = np.arange(len(recording)), ROW_NUMBER_NAME
    return _texts(csv_header(names, velocities, fused, time_name=time_name), [time, *columns])


def csv_header(
    names: list[str],
    velocities: Mapping[str, str] | None = None,
    fused: str | None = None,
    *,
    time_name: str = "time",
) -> str:
    """The header line: distinct names that no spreadsheet runs and no reader takes for numbers.

    Args:
        names: of the channels, or the sensors.
        velocities: what the column of the velocity is called, by the name of its channel.
        fused: of the fused value; None = each channel is filtered.
        time_name: name of the first column.
    """
    raw = [_harmless(name) for name in names]
    taken = {time_name, *raw}  # where names are equal, the recording's own name stays
    cells = [time_name]

    def add(base: str, name: str, *what: str) -> None:
        more = [] if velocities is None or name not in velocities else [velocities[name]]
        cells.extend(unused_name(f"{base}_{one}", taken, "_") for one in (*what, "variance", *more))

    for i, name in enumerate(raw):
        first = name not in raw[:i] and name != time_name
        cells.append(name if first else unused_name(name, taken, "_"))
        if fused is None:
            add(name, names[i], "filtered")
    if fused is not None:
        cells.append(unused_name(_harmless(fused), taken, "_"))
        add(cells[-1], fused)
    line = io.StringIO()
    csv.writer(line, lineterminator="\n").writerow(cells)
    return line.getvalue()


def _texts(header: str, columns: list[NDArray[Any]]) -> Iterator[str]:
    yield header
    for start in range(0, len(columns[0]), ROWS_PER_CHUNK):
        cells = [_cells(column[start : start + ROWS_PER_CHUNK]) for column in columns]
        yield "\n".join(map(",".join, zip(*cells, strict=True))) + "\n"


def _cells(values: NDArray[Any]) -> list[str]:
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
