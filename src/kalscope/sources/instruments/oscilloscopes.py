"""Oscilloscopes: Rigol and Tektronix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from kalscope.sources.grammar.cells import UNIT_OF_WORD, is_number, parse_number
from kalscope.sources.instruments.preface import (
    Cells,
    Preface,
    TablePreface,
    agrees,
    first_sample,
    first_stamp,
    in_words,
    index_of,
    inverse,
    is_sample,
    positive,
    said,
    table_rows,
    unit_in,
)

# The table that most oscilloscopes write: a row of names, a row of units, then time and channels.


def trace_units(cells: Cells) -> tuple[str, ...] | None:
    """Units of a units row that begins with a unit of time; None for any other row."""
    if len(cells) < 2 or unit_in(cells[0]) not in UNIT_OF_WORD or any(map(is_number, cells)):
        return None
    return tuple(cell if (unit := unit_in(cell)) is None else unit for cell in cells)


def channel_name(text: str) -> str:
    """`X(CH1)` of a Rigol is CH1."""
    return text[2:-1] if text.startswith("X(") and text.endswith(")") else text


def trace(
    instrument: str,
    rows: Sequence[Cells],
    units_at: int,
    *,
    header_at: int | None = None,
    names: Cells = (),
    period: float | None = None,
) -> Preface | None:
    """The preface of a table whose row of units is at an index; None if that row is not one, or no samples follow.

    Args:
        instrument: What wrote the file.
        rows: The first rows, by index from 0.
        units_at: Index of the row of units.
        header_at: Index of the row of names; None where there is none.
        names: Names of the columns; () for those of that row.
        period: Sample period in s that the metadata give; not used where the stamps contradict it.
    """
    units, first = trace_units(rows[units_at]), first_stamp(rows, units_at + 1)
    if units is None or first is None or len(rows[first]) > len(units):
        return None
    names = names or (rows[header_at] if header_at is not None else ())
    named = tuple(channel_name(name) for name in names[: len(units)])
    named += ("",) * (len(units) - len(named))
    notes = [f"{instrument}: {counted(len(units) - 1)}"]
    if period is not None and units[0] == "s":
        samples = [cells for cells in rows[first:] if is_sample(cells)]
        fits = agrees(period, samples, 0)
        notes.append(
            f"the preface gives a sample interval of {in_words(period)}"
            + ("" if fits else ", which the stamps contradict: the stamps are used")
        )
        period = period if fits else None
    return TablePreface(
        instrument,
        header_row=0 if header_at is None else header_at + 1,
        unit_row=units_at + 1,
        first_row=first + 1,
        names=named,
        units=units,
        time_column=0,
        time_unit=UNIT_OF_WORD[units[0]],
        period=period if units[0] == "s" else None,
        notes=tuple(notes),
    )


def counted(channels: int) -> str:
    """As a report writes it: "1 channel", "4 channels"."""
    return f"{channels} channel" + ("s" if channels != 1 else "")


# Rigol oscilloscopes: DS1000E/D/B, DS1000Z, DS2000 to DS6000, MSO5000, DHO800, and DS1052E with its settings.
#
# Sources: the programming guides (DS1000E/D 2.8 "Save CSV", MSO1000Z/DS1000Z 2.17), the files of
# github.com/scottprahl/RigolWFM, and the parser of ElmüSoft's Oscilloscope Waveform Analyzer, which describes the
# two cells that the first lines of a DS1000Z have and its rows lack.


_RIGOL_NAME = "Rigol oscilloscope"


def recognise_rigol(head: Sequence[str]) -> Preface | None:
    """The preface of a Rigol's file; None for any other file."""
    start = next((line for line in head[:3] if line.strip()), "").strip().lower()
    if start.startswith(('"number of data points', "number of data points")):
        return _settings_above(table_rows(head))
    if "tinc" in start or start.startswith("time(s),ch"):
        return _in_one_line(table_rows(head))
    if not start.startswith(("x,", "time,", ",ch", ",math", ",x(", "sequence,")):
        return None
    rows = table_rows(head)
    at = index_of(rows[:4], "sequence")
    if at is not None and at > 0:
        return _counted(rows, at)
    at = index_of(rows[:4], "second")
    if at is not None and at > 0 and _names_channels(rows[at - 1]):
        return trace(_RIGOL_NAME, rows, at, header_at=at - 1, names=("time", *rows[at - 1][1:]))
    return None


def _names_channels(cells: Cells) -> bool:
    names = [channel_name(name).upper() for name in cells[1:]]
    return bool(names) and all(name.startswith(("CH", "MATH", "REF", "D", "LA", "EXT")) for name in names)


def _counted(rows: list[Cells], at: int) -> Preface | None:
    """`X,CH1,Start,Increment` above `Sequence,Volt,-6e-3,1e-6`: numbered samples, the time in the second line."""
    names, says = rows[at - 1], rows[at]
    first = first_stamp(rows, at + 1)
    bases = [name.lower() for name in names]
    if first is None or "start" not in bases or "increment" not in bases:
        return None
    width = bases.index("start")
    start_at, step_at = width, bases.index("increment")
    offset = parse_number(says[start_at]) if len(says) > start_at else None
    period = positive(says[step_at]) if len(says) > step_at else None
    units = tuple(unit_in(cell) or "" for cell in says[:width])
    # Pods of eight digital lines, written 0x00, are not samples.
    pods = {i for i, name in enumerate(names[:width]) if name.upper().startswith("D") and "-" in name}
    interval = f"sample interval {in_words(period)} from its header" if period else "it gives no sample interval"
    return TablePreface(
        _RIGOL_NAME,
        header_row=at,
        unit_row=at + 1,
        first_row=first + 1,
        names=("sequence", *(channel_name(name) for name in names[1:width])),
        units=("", *units[1:]),
        left_out=frozenset({0, *pods}),
        time_column=-1,
        period=period,
        offset=offset if period and offset is not None else None,
        notes=(f"{_RIGOL_NAME}: {counted(width - 1 - len(pods))}, {interval}",),
    )


