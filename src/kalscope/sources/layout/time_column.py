"""Which column of a log is its time: by its name, by its stamps, or by numbers that rise steadily."""

from __future__ import annotations

import re

import numpy as np

from kalscope.errors import BadSetting
from kalscope.sources.grammar.cells import parse_number
from kalscope.sources.grammar.timestamps import (
    UNIT_OF_WORD,
    DateOrder,
    TimeColumn,
    TimeKind,
    parse_year_day,
    time_kind,
)
from kalscope.sources.layout.columns import Cells, Column, words

_TIME_NAMES = words(
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
