"""Instruments worn on the body: Empatica."""

from __future__ import annotations

from collections.abc import Sequence

from kalscope.sources.grammar.cells import is_number
from kalscope.sources.instruments.preface import (
    Cells,
    Preface,
    TablePreface,
    cells_of,
)

# Empatica E4 wristbands: the start, then the rate, then the samples, without a header.
#
# Source: Empatica's "Data export and formatting from E4 connect": row 1 is the start in Unix seconds (UTC), row 2
# the rate in Hz, both written once per column; ACC.csv holds x, y, z in 1/64 g; IBI.csv begins with the start and
# "IBI", then holds seconds since the start and the interval between beats in seconds.


_EMPATICA_NAME = "Empatica E4"
_RATES = (1.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0)
_MIN_START, _MAX_START = 1262304000.0, 2051222400.0  # 2010 to 2035
_MIN_SAMPLES = 2


def recognise_empatica(head: Sequence[str]) -> Preface | None:
    """The preface of an E4's file; None for any other file, above all for a plain table of numbers."""
    if len(head) < 3 or not head[0][:1].isdecimal():
        return None
    first, second = cells_of(head[0]), cells_of(head[1])
    if len(first) == 2 and first[1].upper() == "IBI" and _is_start(first[0]):
        return TablePreface(
            _EMPATICA_NAME,
            first_row=2,
            names=("time", "IBI"),
            units=("s", "s"),
            time_column=0,
            time_unit="s",
            start=float(first[0]),
            notes=(
                f"{_EMPATICA_NAME}: intervals between beats, stamped in seconds since the start in its first row",
            ),
        )
    if not _same(first) or not _same(second) or len(first) != len(second) or not _is_start(first[0]):
        return None
    rate = float(second[0]) if is_number(second[0]) else 0.0
    samples = [cells_of(line) for line in head[2 : 2 + _MIN_SAMPLES]]
    if rate not in _RATES or any(len(cells) != len(first) or _is_start(cells[0]) for cells in samples):
        return None
    # The file's name says what one column holds; three are the accelerometer.
    three = len(first) == 3
    return TablePreface(
        _EMPATICA_NAME,
        first_row=3,
        names=("x", "y", "z") if three else ("value",) if len(first) == 1 else ("",) * len(first),
        units=("1/64 g",) * 3 if three else ("",) * len(first),
        time_column=-1,
        period=1 / rate,
        start=float(first[0]),
        notes=(f"{_EMPATICA_NAME}: start and rate, {rate:g} Hz, from its first two rows",),
    )


def _same(cells: Cells) -> bool:
    return bool(cells) and len(set(cells)) == 1


def _is_start(cell: str) -> bool:
    return is_number(cell) and _MIN_START <= float(cell) <= _MAX_START
