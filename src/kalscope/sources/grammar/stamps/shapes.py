"""Whether a cell is a stamp at all, whatever its form."""

from __future__ import annotations

from kalscope.sources.grammar.stamps.clocks import MAX_STAMP_LENGTH, parse_clock, parse_elapsed, parse_minutes
from kalscope.sources.grammar.stamps.dates import DateOrder, parse_calendar

MIN_STAMP_LENGTH = 4
_MIN_DATE_LENGTH = 6


def is_stamp(cell: str) -> bool:
    """True where the cell is a date, a clock, an elapsed time or a date with a clock; never for a plain number."""
    if not MIN_STAMP_LENGTH <= len(cell) <= MAX_STAMP_LENGTH or not _may_be_stamp(cell):
        return False
    orders: tuple[DateOrder, ...] = ("ymd",) if cell[:4].isdecimal() else ("dmy", "mdy", "ymd")
    is_date = len(cell) >= _MIN_DATE_LENGTH and any(parse_calendar(cell, order) is not None for order in orders)
    return is_date or any(parse(cell) is not None for parse in (parse_clock, parse_minutes, parse_elapsed))


def _may_be_stamp(cell: str) -> bool:
    """True where the cell has the marks of a stamp; no plain number and few texts have them."""
    digits = sum(map(cell.count, "0123456789"))
    if digits < 3 or not (cell[0].isdigit() or cell[0].isalpha()):
        return False
    if ":" in cell or cell.count("-") + cell.count("/") + cell.count(".") >= 2:
        return True
    # A name of a month, or the T or _ of 20240313T093000.
    return digits < len(cell) - 1 or "_" in cell or "T" in cell
