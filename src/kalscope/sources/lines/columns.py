"""What the columns of a log are: names, units, the time, text. Pure functions on cells."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from kalscope.errors import BadSetting
from kalscope.sources.lines.cells import MISSING, is_number, parse_number
from kalscope.sources.lines.timestamps import (
    UNIT_OF_WORD,
    DateOrder,
    TimeColumn,
    TimeKind,
    parse_year_day,
    time_kind,
)

Role = Literal["channel", "time", "text", "row name", "row number", "empty"]
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
_DAY_OF_YEAR_NAMES = frozenset(("doy", "jday", "yday", "julian_day", "day_of_year", "dayofyear"))
_HHMM_NAMES = frozenset(("hhmm", "mst", "lst", "utc", "gmt", "est", "pst", "cst", "time", "hour_minute"))


HOST_AND_DEVICE = ("host time", "device time")
"""The first two columns of our own recordings of a live source: two clocks of one row, neither is a channel."""

ROW_NUMBER_NAME = "sample"
"""Header of the first column of our own CSV where a recording has no time: it counts the rows."""

_ROW_NUMBER_NAMES = frozenset(
    ("", "#", "count", "counter", "id", "idx", "index", "no", "no.", "nr", "row", "samples")
)
_MIN_COUNTED = 8


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
    if index == 0 and len(rows[0]) > 1 and _is_row_number(column.name, cells):
        return "row number"
    return "channel" if any(is_number(cell, decimal) for cell in cells) else "text"


def _is_row_number(name: str, cells: list[str]) -> bool:
    """True for Kalscope's own column of row numbers, and for another column named so that counts without a gap."""
    if name == ROW_NUMBER_NAME:
        return _counts(cells)
    if name.lower() not in _ROW_NUMBER_NAMES or len(cells) < _MIN_COUNTED or not _counts(cells):
        return False
    return int(cells[-1]) - int(cells[0]) == len(cells) - 1


def _counts(cells: list[str]) -> bool:
    """True for 0, 1, 2, … and 1, 2, 3, …, perhaps with a line left out."""
    if not all(cell.isascii() and cell.isdecimal() for cell in cells):
        return False
    numbers = [int(cell) for cell in cells]
    return numbers[0] <= 1 and all(b > a for a, b in pairwise(numbers))


def find_time(columns: list[Column], rows: list[Cells], decimal: str, *, named: bool) -> TimeColumn | None:
    """The first column named like a time that reads as one; else stamps; else, unnamed, a rising first."""
    parts = _year_day(columns, rows)
    if parts is not None:
        return parts
    by_name = [i for i, column in enumerate(columns) if _base(column)[0] in _TIME_NAMES]
    kinds: dict[int, tuple[TimeKind, DateOrder] | None] = {}
    for i, column in enumerate(columns):
        if i in by_name or column.role == "text":
            cells = [row[i] for row in rows]
            may_be_date = _base(column)[0] in _DATE_NAMES
            share = 0.5 if i in by_name else 0.9
            kinds[i] = time_kind(cells, decimal, may_be_date=may_be_date, share=share)
    dated = [i for i, kind in kinds.items() if kind is not None and kind[0] == "calendar"]
    clocks = [i for i, kind in kinds.items() if kind is not None and kind[0] == "clock"]
    # A clock beside a date, on either side, is a part of it.
    by_name = [i + 1 if i in clocks and i + 1 in dated else i for i in by_name]
    for i in by_name + sorted(dated + clocks):
        kind = kinds[i]
        if kind is None:
            continue
        beside = [j for j in (i + 1, i - 1) if j in clocks] if kind[0] in ("calendar", "yyyymmdd") else []
        clock = beside[0] if beside else None
        if len(rows) > 1 and len({(row[i], row[clock] if clock is not None else "") for row in rows}) == 1:
            continue  # a stamp that never changes is no time
        unit = _base(columns[i])[1] if kind[0] == "number" else ""
        return TimeColumn(i, kind[0], unit, kind[1], clock)
    if not named and len(columns) > 1 and _rises_steadily([row[0] for row in rows], decimal):
        return TimeColumn(0, "number")
    return None


def chosen_time(
    columns: list[Column], rows: list[Cells], decimal: str, choice: str | int, labels: Cells = ()
) -> TimeColumn | None:
    """The time column that the user chose, by name or by index from 0; None for "none".

    Raises:
        BadSetting: there is no such column, or it holds neither numbers nor stamps.
    """
    names = [column.name for column in columns]
    if choice == "none" and "none" not in names:
        return None
    if isinstance(choice, str):
        # As the file writes it, `time [ms]`, or as the report shows it, `time`.
        found = [i for known in (names, list(labels)) for i, name in enumerate(known) if name == choice.strip()]
        index = found[0] if found else -1
    else:
        index = choice
    if not 0 <= index < len(columns):
        shown = ", ".join(name or f"column {i}" for i, name in enumerate(names, 1))
        raise BadSetting(f'the time column must be one of {shown}, or "none" (got {choice!r})')
    cells = [row[index] for row in rows]
    kind = time_kind(cells, decimal, may_be_date=_base(columns[index])[0] in _DATE_NAMES, share=0.5)
    if kind is None:
        example = next(filter(None, cells), "")[:40]
        raise BadSetting(f"the time column must hold numbers or stamps (got {example!r})")
    found_by_form = find_time(columns, rows, decimal, named=True)
    if found_by_form is not None and index in found_by_form.indices:
        return found_by_form  # with its clock in a column of its own
    return TimeColumn(index, kind[0], _base(columns[index])[1] if kind[0] == "number" else "", kind[1])


def _year_day(columns: list[Column], rows: list[Cells]) -> TimeColumn | None:
    """Year, day of the year and a clock written 2359 in columns of their own, as weather stations do."""
    bases = [re.sub(r"[\s\-.]+", "_", column.name.lower()) for column in columns]

    def first(names: frozenset[str]) -> int | None:
        return next((i for i, base in enumerate(bases) if base in names), None)

    year, day, clock = first(frozenset(("year",))), first(_DAY_OF_YEAR_NAMES), first(_HHMM_NAMES)
    if year is None or day is None or clock is None:
        return None
    read = [parse_year_day(row[year], row[day], row[clock]) is not None for row in rows]
    if sum(read) < max(1, 0.9 * len(rows)):
        return None
    return TimeColumn(year, "year day", clock_index=clock, day_index=day)


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
    """Columns with their final role and distinct channel names, the time column, and remarks about both.

    A time that stands alone is the channel: a file of rising numbers is a signal.
    """
    if time is not None and time.kind == "number" and sum(column.role != "empty" for column in columns) == 1:
        time = None
    if time is None:
        notes = ["no time column: samples are counted"]
    else:
        taken = time.indices
        if tuple(column.name for column in columns[:2]) == HOST_AND_DEVICE and {*taken} <= {0, 1}:
            taken = (0, 1)
        columns = [replace(column, role="time") if i in taken else column for i, column in enumerate(columns)]
        notes = [f'"{columns[time.index].name or f"column {time.index + 1}"}" is the time']
    channels = [i for i, column in enumerate(columns) if column.role == "channel"]
    columns = list(columns)
    for i, name in zip(channels, distinct_names([columns[i].name for i in channels]), strict=True):
        if columns[i].name and columns[i].name != name:
            notes.append(f'"{columns[i].name}" is repeated and is renamed "{name}"')
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
