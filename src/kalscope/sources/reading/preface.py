"""What a file says about its table above it: an instrument's own rules, the sample rate, the delimiter."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from kalscope.common.text import duration
from kalscope.sources.grammar.cells import (
    NUMBER,
    SECONDS_PER_UNIT,
    UNIT_OF_WORD,
    bare_unit,
    is_comment,
    is_number,
    parse_number,
    split_fields,
)

Cells = tuple[str, ...]

_MAX_LINES, _MAX_LENGTH = 120, 400
"""Lines, and characters of each, in which a rate is looked for."""
_MAX_PARTS = 12
"""A line of more cells is a header, or holds samples."""
_MIN_PERIOD, _MAX_PERIOD = 1e-13, 1e8
_TOLD = {",": ",", ";": ";", "\t": "\t", "\\t": "\t", "|": "|"}


@dataclass(frozen=True)
class Preface:
    """What the lines above a table say about it; None and () where they say nothing."""

    instrument: str = ""
    """What wrote the file, as a report names it: "Rigol oscilloscope"; "" where only its text is understood."""
    delimiter: str | None = None
    """Delimiter of the table."""
    header_row: int | None = None
    """Line number, from 1, of the row of names; 0 where there is none. `names` takes precedence over it."""
    unit_row: int | None = None
    """Line number, from 1, of the row of units; 0 where there is none. `units` takes precedence over it."""
    first_row: int | None = None
    """Line number, from 1, of the first row of the table."""
    names: Cells = ()
    """Name of each column of the table, without an empty one at its end; "" where one has none."""
    units: Cells = ()
    """Unit of each column, "" where it has none; as many as `names`."""
    left_out: frozenset[int] = frozenset()
    """Columns, from 0, that hold no samples: a counter, digital lines."""
    time_column: int | None = None
    """Column, from 0, of the time; -1 where the table has none."""
    time_unit: str | None = None
    """Unit of the time column, a key of SECONDS_PER_UNIT."""
    period: float | None = None
    """Sample period in s."""
    start: float | None = None
    """What second 0 of the stamps is, or the first sample where there are none, in s since 1970 (UTC)."""
    offset: float = 0.0
    """Stamp of the first sample in s, where the table has no time column: an oscilloscope counts from its
    trigger."""
    notes: tuple[str, ...] = ()
    """What else was understood, each a sentence for the report."""


def find_preface(head: Sequence[str]) -> Preface:
    """What the first lines of a file, without their newlines, say about its table."""
    told = told_delimiter(head[0]) if head else None
    first = next((i for i, line in enumerate(head[:_MAX_LINES]) if line.strip() and not (told and i == 0)), 0)
    rows = [_cells_of(line.removeprefix("\ufeff")) for line in head[first : first + 3]]
    found = (_rigol(rows, first) or _empatica(rows, first)) if len(rows) > 2 else None
    if found is None and told:
        return Preface(delimiter=told, notes=("line 1 names the delimiter",))
    return found or _stated_rate(head) or Preface()


def told_delimiter(line: str) -> str | None:
    """The delimiter that a first line `sep=;` tells a spreadsheet; None for any other line."""
    text = line.strip(' "\r').lower() if len(line) < 12 else ""
    return _TOLD.get(text[4:]) if text.startswith("sep=") else None


def _cells_of(line: str) -> Cells:
    """Cells of a line, without blanks, quotes, and the empty cells at its end."""
    cells = split_fields(line[: 1 << 14], ",")
    while cells and not cells[-1]:
        cells.pop()
    return tuple(cells)


def _rigol(rows: Sequence[Cells], above: int) -> Preface | None:
    """`X,CH1,Start,Increment` above `Sequence,Volt,-6e-3,1e-6`: numbered samples, the time in the second line.

    Source: the programming guide (MSO1000Z/DS1000Z 2.17).
    """
    (names, says), bases = rows[:2], [name.lower() for name in rows[0]]
    if bases[:1] != ["x"] or "start" not in bases or "increment" not in bases or says[:1] != ("Sequence",):
        return None
    width, step_at = bases.index("start"), bases.index("increment")
    period = parse_number(says[step_at]) if len(says) > step_at else None
    period = period if period and period > 0 else None
    offset = parse_number(says[width]) if len(says) > width else None
    # Pods of eight digital lines, written 0x00, are not samples.
    pods = {i for i, name in enumerate(names[:width]) if name.upper().startswith("D") and "-" in name}
    return Preface(
        "Rigol oscilloscope",
        delimiter=",",
        header_row=above + 1,
        unit_row=above + 2,
        first_row=above + 3,
        names=("sequence", *names[1:width]),
        units=("", *map(bare_unit, says[1:width])),
        left_out=frozenset({0, *pods}),
        time_column=-1,
        period=period,
        offset=offset if period and offset is not None and math.isfinite(offset) else 0.0,
    )


def _empatica(rows: Sequence[Cells], above: int) -> Preface | None:
    """The start, then the rate, then the samples, without a header; of IBI.csv the start and "IBI", then beats.

    Source: Empatica's "Data export and formatting from E4 connect": row 1 is the start in Unix seconds (UTC), row 2
    the rate in Hz, both written once per column; ACC.csv holds x, y, z in 1/64 g.
    """
    first, second, third = rows[:3]
    if not first or not _is_start(first[0]):
        return None
    start = float(first[0])
    if len(first) == 2 and first[1].upper() == "IBI":
        names, units = ("time", "IBI"), ("s", "s")
        return Preface("Empatica E4", ",", 0, 0, above + 2, names, units, time_column=0, time_unit="s", start=start)
    rate = float(second[0]) if second and is_number(second[0]) else 0.0
    once = {*first} == {first[0]} and {*second} == {second[0]} if second else False
    alike = len(first) == len(second) == len(third) and not _is_start(third[0])
    if not once or not alike or rate not in (1.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0):
        return None
    # The file's name says what one column holds; three are the accelerometer.
    three, columns = len(first) == 3, len(first)
    return Preface(
        "Empatica E4",
        delimiter=",",
        header_row=0,
        unit_row=0,
        first_row=above + 3,
        names=("x", "y", "z") if three else ("value",) if columns == 1 else ("",) * columns,
        units=("1/64 g" if three else "",) * columns,
        time_column=-1,
        period=1 / rate,
        start=start,
    )


def _is_start(cell: str) -> bool:
    return is_number(cell) and 1262304000.0 <= float(cell) <= 2051222400.0  # 2010 to 2035


# A rate or an interval that a logger writes above its table: `# Sampling Rate: 250 Hz`, `Sample Interval,1E-6`.
#
# Source: the lines above the tables of PicoQuake, GENEActiv ("Measurement Frequency"), MetaWear, and many scripts.


_RATES = """
    rate|sample rate|sampling rate|samplerate|samplingrate|sample frequency|sampling frequency|samplingfrequency
    |sampling freq|sample freq|data rate|output data rate|measurement frequency|logging rate|acquisition rate
    |fs|odr|store rate|sfreq|abtastrate|abtastfrequenz|samplefrequenz|messrate
    |fréquence d'échantillonnage|frecuencia de muestreo|taxa de amostragem|frequenza di campionamento
    """
_INTERVALS = """
    sample interval|sampling interval|sample period|sampling period|sampleinterval|samplinginterval|samplingperiod
    |time step|timestep|dt|delta t|delta-t|increment|time increment|x increment|xincrement|logging interval
    |interval|intervall|xinc|x inc|tinc
    |log interval|recording interval|measurement interval|epoch length|epoch period|abtastintervall|messintervall
    |période d'échantillonnage|intervalo de muestreo
    """
_HERTZ = {
    **dict.fromkeys(("", "hz", "hertz", "1/s", "sps", "s/s", "sa/s", "samples/s", "samples/sec"), 1.0),
    **dict.fromkeys(("samples/second", "samples per second"), 1.0),
    **dict.fromkeys(("khz", "ks/s", "ksa/s", "ksps"), 1e3),
    **dict.fromkeys(("mhz", "ms/s", "msa/s", "msps"), 1e6),
    **dict.fromkeys(("ghz", "gs/s", "gsa/s"), 1e9),
}
_SECONDS = {"": 1.0} | {word: SECONDS_PER_UNIT[unit] for word, unit in UNIT_OF_WORD.items()}


def _alternatives(keys: str) -> str:
    return "|".join(re.escape(key.strip()) for key in keys.split("|"))


_STATED = re.compile(
    rf"(?:^|[,;|\t:=#%/])[ \"']{{0,4}}(?:(?P<rate>{_alternatives(_RATES)})|(?P<step>{_alternatives(_INTERVALS)}))"
    r" {0,4}(?:[(\[](?P<unit>[^()\[\]]{0,24})[)\]])?[ \"':=,;|\t]{1,8}"
    r"(?:(?P<clock>[0-9]{1,3}:[0-9]{2}:[0-9]{2})|(?P<number>[-+]?[0-9]{1,20}(?:[.,][0-9]{1,20}){0,3}(?:e[-+]?[0-9]{1,3})?))"
    r"(?P<mark>[ \"',;|\t]{0,4})(?P<written>[^0-9,;|\t\"'()]{0,24})"
)
"""A key at the begin of a cell, its unit in brackets, the value, and the unit after it or in the next cell."""


def _stated_rate(head: Sequence[str]) -> Preface | None:
    """The sample period that the lines above a table give; None where they give none, or more than one.

    A key that repeats on each line is a value of each row, such as `dt: 12` from a board.
    """
    found: list[tuple[float, str]] = []
    for before, line in zip(["", *head], head[:_MAX_LINES], strict=False):
        above = before[:_MAX_LENGTH].rstrip()
        start = above if above.endswith(":") else ""  # LabVIEW: `dt:` above its value
        text = f"{start} {line[:_MAX_LENGTH]}".strip(" \t\r\"',;").lower().replace("_", " ")
        if not is_comment(line) and NUMBER["."].match(text):
            break
        if sum(map(text.count, ",;|\t")) < _MAX_PARTS:
            found += [setting for match in _STATED.finditer(text) if (setting := _period(match))]
    if not 0 < len(found) < 3 or len({period for period, _ in found}) > 1:
        return None
    period, key = found[0]
    said = f'"{key}" above the table gives a sample interval of {duration(period)}'
    return Preface(period=period, notes=(said,))


def _period(match: re.Match[str]) -> tuple[float, str] | None:
    """The period in s and its key; None where the value is neither a rate nor an interval."""
    key, is_rate = match["rate"] or match["step"], match["rate"] is not None
    if match["clock"]:
        hours, minutes, seconds = map(float, match["clock"].split(":"))
        value, unit = (0.0 if is_rate else 3600 * hours + 60 * minutes + seconds), ""
    else:
        units, unit = (_HERTZ if is_rate else _SECONDS), match["written"].strip(" .")
        if unit not in units and any(mark in match["mark"] for mark in ",;|\t"):
            unit = ""  # another setting in the next cell
        unit = unit or (match["unit"] or "").strip()
        value = _number(match["number"]) * units.get(unit, 0.0)
    period = 1 / value if is_rate and value > 0 else value
    return (period, key) if _MIN_PERIOD < period < _MAX_PERIOD else None


def _number(text: str) -> float:
    """The number; 0 for `1,000`, which may be one or a thousand; `12,5` and `0,001` can only be decimals."""
    whole, comma, decimals = text.partition(",")
    if comma and len(decimals) == 3 and whole.strip("+-0"):
        return 0.0
    text = text.replace(",", ".", 1)
    return float(text) if is_number(text) else 0.0
