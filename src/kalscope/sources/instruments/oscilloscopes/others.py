"""LeCroy, PicoScope, GW Instek, Hantek, Owon and Rohde & Schwarz oscilloscopes.

Sources: LeCroy WaveSurfer and WavePro files (`Segments,1,SegmentSize,502`), the PicoScope 6 user's guide "Text
formats" (names, units in brackets, an empty line), the GDS-1000 file described in public readers, Hantek's
DSO2000/5000 CSV (`#timebase`), and Owon's of ElmüSoft's Oscilloscope Waveform Analyzer, whose stamps run backwards,
and the first line of RTB2000 files.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from kalscope.sources.grammar.cells import parse_number
from kalscope.sources.grammar.time_units import UNIT_OF_WORD
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


def recognise(head: Sequence[str]) -> Preface | None:
    """The preface of a file of one of these makers; None for any other file."""
    start = next((line for line in head[:3] if line.strip()), "").strip().lower()
    for begins, rule in _RULES.items():
        if start.startswith(begins):
            return rule(table_rows(head))
    return None


def _lecroy(rows: list[Cells]) -> Preface | None:
    at = index_of(rows[:40], "time")
    first = first_sample(rows, at + 1) if at is not None else None
    if at is None or first is None or len(rows[at]) < 2:
        return None
    segments = said(rows[:at], "segments")
    notes = [f"LeCroy oscilloscope: {counted(len(rows[at]) - 1)}"]
    if segments.isdecimal() and segments not in ("0", "1"):
        notes.append(f"{segments} segments follow one another, each with stamps from its own trigger")
    return TablePreface(
        "LeCroy oscilloscope",
        header_row=at + 1,
        first_row=first + 1,
        names=("time", *rows[at][1:]),
        units=("s", *[""] * (len(rows[at]) - 1)),
        time_column=0,
        time_unit="s",
        notes=tuple(notes),
    )


def _picoscope(rows: list[Cells]) -> Preface | None:
    at = next((i for i, cells in enumerate(rows[:6]) if cells and all(map(_bracketed, cells))), None)
    if not at:
        return None
    return trace("PicoScope", rows, at, header_at=at - 1)


def _bracketed(cell: str) -> bool:
    return cell[:1] + cell[-1:] == "()"


def _gw_instek(rows: list[Cells]) -> Preface | None:
    at = index_of(rows, "waveform data")
    first = first_sample(rows, at + 1) if at is not None else None
    period = positive(said(rows, "sampling period"))
    if at is None or first is None or period is None or len(rows[first]) > 2:
        return None
    timed = len(rows[first]) == 2
    # Without stamps ("Fast") the samples are counts of the converter.
    unit = (unit_in(said(rows[:at], "vertical units")) or "") if timed else ""
    return TablePreface(
        "GW Instek oscilloscope",
        first_row=first + 1,
        names=(*(["time"] * timed), said(rows[:at], "source")),
        units=(*(["s"] * timed), unit),
        time_column=0 if timed else -1,
        time_unit="s" if timed else None,
        period=period,
        notes=(f"GW Instek oscilloscope: sample interval {in_words(period)} from its settings",),
    )


def _hantek(rows: list[Cells]) -> Preface | None:
    first = first_sample(rows)
    if first is None or len(rows[first]) < 2:
        return None
    channels = len(rows[first]) - 1
    return TablePreface(
        "Hantek oscilloscope",
        first_row=first + 1,
        names=("time", *[""] * channels),
        units=("s", *["V"] * channels),
        time_column=0,
        time_unit="s",
        notes=(f"Hantek oscilloscope: {counted(channels)}",),
    )


def _owon(rows: list[Cells]) -> Preface | None:
    first = first_sample(rows, 1)
    if first is None or first + 1 >= len(rows):
        return None
    header = [cell.partition("(") for cell in rows[0]]
    names, units = [name.strip() for name, _, _ in header], [unit.rstrip(") ") for _, _, unit in header]
    stamps = [parse_number(row[1]) if len(row) > 1 else None for row in rows[first : first + 2]]
    if stamps[0] is None or stamps[1] is None or units[1] not in UNIT_OF_WORD:
        return None
    backwards = stamps[1] < stamps[0]
    size = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}.get(UNIT_OF_WORD[units[1]], 1.0)
    period = float(f"{(stamps[0] - stamps[1]) * size:.9g}")
    note = f", stamps run backwards: the samples are taken {in_words(period)} apart" if backwards else ""
    return TablePreface(
        "Owon oscilloscope",
        header_row=1,
        first_row=first + 1,
        names=("#", "time", *names[2:]),
        units=("", units[1], *units[2:]),
        left_out=frozenset({0, 1} if backwards else {0}),
        time_column=-1 if backwards else 1,
        time_unit=None if backwards else UNIT_OF_WORD[units[1]],
        period=period if backwards else None,
        notes=(f"Owon oscilloscope: {counted(len(names) - 2)}{note}",),
    )


def _rohde_schwarz(rows: list[Cells]) -> Preface | None:
    """`in s,C1 in V`."""
    header = [cell.rpartition("in ") for cell in rows[0]]
    first = first_sample(rows, 1)
    if first is None or len(header) < 2 or not all(word for _, word, _ in header):
        return None
    names, units = [name.strip() for name, _, _ in header], [unit.strip() for _, _, unit in header]
    return TablePreface(
        "Rohde & Schwarz oscilloscope",
        header_row=1,
        first_row=first + 1,
        names=("time", *names[1:]),
        units=tuple(units),
        time_column=0,
        time_unit=UNIT_OF_WORD.get(units[0]),
        notes=(f"Rohde & Schwarz oscilloscope: {counted(len(names) - 1)}",),
    )


_RULES: dict[str, Callable[[list[Cells]], Preface | None]] = {
    "lecroy": _lecroy,
    "time,": _picoscope,
    "memory length,": _gw_instek,
    "#timebase=": _hantek,
    "#,time(": _owon,
    "in s,": _rohde_schwarz,
}
