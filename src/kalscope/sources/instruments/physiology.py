"""Instruments worn on the body: OpenSignals, BIOPAC, ActiGraph, Empatica, OpenBCI, Shimmer."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any, cast

from kalscope.sources.grammar.cells import SECONDS_PER_UNIT, UNIT_OF_WORD, is_number, parse_number
from kalscope.sources.instruments.preface import (
    KEPT_COMMA,
    MAX_LINES,
    Cells,
    Preface,
    TablePreface,
    cells_of,
    first_sample,
    in_words,
    inverse,
    is_sample,
    positive,
    said,
    table_rows,
)

# Activity monitors whose counts have no time column: ActiGraph, and the .AWD files of the Actiwatch.
#
# Source: ActiLife user manual, "CSV export"; the readers pyActigraphy (reader_agd, reader_awd) and GGIR. The date
# is written as "date format M/d/yyyy" in line 1 says; an epoch of 00:00:00 means raw samples at the rate of line 1.
# An .AWD holds seven lines (name, date, time, epoch in quarters of a minute, age, serial number, sex), then one
# count per line, with an M after it where the marker was pressed.


_NAME = "ActiGraph"
_AWD_LINES = 7
_MAX_QUARTERS = 60
_STAMPED = ("timestamp", "date", "time", "epoch")


def recognise_actigraph(head: Sequence[str]) -> Preface | None:
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


# Shimmer sensors: names, kinds (RAW, CAL) and units in rows of their own, tabs or commas between them.
#
# Source: ConsensysPRO user manual ("sep=,", names that end in _CAL or _RAW, units), Shimmer Capture and
# ShimmerConnect (device, name, kind, unit), and the readers devicely (hpi-dhc) and gaitmap.


_KINDS = frozenset(("raw", "cal", "uncal", "calibrated", "uncalibrated"))
_SUFFIXES = ("_cal", "_raw", "_uncal")
_MAX_ROWS = 6
_NO_UNITS = frozenset(("no_units", "no units", "unitless", "u12", "u16", "i16", "u24", "na", "n/a"))


def recognise_shimmer(head: Sequence[str]) -> Preface | None:
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
    return _shimmer_preface(above, first)


def _is_data(cells: Cells) -> bool:
    """Numbers, or a stamp as "2020/07/28 10:56:50.034" before them."""
    return is_sample(cells) or (cells[0][:4].isdecimal() and is_sample(cells[1:]))


def _shimmer_preface(above: list[tuple[int, Cells]], first: int) -> Preface | None:
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


# Physiological recorders: OpenSignals (BITalino, biosignalsplux), BIOPAC AcqKnowledge, ADInstruments LabChart.
#
# Sources: the OpenSignals text file format (a JSON object in the second line), AcqKnowledge's text export as public
# readers describe it (`0.5 msec/sample`, `2 channels`, a name and a unit for each), and LabChart's "Export as text"
# (`Interval=`, `ChannelTitle=`).


_PLAIN = frozenset(("raw", "custom", "unknown", ""))
_MAX_CHANNELS = 64
_EXCEL_EPOCH = 25569.0
"""1970-01-01 in days of Excel."""


def recognise_recorders(head: Sequence[str]) -> Preface | None:
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
