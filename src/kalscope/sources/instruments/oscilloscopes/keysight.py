"""Keysight and Agilent oscilloscopes: InfiniiVision (`x-axis,1,2`) and Infiniium (settings down to `Data:`).

Sources: InfiniiVision 3000T X-Series user's guide, "Save/Recall" (CSV and `points/segment` of segmented memory);
Infiniium user's guide, "Waveform file formats" (the header of a CSV or TSV file: XInc, XOrg, X Units, Y Units).
"""

from __future__ import annotations

from collections.abc import Sequence

from kalscope.sources.grammar.cells import parse_number
from kalscope.sources.instruments.metadata import (
    Cells,
    first_sample,
    in_words,
    index_of,
    positive,
    said,
    table_rows,
    unit_in,
)
from kalscope.sources.instruments.oscilloscopes.trace import counted, trace
from kalscope.sources.instruments.preface import Preface, TablePreface

_NAME = "Keysight oscilloscope"
_FIRST = ("x-axis", "points/segment", "revision", "type:", "type,")


def recognise(head: Sequence[str]) -> Preface | None:
    """The preface of a Keysight's or Agilent's file; None for any other file."""
    start = next((line for line in head[:3] if line.strip()), "").strip().lower().strip('"#')
    if not start.startswith(_FIRST):
        return None
    rows = table_rows(head)
    at = index_of(rows[:40], "x-axis")
    if at is not None and at + 1 < len(rows):
        return trace(_NAME, rows, at + 1, header_at=at, names=("time", *rows[at][1:]))
    return _infiniium(rows)


def _infiniium(lines: list[Cells]) -> Preface | None:
    """`XInc: 5.0E-11` and so on, down to `Data:`, then voltages, or times and voltages."""
    rows = [_setting(cells) for cells in lines]
    at = index_of(rows, "data")
    first = first_sample(rows, at + 1) if at is not None else None
    if at is None or first is None:
        return None
    settings, timed = rows[:at], len(rows[first]) > 1
    period = positive(said(settings, "xinc", "x inc", "xincrement"))
    unit = unit_in(said(settings, "yunits", "y units")) or ""
    time_unit = unit_in(said(settings, "xunits", "x units")) or "s"
    if period is None or time_unit != "s":
        return None
    channels = len(rows[first]) - timed
    return TablePreface(
        _NAME,
        first_row=first + 1,
        names=(*(["time"] * timed), *([""] * channels)),
        units=(*(["s"] * timed), *([unit] * channels)),
        time_column=0 if timed else -1,
        time_unit="s" if timed else None,
        period=period,
        offset=None if timed else parse_number(said(settings, "xorg", "x org")),
        notes=(f"{_NAME}: {counted(channels)}, sample interval {in_words(period)} from its settings",),
    )


def _setting(cells: Cells) -> Cells:
    """`XInc: 5.0E-11` in one cell, or `XInc:` and its value in two, as key and value."""
    if not cells:
        return cells
    key, colon, value = cells[0].partition(":")
    return (key.strip(), *([value.strip()] if value.strip() else []), *cells[1:]) if colon else cells
