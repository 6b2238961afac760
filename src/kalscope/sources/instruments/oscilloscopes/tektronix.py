"""Tektronix oscilloscopes: settings beside the samples (TDS, TBS, older DPO) or above them (DPO, MDO, MSO).

Sources: the user manuals (TDS1000/2000 077-0444, MDO3000 077-0510 "Saving waveform files"), the files of
github.com/Tom2718/Phy-Lab-2, and the first lines of MSO4034B, MDO3014 and TekScope files in public repositories.
"""

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
    positive,
    said,
    table_rows,
    unit_in,
)
from kalscope.sources.instruments.oscilloscopes.trace import counted
from kalscope.sources.instruments.preface import Preface, TablePreface

_NAME = "Tektronix oscilloscope"
_MIN_BESIDE = 2
"""Fewest columns of settings beside the samples: key and value, and perhaps a unit."""
_MAX_BESIDE = 6
_SETTINGS = ("model", "waveform type", "point format", "horizontal units", "sample interval", "record length")


def recognise(head: Sequence[str]) -> Preface | None:
    """The preface of a Tektronix's file; None for any other file."""
    start = next((line for line in head[:3] if line.strip()), "").strip().lower().strip('"#')
    if start.startswith("record length"):
        return _beside(table_rows(head))
    if start.startswith(_SETTINGS):
        return _above([tuple(cell.lstrip("#") for cell in cells) for cells in table_rows(head)])
    return None


def _beside(rows: list[Cells]) -> Preface | None:
    """`Record Length,2500,,-0.00048,-0.86,`: columns of settings, then the time and the channels."""
    samples = [cells for cells in rows if cells]
    width = max(map(len, samples))
    if not _MIN_BESIDE + 2 <= width <= _MAX_BESIDE + 8:
        return None
    whole = [cells for cells in samples if len(cells) == width]
    left = next(
        (
            i
            for i in range(_MIN_BESIDE, _MAX_BESIDE)
            if all(_numbers(cells[i:]) for cells in whole) and i < width - 1
        ),
        None,
    )
    if left is None or len(whole) < len(samples) - 1:
        return None
    settings = [cells[:left] for cells in whole]
    source, unit = said(settings, "source"), unit_in(said(settings, "vertical units"))
    time_unit = (unit_in(said(settings, "horizontal units")) or "s").lower()
    period = positive(said(settings, "sample interval"))
    channels = width - left - 1
    names = (source,) if channels == 1 else tuple("" for _ in range(channels))
    period, note = _judged(period, whole, left)
    return TablePreface(
        _NAME,
        first_row=1,
        names=(*("" for _ in range(left)), "time", *names),
        units=(*("" for _ in range(left)), time_unit, *(unit or "" for _ in range(channels))),
        left_out=frozenset(range(left)),
        time_column=left,
        time_unit=UNIT_OF_WORD.get(time_unit, "s"),
        period=period,
        notes=(f"{_NAME}: columns 1 to {left} hold its settings, {counted(channels)}{note}",),
    )


def _numbers(cells: Cells) -> bool:
    return bool(cells) and all(is_number(cell) for cell in cells)


def _above(rows: list[Cells]) -> Preface | None:
    """Settings line by line, then `TIME,CH1,CH2`; an MSO writes those of its digital lines beside them."""
    at = next((i for i, cells in enumerate(rows) if len(cells) > 1 and cells[0].upper() == "TIME"), None)
    first = first_stamp(rows, at + 1) if at is not None else None
    if at is None or first is None or not any(cells and cells[0].lower() in _SETTINGS[1:] for cells in rows[:at]):
        return None
    names, width = rows[at], len(rows[at])
    units = [""] * width
    for cells in rows[:at]:
        if cells and cells[0].lower() == "vertical units":
            units = [(unit_in(cell) or "") for cell in cells[:width]] + [""] * (width - len(cells))
    time_unit = (unit_in(said(rows[:at], "horizontal units")) or "s").lower()
    # A second group of channels repeats the keys within the line; a gap between the groups has no name.
    keys = {i for i, name in enumerate(names) if not name or (i and name.upper() == "TIME")}
    samples = [cells for cells in rows[first:] if is_sample(cells)]
    period, note = _judged(positive(said(rows[:at], "sample interval")), samples, 0)
    return TablePreface(
        _NAME,
        header_row=at + 1,
        first_row=first + 1,
        names=("time", *names[1:]),
        units=(time_unit, *units[1:]),
        left_out=frozenset(keys),
        time_column=0,
        time_unit=UNIT_OF_WORD.get(time_unit, "s"),
        period=period,
        notes=(f"{_NAME}: {counted(width - 1 - len(keys))}{note}",),
    )


def _judged(period: float | None, samples: Sequence[Cells], column: int) -> tuple[float | None, str]:
    """The period of the settings where the stamps agree with it, and the end of the sentence about it."""
    if period is None:
        return None, ""
    if not agrees(period, samples, column):
        return None, f", its sample interval {in_words(period)} contradicts the stamps, which are used"
    return period, f", sample interval {in_words(period)} from its settings"
