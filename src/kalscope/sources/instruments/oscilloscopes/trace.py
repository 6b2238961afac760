"""The table that most oscilloscopes write: a row of names, a row of units, then time and channels."""

from __future__ import annotations

from collections.abc import Sequence

from kalscope.sources.grammar.cells import is_number
from kalscope.sources.grammar.time_units import UNIT_OF_WORD
from kalscope.sources.instruments.metadata import (
    Cells,
    agrees,
    first_stamp,
    in_words,
    is_sample,
    unit_in,
)
from kalscope.sources.instruments.preface import Preface, TablePreface


def trace_units(cells: Cells) -> tuple[str, ...] | None:
    """Units of a units row that begins with a unit of time; None for any other row."""
    if len(cells) < 2 or unit_in(cells[0]) not in UNIT_OF_WORD or any(map(is_number, cells)):
        return None
    return tuple(cell if (unit := unit_in(cell)) is None else unit for cell in cells)


def channel_name(text: str) -> str:
    """`X(CH1)` of a Rigol is CH1."""
    return text[2:-1] if text.startswith("X(") and text.endswith(")") else text


def trace(
    instrument: str,
    rows: Sequence[Cells],
    units_at: int,
    *,
    header_at: int | None = None,
    names: Cells = (),
    period: float | None = None,
) -> Preface | None:
    """The preface of a table whose row of units is at an index; None if that row is not one, or no samples follow.

    Args:
        instrument: What wrote the file.
        rows: The first rows, by index from 0.
        units_at: Index of the row of units.
        header_at: Index of the row of names; None where there is none.
        names: Names of the columns; () for those of that row.
        period: Sample period in s that the metadata give; not used where the stamps contradict it.
    """
    units, first = trace_units(rows[units_at]), first_stamp(rows, units_at + 1)
    if units is None or first is None or len(rows[first]) > len(units):
        return None
    names = names or (rows[header_at] if header_at is not None else ())
    named = tuple(channel_name(name) for name in names[: len(units)])
    named += ("",) * (len(units) - len(named))
    notes = [f"{instrument}: {counted(len(units) - 1)}"]
    if period is not None and units[0] == "s":
        samples = [cells for cells in rows[first:] if is_sample(cells)]
        fits = agrees(period, samples, 0)
        notes.append(
            f"the preface gives a sample interval of {in_words(period)}"
            + ("" if fits else ", which the stamps contradict: the stamps are used")
        )
        period = period if fits else None
    return TablePreface(
        instrument,
        header_row=0 if header_at is None else header_at + 1,
        unit_row=units_at + 1,
        first_row=first + 1,
        names=named,
        units=units,
        time_column=0,
        time_unit=UNIT_OF_WORD[units[0]],
        period=period if units[0] == "s" else None,
        notes=tuple(notes),
    )


def counted(channels: int) -> str:
    """As a report writes it: "1 channel", "4 channels"."""
    return f"{channels} channel" + ("s" if channels != 1 else "")
