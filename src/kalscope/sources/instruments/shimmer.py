"""Shimmer sensors: names, kinds (RAW, CAL) and units in rows of their own, tabs or commas between them.

Source: ConsensysPRO user manual ("sep=,", names that end in _CAL or _RAW, units), Shimmer Capture and
ShimmerConnect (device, name, kind, unit), and the readers devicely (hpi-dhc) and gaitmap.
"""

from __future__ import annotations

from collections.abc import Sequence

from kalscope.sources.grammar.time_units import UNIT_OF_WORD
from kalscope.sources.instruments.metadata import Cells, cells_of, is_sample
from kalscope.sources.instruments.preface import Preface, TablePreface

_KINDS = frozenset(("raw", "cal", "uncal", "calibrated", "uncalibrated"))
_SUFFIXES = ("_cal", "_raw", "_uncal")
_MAX_ROWS = 6
_NO_UNITS = frozenset(("no_units", "no units", "unitless", "u12", "u16", "i16", "u24", "na", "n/a"))


def recognise(head: Sequence[str]) -> Preface | None:
    """The preface of a Shimmer's file; None for any other file."""
    start = "\n".join(head[: _MAX_ROWS + 1]).lower()
    if not any(mark in start for mark in (*_SUFFIXES, "shimmer")):
        return None
    above: list[tuple[int, Cells]] = []
    first = None
    for i, line in enumerate(head[: _MAX_ROWS + 1]):
        cells = cells_of(line)
        if len(cells) > 1 and _is_data(cells):
            first = i
            break
        if len(cells) > 1:
            above.append((i, cells))
    if first is None or len(above) < 2:
        return None
    return _preface(above, first)


def _is_data(cells: Cells) -> bool:
    """Numbers, or a stamp as "2020/07/28 10:56:50.034" before them."""
    return is_sample(cells) or (cells[0][:4].isdecimal() and is_sample(cells[1:]))


def _preface(above: list[tuple[int, Cells]], first: int) -> Preface | None:
    kinds_at = next((k for k, (_, cells) in enumerate(above) if _are(cells, _KINDS)), None)
    if kinds_at is not None and 0 < kinds_at < len(above) - 1:
        names, kinds = above[kinds_at - 1][1], above[kinds_at][1]
        if len(set(names)) < len(names):  # each signal both RAW and CAL
            names = tuple(f"{name} {kind}" for name, kind in zip(names, kinds, strict=False))
        header = above[kinds_at - 1][0]
    elif kinds_at is None:
        header, names = above[0]
        if 2 * sum(name.lower().endswith(_SUFFIXES) for name in names) < len(names):
            return None
    else:
        return None
    unit_row, units = above[-1]
    if len(units) > len(names) or _are(units, _KINDS):
        return None
    bare = tuple("" if unit.lower() in _NO_UNITS else _spelled(unit) for unit in units)
    bare += ("",) * (len(names) - len(bare))
    stamps = [i for i, name in enumerate(names) if "timestamp" in name.lower()]
    time = next((i for i in stamps if "unix" in names[i].lower()), stamps[0] if stamps else None)
    return TablePreface(
        "Shimmer",
        header_row=header + 1,
        unit_row=unit_row + 1,
        first_row=first + 1,
        names=names,
        units=bare,
        left_out=frozenset(stamps) - {time if time is not None else -1},
        time_column=time,
        time_unit=UNIT_OF_WORD.get(bare[time].lower()) if time is not None else None,
        notes=("Shimmer: names and units from the rows above the samples",),
    )


def _are(cells: Cells, known: frozenset[str]) -> bool:
    return all(cell.lower() in known for cell in cells)


def _spelled(unit: str) -> str:
    return {"msecs": "ms", "mSecs": "ms", "m/(s^2)": "m/s^2", "m/(sec^2)": "m/s^2"}.get(unit, unit)
