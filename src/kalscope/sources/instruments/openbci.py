"""OpenBCI boards (Cyton, Ganglion): comments with the rate, then a table that has names since version 5 of the GUI.

Source: github.com/OpenBCI/OpenBCI_GUI, DataWriterODF.pde (and OpenBCI_GUI/DataLogging.pde before it): EXG in
microvolts, acceleration in g; "Sample Index" counts to 255; stamps arrive in bursts, so the rate takes precedence.
"""

from __future__ import annotations

from collections.abc import Sequence

from kalscope.sources.grammar.cells import is_number
from kalscope.sources.instruments.metadata import (
    MAX_LINES,
    Cells,
    cells_of,
    in_words,
    inverse,
    positive,
)
from kalscope.sources.instruments.preface import Preface, TablePreface

_NAME = "OpenBCI"
_MIN_EPOCH_MS = 1e11
_AUX = ("Accel Channel 0", "Accel Channel 1", "Accel Channel 2")
_LEFT_OUT = (
    "sample index",
    "not used",
    "marker",
    "marker channel",
    "other",
    "package num",
    "timestamp (formatted)",
)


def recognise(head: Sequence[str]) -> Preface | None:
    """The preface of OpenBCI's file; None for any other file."""
    if not head or not head[0].lower().startswith(("%openbci", "%obci")):
        return None
    at = next((i for i, line in enumerate(head[:MAX_LINES]) if line.strip() and not line.startswith("%")), None)
    if at is None:
        return None
    above = [line[1:].partition("=") for line in head[:at]]
    said = {key.strip().lower(): value.strip() for key, _, value in above}
    period = inverse(positive(said.get("sample rate", "").lower().removesuffix("hz")))
    if cells_of(head[at])[0].lower() == "sample index":
        return _named(head, at, period)
    return _unnamed(head, at, period, said.get("number of channels", ""))


def _named(head: Sequence[str], at: int, period: float | None) -> Preface:
    names = cells_of(head[at])
    bases = [name.lower() for name in names]
    first = cells_of(head[at + 1]) if at + 1 < len(head) else ()
    stamp = bases.index("timestamp") if "timestamp" in bases else None
    left_out = {i for i, base in enumerate(bases) if base.startswith(_LEFT_OUT) and i != stamp}
    if stamp is None and "timestamp (formatted)" in bases:
        stamp = bases.index("timestamp (formatted)")
        left_out.discard(stamp)
    return _preface(names, stamp, first, period, at + 1, at + 2, left_out)


def _unnamed(head: Sequence[str], at: int, period: float | None, said: str) -> Preface:
    """Sample index, channels, acceleration or auxiliary values, a clock, and perhaps milliseconds since 1970."""
    cells = cells_of(head[at])
    clocks = [i for i, cell in enumerate(cells) if i and (":" in cell or _is_epoch(cell))]
    values = (clocks[0] if clocks else len(cells)) - 1
    exg = min(int(said), values) if said.isdecimal() and len(said) < 4 else max(values - len(_AUX), 0)
    aux = _AUX if values - exg == len(_AUX) else tuple(f"Aux {i}" for i in range(values - exg))
    names = ("Sample Index", *(f"EXG Channel {i}" for i in range(exg)), *aux)
    names += ("Timestamp",) * (len(cells) - len(names))
    numeric = next((i for i in clocks if _is_epoch(cells[i])), None)
    stamp = numeric if numeric is not None else clocks[0] if clocks else None
    left_out = {i for i in (0, *range(values + 1, len(cells))) if i != stamp}
    return _preface(names, stamp, cells, period, 0, at + 1, left_out)


def _is_epoch(cell: str) -> bool:
    return is_number(cell) and float(cell) > _MIN_EPOCH_MS / 1e3


def _preface(
    names: Cells,
    stamp: int | None,
    sample: Cells,
    period: float | None,
    header_row: int,
    first_row: int,
    left_out: set[int],
) -> Preface:
    cell = sample[stamp] if stamp is not None and stamp < len(sample) else ""
    numeric = is_number(cell)
    exg = sum(name.startswith("EXG") for name in names)
    rate = f", sample interval {in_words(period)} from the rate above the table" if period else ""
    return TablePreface(
        _NAME,
        header_row=header_row,
        first_row=first_row,
        names=names,
        units=tuple(_unit(name) for name in names),
        left_out=frozenset(left_out),
        time_column=-1 if stamp is None else stamp,
        time_unit=("ms" if float(cell) > _MIN_EPOCH_MS else "s") if numeric else None,
        period=period,
        notes=(f"{_NAME}: {exg} EXG channels{rate}",),
    )


def _unit(name: str) -> str:
    return "µV" if name.startswith("EXG") else "g" if name.startswith("Accel") else ""
