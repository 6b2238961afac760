"""Physiological recorders: OpenSignals (BITalino, biosignalsplux), BIOPAC AcqKnowledge, ADInstruments LabChart.

Sources: the OpenSignals text file format (a JSON object in the second line), AcqKnowledge's text export as public
readers describe it (`0.5 msec/sample`, `2 channels`, a name and a unit for each), and LabChart's "Export as text"
(`Interval=`, `ChannelTitle=`).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any, cast

from kalscope.sources.grammar.cells import parse_number
from kalscope.sources.grammar.time_units import SECONDS_PER_UNIT, UNIT_OF_WORD
from kalscope.sources.instruments.metadata import (
    KEPT_COMMA,
    Cells,
    cells_of,
    first_sample,
    in_words,
    inverse,
    positive,
    said,
    table_rows,
)
from kalscope.sources.instruments.preface import Preface, TablePreface

_PLAIN = frozenset(("raw", "custom", "unknown", ""))
_MAX_CHANNELS = 64
_EXCEL_EPOCH = 25569.0
"""1970-01-01 in days of Excel."""


def recognise(head: Sequence[str]) -> Preface | None:
    """The preface of a file of one of these; None for any other file."""
    start = [line.strip().lower() for line in head[:6]]
    if start and start[0].startswith("# opensignals"):
        return _opensignals(head)
    if any(line.startswith("interval=") for line in start[:2]):
        return _labchart(table_rows(head))
    at = next((i for i, line in enumerate(start[:3]) if line.partition(",")[0].endswith("/sample")), None)
    return None if at is None else _biopac(table_rows(head), at)


def _opensignals(head: Sequence[str]) -> Preface | None:
    about = next((line for line in head[:4] if line.lstrip("# ").startswith("{")), "")
    at = next((i for i, line in enumerate(head) if line and not line.startswith("#")), None)
    try:
        said = json.loads(about.lstrip("# ").replace(KEPT_COMMA, ","))
    except (ValueError, RecursionError):
        return None
    if at is None or not isinstance(said, dict):
        return None
    held = cast("dict[str, object]", said).values()
    devices = [cast("dict[str, Any]", device) for device in held if isinstance(device, dict)]
    names = tuple(name for device in devices for name in _columns(device))
    if not names or len(cells_of(head[at])) != len(names):
        return None
    period = inverse(positive(str(devices[0].get("sampling rate", ""))))
    interval = f", sample interval {in_words(period)} from its header" if period else ""
    return TablePreface(
        "OpenSignals",
        first_row=at + 1,
        names=names,
        units=("",) * len(names),
        left_out=frozenset(i for i, name in enumerate(names) if name.lower() == "nseq"),
        time_column=-1,
        period=period,
        start=_moment(f"{devices[0].get('date', '')} {devices[0].get('time', '')}"),
        notes=(f"OpenSignals: {len(names)} columns{interval}",),
    )


def _columns(device: dict[str, Any]) -> list[str]:
    """The columns of one device; the channels, which come last, with their sensors: "CH1 ECG"."""
    columns, sensors = (
        [str(one) for one in cast("list[object]", device[key])] if isinstance(device.get(key), list) else []
        for key in ("column", "sensor")
    )
    first = len(columns) - len(sensors)
    return [
        name if i < first or sensors[i - first].lower() in _PLAIN else f"{name} {sensors[i - first]}"
        for i, name in enumerate(columns)
    ]


def _moment(text: str) -> float | None:
    for form in ("%Y-%m-%d %H:%M:%S.%f", "%Y-%m-%d %H:%M:%S"):
        try:
            return datetime.strptime(text, form).replace(tzinfo=UTC).timestamp()
        except ValueError:
            continue
    return None


def _biopac(rows: list[Cells], at: int) -> Preface | None:
    period = _seconds(rows[at][0].removesuffix("/sample"))
    words = rows[at + 1][0].split() if len(rows) > at + 1 and rows[at + 1] else []
    counted = len(words) == 2 and words[0].isdecimal() and len(words[0]) < 18 and words[1].startswith("channel")
    count = int(words[0]) if counted else 0
    header = at + 2 + 2 * count
    first = first_sample(rows, header + 1)
    if period is None or not 0 < count <= _MAX_CHANNELS or first is None or len(rows) < header + 2:
        return None
    if all(cell.isdecimal() for cell in rows[first]) and first + 1 < len(rows) and first == header + 1:
        first += 1  # numbers of samples, one for each channel
    titled = [" ".join(cells) for cells in rows[at + 2 : header]]
    word = rows[header][0].lower() if rows[header] else ""
    unit = "ms" if word == "millisec" else UNIT_OF_WORD.get(word)
    timed = len(rows[header]) == count + 1 and unit is not None
    return TablePreface(
        "BIOPAC AcqKnowledge",
        header_row=header + 1,
        first_row=first + 1,
        names=(*["time"] * timed, *titled[::2]),
        units=(*[unit or ""] * timed, *titled[1::2]),
        time_column=0 if timed else -1,
        time_unit=unit if timed else None,
        period=period,
        notes=(f"BIOPAC AcqKnowledge: {count} channels, sample interval {in_words(period)} from its header",),
    )


def _labchart(rows: list[Cells]) -> Preface | None:
    titles = next((cells[1:] for cells in rows[:20] if cells and cells[0].lower() == "channeltitle="), ())
    units = next((cells[1:] for cells in rows[:20] if cells and cells[0].lower() == "unitname="), ())
    period, first = _seconds(said(rows[:20], "interval")), first_sample(rows)
    if period is None or first is None or not titles or len(rows[first]) > len(titles) + 1:
        return None
    timed = len(rows[first]) > len(titles)
    days = parse_number(said(rows[:20], "exceldatetime").split(" ")[0])
    bare = [*(units if len(units) == len(titles) else [""] * len(titles))]
    return TablePreface(
        "LabChart",
        first_row=first + 1,
        names=(*["time"] * timed, *titles),
        units=(*["s"] * timed, *bare),
        time_column=0 if timed else -1,
        time_unit="s" if timed else None,
        period=period,
        start=None if days is None or not days > _EXCEL_EPOCH else (days - _EXCEL_EPOCH) * 86400.0,
        notes=(f"LabChart: {len(titles)} channels, sample interval {in_words(period)} from the lines above",),
    )


def _seconds(text: str) -> float | None:
    """0.0005 of `0.5 msec`."""
    number, _, unit = text.strip().partition(" ")
    value, word = positive(number), UNIT_OF_WORD.get(unit.strip().lower())
    return value * SECONDS_PER_UNIT[word] if value is not None and word is not None else None
