"""Rigol oscilloscopes: DS1000E/D/B, DS1000Z, DS2000 to DS6000, MSO5000, DHO800, and DS1052E with its settings.

Sources: the programming guides (DS1000E/D 2.8 "Save CSV", MSO1000Z/DS1000Z 2.17), the files of
github.com/scottprahl/RigolWFM, and the parser of ElmüSoft's Oscilloscope Waveform Analyzer, which describes the two
cells that the first lines of a DS1000Z have and its rows lack.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from kalscope.sources.grammar.cells import parse_number
from kalscope.sources.instruments.metadata import (
    Cells,
    first_sample,
    first_stamp,
    in_words,
    index_of,
    inverse,
    positive,
    said,
    table_rows,
    unit_in,
)
from kalscope.sources.instruments.oscilloscopes.trace import channel_name, counted, trace
from kalscope.sources.instruments.preface import Preface, TablePreface

_NAME = "Rigol oscilloscope"


def recognise(head: Sequence[str]) -> Preface | None:
    """The preface of a Rigol's file; None for any other file."""
    start = next((line for line in head[:3] if line.strip()), "").strip().lower()
    if start.startswith(('"number of data points', "number of data points")):
        return _settings_above(table_rows(head))
    if "tinc" in start or start.startswith("time(s),ch"):
        return _in_one_line(table_rows(head))
    if not start.startswith(("x,", "time,", ",ch", ",math", ",x(", "sequence,")):
        return None
    rows = table_rows(head)
    at = index_of(rows[:4], "sequence")
    if at is not None and at > 0:
        return _counted(rows, at)
    at = index_of(rows[:4], "second")
    if at is not None and at > 0 and _names_channels(rows[at - 1]):
        return trace(_NAME, rows, at, header_at=at - 1, names=("time", *rows[at - 1][1:]))
    return None


def _names_channels(cells: Cells) -> bool:
    names = [channel_name(name).upper() for name in cells[1:]]
    return bool(names) and all(name.startswith(("CH", "MATH", "REF", "D", "LA", "EXT")) for name in names)


def _counted(rows: list[Cells], at: int) -> Preface | None:
    """`X,CH1,Start,Increment` above `Sequence,Volt,-6e-3,1e-6`: numbered samples, the time in the second line."""
    names, says = rows[at - 1], rows[at]
    first = first_stamp(rows, at + 1)
    bases = [name.lower() for name in names]
    if first is None or "start" not in bases or "increment" not in bases:
        return None
    width = bases.index("start")
    start_at, step_at = width, bases.index("increment")
    offset = parse_number(says[start_at]) if len(says) > start_at else None
    period = positive(says[step_at]) if len(says) > step_at else None
    units = tuple(unit_in(cell) or "" for cell in says[:width])
    # Pods of eight digital lines, written 0x00, are not samples.
    pods = {i for i, name in enumerate(names[:width]) if name.upper().startswith("D") and "-" in name}
    interval = f"sample interval {in_words(period)} from its header" if period else "it gives no sample interval"
    return TablePreface(
        _NAME,
        header_row=at,
        unit_row=at + 1,
        first_row=first + 1,
        names=("sequence", *(channel_name(name) for name in names[1:width])),
        units=("", *units[1:]),
        left_out=frozenset({0, *pods}),
        time_column=-1,
        period=period,
        offset=offset if period and offset is not None else None,
        notes=(f"{_NAME}: {counted(width - 1 - len(pods))}, {interval}",),
    )


def _in_one_line(rows: list[Cells]) -> Preface | None:
    """`CH1V,CH2V,t0 =-5.0e-02, tInc = 1.0e-05,` of the whole memory, `Time(s),CH1V,CH2V` of the screen."""
    says = {key.strip().lower(): value.strip(" s") for key, mark, value in _pairs(rows[0]) if mark}
    header = [_named_unit(key) for key, mark, _ in _pairs(rows[0]) if not mark]
    first, timed = first_sample(rows, 1), header[:1] == [("Time", "s")]
    period, offset = positive(says.get("tinc", "")), parse_number(says.get("t0", ""))
    if first is None or len(header) <= timed or not _names_channels(("", *(name for name, _ in header[timed:]))):
        return None
    if not timed and period is None:
        return None
    interval = f", sample interval {in_words(period)} from its header" if period else ""
    return TablePreface(
        _NAME,
        header_row=1,
        first_row=first + 1,
        names=(*["time"] * timed, *(name for name, _ in header[timed:])),
        units=tuple(unit for _, unit in header),
        time_column=0 if timed else -1,
        time_unit="s" if timed else None,
        period=period,
        offset=None if timed else offset,
        notes=(f"{_NAME}: {counted(len(header) - timed)}{interval}",),
    )


def _pairs(cells: Cells) -> list[tuple[str, str, str]]:
    return [cell.partition("=") for cell in cells]


def _named_unit(text: str) -> tuple[str, str]:
    """(CH1, V) of `CH1V` and `CH1(V)`; (Time, s) of `Time(s)`."""
    if "(" in text:
        return _bracketed(text)
    name = text.rstrip("VAWU")
    return (name, text[len(name) :]) if name[-1:].isdecimal() else (text, "")


def _settings_above(rows: list[Cells]) -> Preface | None:
    """DS1052E: fifteen lines of settings, then `Time (s)` and a `Voltage (V)` for each channel."""
    at = next((i for i, cells in enumerate(rows) if cells and cells[0].lower().startswith("time (")), None)
    first = first_sample(rows, at + 1) if at is not None else None
    if at is None or first is None:
        return None
    header = [_bracketed(cell) for cell in rows[at]]
    # The settings name the channels one cell to the left of their columns in some firmware, above them in others:
    # "Channel Data","CH 1","CH 2" is above "Time (s)","Voltage (V)","Voltage (V)".
    channels = next((cells[1:] for cells in rows[:at] if cells and cells[0].lower() == "channel data"), ())
    given = len(channels) == len(header) - 1
    rate = positive(said(rows[:at], "sampling frequency (hz)"))
    found = trace(_NAME, [*rows[:at], tuple(unit for _, unit in header), *rows[at + 1 :]], at, period=inverse(rate))
    if found is None:
        return None
    names = ("time", *(channels if given else (name for name, _ in header[1:])))
    return replace(found, names=names, header_row=at + 1, unit_row=0)


def _bracketed(cell: str) -> tuple[str, str]:
    name, _, unit = cell.partition("(")
    return name.strip(), unit.rstrip(") ")
