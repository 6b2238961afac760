"""Campbell Scientific loggers: TOA5 (four lines above the table) and TOACI1 (two).

Source: LoggerNet instruction manual, appendix "Campbell Scientific file formats": names in line 2, units in line 3,
the kind of processing (Smp, Avg, …) in line 4; TIMESTAMP and RECORD come first, "NAN" is missing.
"""

from __future__ import annotations

from collections.abc import Sequence

from kalscope.sources.instruments.metadata import cells_of
from kalscope.sources.instruments.preface import Preface, TablePreface

_STAMPS = ("timestamp", "tmstamp", "ts")
_COUNTERS = ("record", "recnbr", "rn")
_NO_UNITS = ("unitless", "ts", "rn", "n/a", "none")


def recognise(head: Sequence[str]) -> Preface | None:
    """The preface of a Campbell logger's file; None for any other file."""
    start = head[0].lstrip('" ').lower() if head else ""
    if start.startswith("toa5") and len(head) > 4:
        return _preface("TOA5", head, 5)
    if start.startswith("toaci1") and len(head) > 2:
        return _preface("TOACI1", head, 3)
    return None


def _preface(form: str, head: Sequence[str], first: int) -> Preface:
    about, names = cells_of(head[0]), cells_of(head[1])
    units = cells_of(head[2])[: len(names)] if first > 3 else ()
    bare = tuple("" if unit.lower() in _NO_UNITS else unit for unit in units)
    bases = [name.lower() for name in names]
    station = f' of station "{about[1]}"' if len(about) > 1 else ""
    return TablePreface(
        "Campbell logger",
        header_row=2,
        unit_row=3 if units else 0,
        first_row=first,
        # A name of TOACI1 may hold its unit in brackets, which the reader of header rows knows.
        names=names if units else (),
        units=bare + ("",) * (len(names) - len(bare)) if units else (),
        left_out=frozenset(i for i, base in enumerate(bases) if base in _COUNTERS),
        time_column=next((i for i, base in enumerate(bases) if base in _STAMPS), None),
        notes=(f"Campbell {form} table{station}",),
    )
