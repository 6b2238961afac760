"""A time in several columns: year, month, day, hour, minute, second, or a date and a clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np

from kalscope.common.array import Array
from kalscope.sources.grammar.stamps.clocks import CLOCK_PARSERS, ClockForm
from kalscope.sources.grammar.timestamps import MAX_YEAR, MIN_YEAR, PartRole, TimeColumn, row_stamp_parser, whole
from kalscope.sources.grammar.units import words
from kalscope.sources.layout.columns import Column
from kalscope.sources.layout.rows.kinds import Cells

_ROLE_OF_NAME: dict[str, PartRole] = {
    **dict.fromkeys(words("year years yr yyyy yy jahr año ano annee année"), "year"),
    **dict.fromkeys(words("month months mon mo monat mes mois"), "month"),
    **dict.fromkeys(words("day days dd dy dom tag dia día jour day_of_month dayofmonth"), "day"),
    **dict.fromkeys(words("doy jday yday jd julian_day julianday day_of_year dayofyear"), "day of year"),
    **dict.fromkeys(words("hour hours hr hrs hh stunde hora heure"), "hour"),
    **dict.fromkeys(words("minute minutes min mins minuten mi mn"), "minute"),
    **dict.fromkeys(words("second seconds sec secs ss s sekunde segundo"), "second"),
    **dict.fromkeys(words("hhmm hhmmss mst lst utc gmt est pst cst hour_minute time clock zeit uhrzeit"), "clock"),
}
_EPOCH, _MAX_US = datetime(1970, 1, 1), 6e16  # 1 to 3871: within the calendar of datetime
_IN_ORDER: tuple[PartRole, ...] = ("year", "month", "day", "hour", "minute", "second")
_RANGES: tuple[tuple[int, int], ...] = (
    (MIN_YEAR + 100, MAX_YEAR - 100),
    (1, 12),
    (1, 31),
    (0, 23),
    (0, 59),
    (0, 60),
)


def named_parts(columns: list[Column], rows: list[Cells]) -> TimeColumn | None:
    """The time whose parts are named year, month, day, …; None without a year and a month or day of the year."""
    places: dict[PartRole, int] = {}
    for i, column in enumerate(columns):
        role = _role(column.name, places)
        if role is not None and role not in places:
            places[role] = i
    if "year" not in places or not {"month", "day of year"} & places.keys():
        return None
    clock = None
    if "hour" not in places and "clock" in places:
        clock = clock_form([row[places["clock"]] for row in rows])
    if clock is None:
        places.pop("clock", None)
    kept: tuple[tuple[PartRole, int], ...] = tuple(
        (role, i) for role, i in places.items() if _belongs(role, places)
    )
    return TimeColumn(places["year"], "calendar", clock=clock or "h:m:s", parts=kept)


def unnamed_parts(rows: list[Cells]) -> TimeColumn | None:
    """Columns beside each other that hold a year, perhaps the day of the year, month, day, hour and minute.

    Five columns of whole numbers, each in its range, with a year in front, are hardly anything else.
    """
    width = min(map(len, rows), default=0)
    for first in range(width - 4):
        for is_numbered in (True, False):
            places = range(first + is_numbered, first + is_numbered + len(_IN_ORDER))
            parts: list[tuple[PartRole, int]] = [
                (role, first if role == "year" else i)
                for role, i, ends in zip(_IN_ORDER, places, _RANGES, strict=True)
                if i < width and _in_range(rows, first if role == "year" else i, *ends)
            ]
            if tuple(role for role, _ in parts[:5]) != _IN_ORDER[:5]:
                continue
            if not is_numbered:
                return TimeColumn(first, "calendar", parts=tuple(parts))
            numbered = TimeColumn(first, "calendar", parts=(("year", first), ("day of year", first + 1)))
            days = row_stamp_parser(numbered, "."), row_stamp_parser(replace(numbered, parts=tuple(parts[:3])), ".")
            if all(days[0](row) == days[1](row) for row in rows):
                return replace(numbered, parts=(*numbered.parts, *parts[1:]))
    return None


def repeated_parts(columns: list[Column], rows: list[Cells], stamps: Array) -> tuple[int, ...]:
    """Columns that only repeat a part of the time: a year, a month, an hour beside a whole stamp.

    Args:
        columns: Names and roles.
        rows: Their cells.
        stamps: Microseconds since 1970 of the rows, NaN where unreadable, shape (n,).
    """
    known = np.flatnonzero(np.abs(stamps) < _MAX_US).tolist()
    read = [(_EPOCH + timedelta(microseconds=float(stamps[i])), rows[i]) for i in known]
    found: list[int] = []
    for i, column in enumerate(columns):
        part = _PARTS.get(_role(column.name, {}) or "clock")
        if part is None or column.role != "channel" or not read:
            continue
        if all(part(at) == whole(row[i]) for at, row in read):
            found.append(i)
    return tuple(found)


_PARTS: dict[PartRole, Callable[[datetime], int]] = {
    "year": lambda at: at.year,
    "month": lambda at: at.month,
    "day": lambda at: at.day,
    "day of year": lambda at: at.timetuple().tm_yday,
    "hour": lambda at: at.hour,
    "minute": lambda at: at.minute,
    "second": lambda at: at.second,
}


def clock_form(cells: list[str]) -> ClockForm | None:
    """How a column beside a date writes the time of day: `18:00`, `1800` or `180000`; None where it does not."""
    for form in ("h:m:s", "hhmm", "hhmmss"):
        if sum(CLOCK_PARSERS[form](cell) is not None for cell in cells) < max(1.0, 0.9 * len(cells)):
            continue
        # `0`, `10`, `20` beside a date count something else.
        return form if any(len(cell) > 2 for cell in cells) else None
    return None


def _role(name: str, places: dict[PartRole, int]) -> PartRole | None:
    """The part that a name means; in `YY MM DD hh mm`, `mm` is first the month, then the minute."""
    base = name.partition("(")[0].strip(" #%").lower().replace(" ", "_").replace("-", "_")
    if base == "mm":
        return "minute" if "hour" in places or "month" in places else "month"
    return _ROLE_OF_NAME.get(base)


def _belongs(role: PartRole, places: dict[PartRole, int]) -> bool:
    """False for a part without the one above it."""
    above = {"minute": "hour", "second": "minute", "day": "month"}.get(role)
    return above is None or above in places


def _in_range(rows: list[Cells], index: int, low: int, high: int) -> bool:
    if len(rows) < 8:
        return False
    values = [whole(row[index]) for row in rows]
    return all(value is not None and low <= value <= high for value in values)
