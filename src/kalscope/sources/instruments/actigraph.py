"""Activity monitors whose counts have no time column: ActiGraph, and the .AWD files of the Actiwatch.

Source: ActiLife user manual, "CSV export"; the readers pyActigraphy (reader_agd, reader_awd) and GGIR. The date is
written as "date format M/d/yyyy" in line 1 says; an epoch of 00:00:00 means raw samples at the rate of line 1.
An .AWD holds seven lines (name, date, time, epoch in quarters of a minute, age, serial number, sex), then one count
per line, with an M after it where the marker was pressed.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from itertools import pairwise

from kalscope.sources.instruments.metadata import (
    MAX_LINES,
    cells_of,
    in_words,
    inverse,
    is_sample,
    positive,
)
from kalscope.sources.instruments.preface import Preface, TablePreface

_NAME = "ActiGraph"
_AWD_LINES = 7
_MAX_QUARTERS = 60
_STAMPED = ("timestamp", "date", "time", "epoch")


def recognise(head: Sequence[str]) -> Preface | None:
    """The preface of an ActiGraph's or Actiwatch's file; None for any other file."""
    if len(head) > _AWD_LINES and head[3].strip().isdecimal():
        return _actiwatch(head)
    if not head or "data file created by actigraph" not in head[0][:200].lower():
        return None
    ends = (i for i, line in enumerate(head[1:MAX_LINES], 1) if line.strip(' ",;').startswith("-----"))
    end = next(ends, None)
    if end is None or end + 1 >= len(head):
        return None
    row = cells_of(head[end + 1])
    named = not is_sample(row)
    stamped = named and bool(row) and row[0].lower().startswith(_STAMPED)
    above = [line.strip(' ",;') for line in head[1:end]]
    period = _epoch(_after(above, "epoch period (hh:mm:ss)")) or inverse(_rate(head[0]))
    if period is None:
        return None
    start = None if stamped else _start(head[0], _after(above, "start date"), _after(above, "start time"))
    return TablePreface(
        _NAME,
        header_row=end + 2 if named else 0,
        first_row=end + 2 + named,
        time_column=None if stamped else -1,
        period=period,
        start=start,
        notes=(f"{_NAME}: sample interval {in_words(period)} from the lines above the table",),
    )


def _actiwatch(head: Sequence[str]) -> Preface | None:
    code = int(head[3]) if len(head[3].strip()) < 3 else 0
    counts = head[_AWD_LINES : _AWD_LINES + 4]
    try:
        start = datetime.strptime(f"{head[1].strip()} {head[2].strip()}", "%d-%b-%Y %H:%M").replace(tzinfo=UTC)
    except ValueError:
        return None
    if not 0 < code <= _MAX_QUARTERS or not all(line.strip().partition(" ")[0].isdecimal() for line in counts):
        return None
    period = 15.0 * code
    return Preface(
        "Actiwatch",
        delimiter=" ",
        decimal=".",
        header_row=0,
        unit_row=0,
        first_row=_AWD_LINES + 1,
        names=("activity",),
        units=("",),
        time_column=-1,
        period=period,
        start=start.timestamp(),
        notes=(f"Actiwatch: sample interval {in_words(period)} from its fourth line",),
    )


def _after(lines: Sequence[str], key: str) -> str:
    return next((line[len(key) :].strip(" :") for line in lines if line.lower().startswith(key)), "")


def _epoch(text: str) -> float | None:
    parts = text.split(":")
    if len(parts) != 3 or not all(part.isdecimal() and len(part) < 4 for part in parts):
        return None
    return float(int(parts[0]) * 3600 + int(parts[1]) * 60 + int(parts[2])) or None


def _rate(line: str) -> float | None:
    """30 of "… date format M/d/yyyy at 30 Hz  Filter Normal"."""
    words = line.replace("Hz", " Hz ").split()
    found = (positive(word.removeprefix("at")) for word, unit in pairwise(words) if unit == "Hz")
    return next(found, None)


def _start(line: str, date: str, clock: str) -> float | None:
    form = line.partition("date format")[2].split()[:1]
    day_first = bool(form) and form[0].lower().startswith("d")
    marks = date.replace("-", "/").replace(".", "/")
    order = "%Y/%m/%d" if marks[:4].isdecimal() else "%d/%m/%Y" if day_first else "%m/%d/%Y"
    try:
        return datetime.strptime(f"{marks} {clock}", f"{order} %H:%M:%S").replace(tzinfo=UTC).timestamp()
    except ValueError:
        return None
