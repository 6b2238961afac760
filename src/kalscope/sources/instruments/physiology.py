"""Instruments worn on the body: Empatica and OpenBCI."""

from __future__ import annotations

from collections.abc import Sequence

from kalscope.sources.grammar.cells import is_number
from kalscope.sources.instruments.preface import (
    MAX_LINES,
    Cells,
    Preface,
    TablePreface,
    cells_of,
    in_words,
    inverse,
    positive,
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


# OpenBCI boards (Cyton, Ganglion): comments with the rate, then a table that has names since version 5 of the GUI.
#
# Source: github.com/OpenBCI/OpenBCI_GUI, DataWriterODF.pde (and OpenBCI_GUI/DataLogging.pde before it): EXG in
# microvolts, acceleration in g; "Sample Index" counts to 255; stamps arrive in bursts, so the rate takes
# precedence.


_OPENBCI_NAME = "OpenBCI"
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


def recognise_openbci(head: Sequence[str]) -> Preface | None:
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
        _OPENBCI_NAME,
        header_row=header_row,
        first_row=first_row,
        names=names,
        units=tuple(_unit(name) for name in names),
        left_out=frozenset(left_out),
        time_column=-1 if stamp is None else stamp,
        time_unit=("ms" if float(cell) > _MIN_EPOCH_MS else "s") if numeric else None,
        period=period,
        notes=(f"{_OPENBCI_NAME}: {exg} EXG channels{rate}",),
    )


def _unit(name: str) -> str:
    return "µV" if name.startswith("EXG") else "g" if name.startswith("Accel") else ""
