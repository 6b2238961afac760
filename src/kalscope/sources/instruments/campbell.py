"""Campbell Scientific loggers: TOA5 (four lines above the table) and TOACI1 (two).

Source: LoggerNet instruction manual, appendix "Campbell Scientific file formats": names in line 2, units in line 3,
the kind of processing (Smp, Avg, …) in line 4; TIMESTAMP and RECORD come first, "NAN" is missing.
"""

from __future__ import annotations

from collections.abc import Sequence

from kalscope.sources.instruments.metadata import cells_of
from kalscope.sources.instruments.preface import Preface

_STAMPS = ("timestamp", "tmstamp", "ts")
_COUNTERS = ("record", "recnbr", "rn")
_NO_UNITS = ("unitless", "ts", "rn", "n/a", "none")


def recognise(head: Sequence[str]) -> Preface | None:
    """The preface of a Campbell logger's file; None for any other file."""
    start = head[0].lstrip('" ').lower() if head else ""
    delimiter = next((mark for mark in (",", ";", "\t") if mark in head[0]), ",") if head else ","
    if start.startswith("toa5") and len(head) > 4:
        return _toa5(head, delimiter)
    if start.startswith("toaci1") and len(head) > 2:
        names = cells_of(head[1], delimiter)
        return _preface("TOACI1", cells_of(head[0], delimiter), names, (), 3, delimiter)
    return None


def _toa5(head: Sequence[str], delimiter: str) -> Preface:
    names, units = cells_of(head[1], delimiter), cells_of(head[2], delimiter)
    bare = ["" if unit.lower() in _NO_UNITS else unit for unit in units[: len(names)]]
    bare += [""] * (len(names) - len(bare))
    return _preface("TOA5", cells_of(head[0], delimiter), names, tuple(bare), 5, delimiter)


def _preface(
    form: str, about: Sequence[str], names: tuple[str, ...], units: tuple[str, ...], first: int, delimiter: str
) -> Preface:
    bases = [name.lower() for name in names]
    station = f' of station "{about[1]}"' if len(about) > 1 else ""
    return Preface(
        "Campbell logger",
        delimiter=delimiter,
        # Only a spreadsheet writes another delimiter, and with it the decimal mark of its country.
        decimal="." if delimiter == "," else None,
        header_row=2,
        unit_row=3 if units else 0,
        first_row=first,
        # A name of TOACI1 may hold its unit in brackets, which the reader of header rows knows.
        names=names if units else (),
        units=units,
        left_out=frozenset(i for i, base in enumerate(bases) if base in _COUNTERS),
        time_column=next((i for i, base in enumerate(bases) if base in _STAMPS), None),
        notes=(f"Campbell {form} table{station}",),
    )
