"""Siglent oscilloscopes: settings, `Source,CH1`, then `Second,Volt` or `Second,Value`.

Sources: SDS1000X-E user manual "Save waveform (CSV)", and the first lines of SDS1104X-E, SDS6054A and ADS1202CL+
files in public repositories (the tool bin2csv writes `Sample Rate` and no `Source`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from kalscope.sources.instruments.metadata import Cells, index_of, inverse, positive, said, table_rows
from kalscope.sources.instruments.oscilloscopes.trace import trace
from kalscope.sources.instruments.preface import Preface

_NAME = "Siglent oscilloscope"


def recognise(head: Sequence[str]) -> Preface | None:
    """The preface of a Siglent's file; None for any other file."""
    start = next((line for line in head[:3] if line.strip()), "").strip().lower()
    if not start.startswith(("record length,", "source,")):
        return None
    rows = table_rows(head)
    at = index_of(rows[:40], "second", "seconds", "s")
    if at is None:
        return None
    settings = rows[:at]
    interval = positive(_last(said(settings, "sample interval")))
    period = interval or inverse(positive(_last(said(settings, "sample rate"))))
    header_at = at - 1 if at and rows[at - 1][:1] == ("Source",) else None
    found = trace(
        _NAME, rows, at, header_at=header_at, names=("time", *_channels(settings, len(rows[at]) - 1)), period=period
    )
    units = _labelled(settings, "vertical units")
    if found is None or not units:
        return found
    return _with_units(found, units)


def _last(text: str) -> str:
    """The number in `Analog:5.0E-05` and `CH1:0.05`."""
    return text.partition(" ")[0].rpartition(":")[2]


def _channels(settings: list[Cells], count: int) -> Cells:
    """Names from `Source,CH1,CH2`, else from the labels `CH1:…` of other settings."""
    for cells in settings:
        if cells and cells[0].lower() == "source" and len(cells) - 1 >= count:
            return cells[1 : count + 1]
    labels = tuple(_labelled(settings, "vertical units") or _labelled(settings, "vertical scale"))
    return labels[:count] if len(labels) >= count else ("",) * count


def _labelled(settings: list[Cells], key: str) -> dict[str, str]:
    """{"CH1": "V", "CH2": "A"} of `Vertical Units,CH1:V CH2:A` or `Vertical Units,CH1:V,CH2:A`."""
    for cells in settings:
        if cells and cells[0].lower() == key:
            pairs = (part.partition(":") for part in " ".join(cells[1:]).split(" "))
            return {label: value for label, colon, value in pairs if colon and label}
    return {}


def _with_units(found: Preface, units: dict[str, str]) -> Preface:
    """`Second,Value` gives no unit: the settings do."""
    said_units = (unit or units.get(name, "") for name, unit in zip(found.names, found.units, strict=True))
    return replace(found, units=tuple(said_units))
