"""Oscilloscopes whose table needs a rule: those of Rigol that number their samples."""

from __future__ import annotations

from collections.abc import Sequence

from kalscope.sources.grammar.cells import bare_unit, parse_number
from kalscope.sources.instruments.preface import (
    Cells,
    Preface,
    TablePreface,
    first_stamp,
    in_words,
    index_of,
    positive,
    table_rows,
)

# Source: the programming guide (MSO1000Z/DS1000Z 2.17) and the parser of ElmüSoft's Oscilloscope Waveform Analyzer,
# which describes the two cells that the first lines of a DS1000Z have and its rows lack.


_RIGOL_NAME = "Rigol oscilloscope"


def recognise_rigol(head: Sequence[str]) -> Preface | None:
    """The preface of a file of a DS1000Z or DS2000 to DS6000; None for any other file."""
    start = next((line for line in head[:3] if line.strip()), "").strip().lower()
    if not start.startswith(("x,", "sequence,")):
        return None
    rows = table_rows(head)
    at = index_of(rows[:4], "sequence")
    return _counted(rows, at) if at else None


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
    units = tuple(bare_unit(cell) for cell in says[:width])
    # Pods of eight digital lines, written 0x00, are not samples.
    pods = {i for i, name in enumerate(names[:width]) if name.upper().startswith("D") and "-" in name}
    interval = f"sample interval {in_words(period)} from its header" if period else "it gives no sample interval"
    return TablePreface(
        _RIGOL_NAME,
        header_row=at,
        unit_row=at + 1,
        first_row=first + 1,
        names=("sequence", *(name.removeprefix("X(").removesuffix(")") for name in names[1:width])),
        units=("", *units[1:]),
        left_out=frozenset({0, *pods}),
        time_column=-1,
        period=period,
        offset=offset if period and offset is not None else None,
        notes=(f"{_RIGOL_NAME}: {width - 1 - len(pods)} channels, {interval}",),
    )
