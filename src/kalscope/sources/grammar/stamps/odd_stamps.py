"""Stamps that our own forms do not read: a format that the user gives, a spreadsheet's day numbers, and dateutil.

Which of them a column is in is decided once for the whole column, never cell by cell.
"""

# pyright: reportMissingModuleSource=false, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
# dateutil has no types of its own.

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import datetime, timedelta, timezone, tzinfo

from kalscope.errors import BadSetting
from kalscope.sources.grammar.cells import parse_number
from kalscope.sources.grammar.stamps.clocks import MAX_STAMP_LENGTH
from kalscope.sources.grammar.stamps.date_words import ZONES_H
from kalscope.sources.grammar.stamps.dates import DateOrder, parse_six_digits

EXCEL = "excel"
"""Days since 1899-12-30, as spreadsheets count them."""
SIX_DIGITS = "six digits"
"""A date of two digits each for the year, the month and the day."""
DATEUTIL = "dateutil"
"""Whatever python-dateutil reads as a whole date."""

MIN_EXCEL, MAX_EXCEL = 20_000.0, 80_000.0
"""Days of 1954 to 2119: a number outside is not a spreadsheet date."""

_EPOCH = datetime(1970, 1, 1)
_EXCEL_EPOCH_DAYS = 25569  # from 1899-12-30 to 1970-01-01
_MICROSECOND = timedelta(microseconds=1)
_DATE_CODES = frozenset("aAbBcdDGgjmuUVWwxyYFvhe")
_INVERTED_ZONE = re.compile(r"\b(?:GMT|UTC)(?=[-+])")  # dateutil takes "GMT+8" for 8 hours behind


def odd_parser(form: str, decimal: str, order: DateOrder) -> Callable[[str], float | None]:
    """The function that reads a cell of an odd form as microseconds; None for a damaged stamp."""
    if form == EXCEL:
        return lambda cell: parse_excel(cell, decimal)
    if form == SIX_DIGITS:
        return lambda cell: parse_six_digits(cell, order)
    if form == DATEUTIL:
        return lambda cell: parse_with_dateutil(cell, order)
    return lambda cell: parse_with_format(cell, form)


def parse_excel(cell: str, decimal: str) -> float | None:
    """Microseconds since 1970 of a spreadsheet's day number, `45123.5`."""
    days = parse_number(cell, decimal)
    if days is None or not MIN_EXCEL <= days <= MAX_EXCEL or cell[0] == "0":  # 030124 is a date in digits
        return None
    return round((days - _EXCEL_EPOCH_DAYS) * 86400e3) * 1e3  # spreadsheets resolve ms at best


def parse_with_format(cell: str, form: str) -> float | None:
    """Microseconds since 1970, or since midnight where the format names no part of a date."""
    if len(cell) > MAX_STAMP_LENGTH:
        return None
    try:
        stamp = datetime.strptime(cell, form)
    except ValueError:
        return None
    if not has_date(form):
        stamp = stamp.replace(year=1970, month=1, day=1)
    return _microseconds(stamp)


def has_date(form: str) -> bool:
    """True where a format of strptime names a part of a date."""
    return any(mark == "%" and code in _DATE_CODES for mark, code in _codes(form))


def check_format(form: str) -> None:
    """Raise BadSetting unless strptime knows every code of a format, and each occurs once."""
    try:
        datetime.strptime("", form)
    except ValueError as error:
        if "does not match" not in str(error):
            raise BadSetting(f"time_format must hold the codes of strptime (got {form!r}: {error})") from None
    except re.error:  # strptime makes a pattern with a named group for each code
        raise BadSetting(f"time_format must hold each code of strptime once (got {form!r})") from None
    if not _codes(form):
        raise BadSetting(f'time_format must look like "%d.%m.%Y %H:%M:%S" (got {form!r})')


def parse_with_dateutil(cell: str, order: DateOrder) -> float | None:
    """Microseconds since 1970 of a whole date in any form that python-dateutil reads."""
    if not 6 <= len(cell) <= MAX_STAMP_LENGTH or not any(c.isdigit() for c in cell):
        return None
    from dateutil import parser

    text, found = _INVERTED_ZONE.sub("", cell), set[float]()
    # A part that is missing would be taken from the default: two defaults must give one stamp.
    for default in (datetime(2000, 1, 1), datetime(2011, 12, 28)):
        try:
            stamp: datetime = parser.parse(
                text, default=default, dayfirst=order == "dmy", yearfirst=order == "ymd", tzinfos=_zone
            )
            found.add(_microseconds(stamp))
        except (ValueError, OverflowError, TypeError, IndexError, AttributeError):  # what it raises on odd text
            return None
    return found.pop() if len(found) == 1 else None


def _codes(form: str) -> list[tuple[str, str]]:
    return [("%", code) for code in re.findall(r"%[-#]?(.)", form)]


def _zone(name: str | None, offset: int | None) -> tzinfo:
    hours = ZONES_H.get((name or "").upper(), 0.0)
    return timezone(timedelta(hours=hours) if offset is None else timedelta(seconds=offset))


def _microseconds(stamp: datetime) -> float:
    ahead = stamp.utcoffset() or timedelta()
    return float((stamp.replace(tzinfo=None) - _EPOCH - ahead) // _MICROSECOND)
