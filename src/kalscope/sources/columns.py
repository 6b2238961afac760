"""What the columns of a log are: names, units, the time, text. Pure functions on cells."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from kalscope.sources.line_parser import MISSING, is_number, parse_number
from kalscope.sources.timestamps import UNIT_OF_WORD, TimeColumn, time_kind

Role = Literal["channel", "time", "text", "row name", "empty"]
Cells = tuple[str, ...]

STAMP_SHAPE = re.compile(
    r"[0-9]{1,4}[-/.][0-9]{1,2}[-/.][0-9]{1,4}(?:[T ]+[0-9]{1,2}[:.][0-9]{2}.*)?"
    r"|[0-9]{1,2}[:.][0-9]{2}[:.][0-9]{2}(?:[.,][0-9]+)?|[0-9]{1,2}:[0-9]{2}"
)
_BRACKETED = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")
_SUFFIXED = re.compile(r"(.+?)[_ ]([A-Za-zµμ%]+)")


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_UNITS = _words(
    """
    s sec second seconds ms us µs μs ns min h d yr year years v mv uv µv a ma ua µa g mg m mm cm km
    um µm m/s m/s2 m/s^2 m/s² m/s/s km/h mps ft in gal deg ° rad deg/s °/s dps rad/s rpm degc °c c
    celsius f degf °f k fahrenheit kelvin % %rh rh pa hpa kpa mpa mbar bar psi hz khz mhz lux lx ppm
    ppb count counts lsb adc raw w kw w/m2 w/m^2 w/m² n nm kg db dbm ohm kohm ω kω t ut µt gauss l
    ml l/min bpm
    """
)
# Suffixes of a channel's name that can hardly be anything else; one letter (a_g, a_x) could be.
_SUFFIX_UNITS = _words(
    """
    mm cm km mv ma mg ms us degc degf hpa kpa mbar hz lux ppm ppb rpm dps kg
    """
)
_TIME_NAMES = _words(
    """
    t time times timestamp timestamps time_stamp datetime date_time date day ms us µs ns s sec secs
    second seconds millis micros millisecond milliseconds microseconds nanoseconds elapsed
    elapsed_time uptime epoch unix unixtime unix_time time_utc utc_time local_time host_time
    device_time clock timer year zeit tiempo
    """
)
_DATE_NAMES = frozenset(("date", "day", "datetime", "timestamp"))


@dataclass(frozen=True)
class Column:
    """One field of the data lines."""

    name: str
    """Name without its unit, as the source says it; "" where it says none. Distinct among the channels."""
    unit: str = ""
    """Unit as the source says it; "" where it says none."""
    role: Role = "channel"
    """What becomes of it; only channels and the time are read."""


def named_column(text: str) -> Column:
    """`accel (m/s^2)` is accel in m/s^2; `Distance_cm` keeps its name, in cm; `CO(GT)` is a name."""
    text = "".join(c for c in text if c.isprintable()).strip()[:100]
    match = _BRACKETED.fullmatch(text)
    if match and match[1] and (match[2] is not None or _is_unit(match[3])):
        return Column(match[1], match[2] if match[2] is not None else match[3])
    match = _SUFFIXED.fullmatch(text)
    if match and match[2].lower() in _SUFFIX_UNITS:
        return Column(text, match[2])
    return Column(text)


def _is_unit(text: str) -> bool:
    return text.strip().lower() in _UNITS or re.search(r"[/^°²³%µ]", text) is not None


def are_units(cells: Cells) -> bool:
    """True for a row of units: each cell empty, "-", in brackets or known."""
    return all(not cell or cell != bare_unit(cell) or _is_unit(cell) or cell == "-" for cell in cells)


def bare_unit(unit: str) -> str:
    """The unit without its brackets; "" for "-"."""
    unit = unit[1:-1] if unit[:1] + unit[-1:] in ("[]", "()") and len(unit) > 1 else unit
    return "" if unit == "-" else unit.strip()


def role_of(column: Column, rows: list[Cells], index: int, decimal: str) -> Role:
    """Role of column `index` by its cells: a channel where one is a number, text where none is."""
    if column.role != "channel":
        return column.role
    cells = [row[index] for row in rows if row[index].lower() not in MISSING]
    if not cells:
        # A spreadsheet's trailing ";;": no name, nothing in it.
        return "empty" if not column.name and len(rows[0]) > 1 else "channel"
    return "channel" if any(is_number(cell, decimal) for cell in cells) else "text"


def find_time(columns: list[Column], rows: list[Cells], decimal: str, *, named: bool) -> TimeColumn | None:
    """The first column named like a time that reads as one; else stamps; else, unnamed, a rising first."""
    by_name = [i for i, column in enumerate(columns) if _base(column)[0] in _TIME_NAMES]
    kinds = {}
    for i, column in enumerate(columns):
        if i in by_name or column.role == "text":
            cells = [row[i] for row in rows]
            may_be_date = _base(column)[0] in _DATE_NAMES
            share = 0.5 if i in by_name else 0.9
            kinds[i] = time_kind(cells, decimal, may_be_date=may_be_date, share=share)
    by_form = [i for i, kind in kinds.items() if kind is not None and kind[0] in ("calendar", "clock")]
    for i in by_name + by_form:
        kind = kinds[i]
        if kind is None:
            continue
        follows = kinds.get(i + 1)
        clock = i + 1 if kind[0] == "calendar" and follows and follows[0] == "clock" else None
        if len(rows) > 1 and len({(row[i], row[clock] if clock else "") for row in rows}) == 1:
            continue  # a stamp that stands still is no time
        unit = _base(columns[i])[1] if kind[0] == "number" else ""
        return TimeColumn(i, kind[0], unit, kind[1], clock)
    if not named and len(columns) > 1 and _rises_steadily([row[0] for row in rows], decimal):
        return TimeColumn(0, "number")
    return None


def _base(column: Column) -> tuple[str, str]:
    """(time name without its unit, unit of time) of a column: `time_ms`, `t` in us, `micros`, `Time (UTC)`.

    A lone capital is a quantity: T is a temperature.
    """
    name, unit = column.name, UNIT_OF_WORD.get(column.unit.lower(), "")
    bracket = re.fullmatch(r"(.+?)\s*\([^()]*\)", name)
    name = bracket[1] if bracket else name
    if len(name) == 1 and name.isupper():
        return "", ""
    base = re.sub(r"[\s\-.]+", "_", name.strip().lower())
    match = re.fullmatch(r"(.+)_([a-zµμ]+)", base)
    if match and match[2] in UNIT_OF_WORD and match[1] in _TIME_NAMES:
        return match[1], unit or UNIT_OF_WORD[match[2]]
    # A column called "day" may hold dates.
    return base, unit or (UNIT_OF_WORD.get(base, "") if base != "day" else "")


def _rises_steadily(cells: list[str], decimal: str) -> bool:
    """True for eight or more rising stamps of nearly even step; a counter 0, 1, 2, … is none."""
    stamps = np.array([value if (value := parse_number(cell, decimal)) is not None else np.nan for cell in cells])
    stamps = stamps[np.isfinite(stamps) & (np.abs(stamps) < 1e20)]
    if stamps.size < 8 or stamps.size < 0.9 * len(cells):
        return False
    steps = np.diff(stamps)
    return bool(np.all(steps > 0) and steps.max() <= 50 * np.median(steps) and not np.all(steps == 1))


def settle_roles(
    columns: list[Column], time: TimeColumn | None
) -> tuple[list[Column], TimeColumn | None, tuple[str, ...]]:
    """Columns with their last role and distinct channel names, the time column, and what to say about both.

    A time that stands alone is the channel: a file of rising numbers is a signal.
    """
    if time is not None and time.kind == "number" and sum(column.role != "empty" for column in columns) == 1:
        time = None
    if time is None:
        notes = ["no time column: samples are counted"]
    else:
        taken = (time.index, time.clock_index)
        columns = [replace(column, role="time") if i in taken else column for i, column in enumerate(columns)]
        notes = [f'"{columns[time.index].name or f"column {time.index + 1}"}" is the time']
    channels = [i for i, column in enumerate(columns) if column.role == "channel"]
    columns = list(columns)
    for i, name in zip(channels, distinct_names([columns[i].name for i in channels]), strict=True):
        if columns[i].name and columns[i].name != name:
            notes.append(f'"{columns[i].name}" comes again and is called "{name}"')
        columns[i] = replace(columns[i], name=name)
    return columns, time, tuple(notes)


def distinct_names(names: list[str]) -> tuple[str, ...]:
    """Distinct names: the second `temp` becomes `temp 2`, those without a name `value 1`, `value 2`."""
    given = {name for name in names if name}
    distinct: list[str] = []
    for i, name in enumerate(names, 1):
        count = i if not name else 2
        candidate = name or f"value {count}"
        # A made-up name must not take one that a later column has of its own.
        while candidate in distinct or (candidate != name and candidate in given):
            candidate = f"{name or 'value'} {count}"
            count += 1
        distinct.append(candidate)
    return tuple(distinct)