def _in_one_line(rows: list[Cells]) -> Preface | None:
    """`CH1V,CH2V,t0 =-5.0e-02, tInc = 1.0e-05,` of the whole memory, `Time(s),CH1V,CH2V` of the screen."""
    says = {key.strip().lower(): value.strip(" s") for key, mark, value in _pairs(rows[0]) if mark}
    header = [_named_unit(key) for key, mark, _ in _pairs(rows[0]) if not mark]
    first, timed = first_sample(rows, 1), header[:1] == [("Time", "s")]
    period, offset = positive(says.get("tinc", "")), parse_number(says.get("t0", ""))
    if first is None or len(header) <= timed or not _names_channels(("", *(name for name, _ in header[timed:]))):
        return None
    if not timed and period is None:
        return None
    interval = f", sample interval {in_words(period)} from its header" if period else ""
    return TablePreface(
        _RIGOL_NAME,
        header_row=1,
        first_row=first + 1,
        names=(*["time"] * timed, *(name for name, _ in header[timed:])),
        units=tuple(unit for _, unit in header),
        time_column=0 if timed else -1,
        time_unit="s" if timed else None,
        period=period,
        offset=None if timed else offset,
        notes=(f"{_RIGOL_NAME}: {counted(len(header) - timed)}{interval}",),
    )


def _pairs(cells: Cells) -> list[tuple[str, str, str]]:
    return [cell.partition("=") for cell in cells]


def _named_unit(text: str) -> tuple[str, str]:
    """(CH1, V) of `CH1V` and `CH1(V)`; (Time, s) of `Time(s)`."""
    if "(" in text:
        return _rigol_bracketed(text)
    name = text.rstrip("VAWU")
    return (name, text[len(name) :]) if name[-1:].isdecimal() else (text, "")


def _settings_above(rows: list[Cells]) -> Preface | None:
    """DS1052E: fifteen lines of settings, then `Time (s)` and a `Voltage (V)` for each channel."""
    at = next((i for i, cells in enumerate(rows) if cells and cells[0].lower().startswith("time (")), None)
    first = first_sample(rows, at + 1) if at is not None else None
    if at is None or first is None:
        return None
    header = [_rigol_bracketed(cell) for cell in rows[at]]
    # The settings name the channels one cell to the left of their columns in some firmware, above them in others:
    # "Channel Data","CH 1","CH 2" is above "Time (s)","Voltage (V)","Voltage (V)".
    channels = next((cells[1:] for cells in rows[:at] if cells and cells[0].lower() == "channel data"), ())
    given = len(channels) == len(header) - 1
    rate = positive(said(rows[:at], "sampling frequency (hz)"))
    found = trace(
        _RIGOL_NAME, [*rows[:at], tuple(unit for _, unit in header), *rows[at + 1 :]], at, period=inverse(rate)
    )
    if found is None:
        return None
    names = ("time", *(channels if given else (name for name, _ in header[1:])))
    return replace(found, names=names, header_row=at + 1, unit_row=0)


def _rigol_bracketed(cell: str) -> tuple[str, str]:
    name, _, unit = cell.partition("(")
    return name.strip(), unit.rstrip(") ")


# Tektronix oscilloscopes: settings beside the samples (TDS, TBS, older DPO) or above them (DPO, MDO, MSO).
#
# Sources: the user manuals (TDS1000/2000 077-0444, MDO3000 077-0510 "Saving waveform files"), the files of
# github.com/Tom2718/Phy-Lab-2, and the first lines of MSO4034B, MDO3014 and TekScope files in public repositories.


_TEKTRONIX_NAME = "Tektronix oscilloscope"
_MIN_BESIDE = 2
"""Fewest columns of settings beside the samples: key and value, and perhaps a unit."""
_MAX_BESIDE = 6
_SETTINGS = ("model", "waveform type", "point format", "horizontal units", "sample interval", "record length")


def recognise_tektronix(head: Sequence[str]) -> Preface | None:
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
        _TEKTRONIX_NAME,
        first_row=1,
        names=(*("" for _ in range(left)), "time", *names),
        units=(*("" for _ in range(left)), time_unit, *(unit or "" for _ in range(channels))),
        left_out=frozenset(range(left)),
        time_column=left,
        time_unit=UNIT_OF_WORD.get(time_unit, "s"),
        period=period,
        notes=(f"{_TEKTRONIX_NAME}: columns 1 to {left} hold its settings, {counted(channels)}{note}",),
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
        _TEKTRONIX_NAME,
        header_row=at + 1,
        first_row=first + 1,
        names=("time", *names[1:]),
        units=(time_unit, *units[1:]),
        left_out=frozenset(keys),
        time_column=0,
        time_unit=UNIT_OF_WORD.get(time_unit, "s"),
        period=period,
        notes=(f"{_TEKTRONIX_NAME}: {counted(width - 1 - len(keys))}{note}",),
    )


def _judged(period: float | None, samples: Sequence[Cells], column: int) -> tuple[float | None, str]:
    """The period of the settings where the stamps agree with it, and the end of the sentence about it."""
    if period is None:
        return None, ""
    if not agrees(period, samples, column):
        return None, f", its sample interval {in_words(period)} contradicts the stamps, which are used"
    return period, f", sample interval {in_words(period)} from its settings"
