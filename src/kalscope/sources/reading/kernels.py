"""The compiled loops that read the rows of a table, nothing else: numbers exactly as `float` reads them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled

Bytes = NDArray[np.uint8]

MAX_PLAIN_TENS = 22
"""Largest power of ten that is a float64: one division by it is rounded correctly."""
TENS = np.array([10.0**i for i in range(MAX_PLAIN_TENS + 1)])
_MAX_PLAIN = 1 << 53
"""Up to here a whole number is a float64."""
_MAX_DIGITS = 9_200_000_000_000_000_000
"""Largest number that is read here, of 19 digits: more may not fit an int64."""
_SPLIT = float((1 << 27) + 1)
_DOUBT = 2.0**-48
MAX_SURE_STAMP = 0.99e20
"""Larger stamps may be damage, which the line reader decides by `timestamps.MAX_STAMP`."""

_NEWLINE = 10
_BLANK = 32
_TAB = 9
_PLUS = 43
_COMMA = 44
_MINUS = 45
_LINE_MARKS = (35, 37, 47, 40, 91)
"""Marks that may make a line a comment, `#%/`, or be removed from its ends, `([`."""

TEXT = 0
NUMBER = 1
CELL = 2
"""A column that is not read; one of plain numbers; one whose cells are read one by one."""


@compiled(inner=True, error_model="numpy")
def divided(digits: int, tens: int) -> tuple[float, bool]:
    """A whole number up to _MAX_DIGITS divided by a power of ten of at most MAX_PLAIN_TENS; True where it is sure.

    Source: W. D. Clinger, How to read floating point numbers accurately (1990); T. J. Dekker, A floating-point
    technique for extending the available precision (1971), for the exact product of two numbers.
    """
    power, high = TENS[tens], float(digits)
    found = high / power
    if digits <= _MAX_PLAIN:
        return found, True
    # The exact remainder: of the division, and of the digits that a float64 lacks.
    a = found * _SPLIT
    a -= a - found
    b = power * _SPLIT
    b -= b - power
    product = found * power
    error = ((a * b - product) + a * (power - b) + (found - a) * b) + (found - a) * (power - b)
    more = (((high - product) - error) + float(digits - int(high))) / power
    value = found + more
    return value, found + more * (1.0 + _DOUBT) == value == found + more * (1.0 - _DOUBT)


@compiled(inner=True, inline="always", error_model="numpy")
def read_number(data: Bytes, at: int, decimal: int) -> tuple[float, int, bool]:
    """The number, or nan, that begins at `at`; the place after it; False where there is none that is sure.

    The bytes must end with a newline. Its grammar is that of `grammar.cells.parse_number`: no hexadecimal, no
    infinity, and a digit after a decimal comma.
    """
    negative = data[at] == _MINUS
    at += negative or data[at] == _PLUS
    first, point, digits, power, byte = at, -1, 0, 0, data[at]
    while 48 <= byte <= 57 or (byte == decimal and point < 0):
        digits = digits if byte == decimal else 10 * digits + (byte - 48)
        point = at if byte == decimal else point
        at += 1
        byte = data[at]
    places = at - point - 1 if point >= 0 else 0
    count = 0 if decimal == _COMMA and data[at - 1] == _COMMA else at - first - (point >= 0)
    if at == first:
        is_nan = byte | 32 == 110 and data[at + 1] | 32 == 97 and data[at + 2] | 32 == 110
        return math.nan, at + 3 * is_nan, is_nan
    if byte | 32 == 101:  # e
        down = data[at + 1] == _MINUS
        at += 1 + (down or data[at + 1] == _PLUS)
        start = at
        while 48 <= data[at] <= 57 and power < 1000:
            power = 10 * power + (data[at] - 48)
            at += 1
        count = 0 if at == start else count
        places += power if down else -power
    if (
        not (0 < count <= 19 and 0 <= digits <= _MAX_DIGITS)
        or abs(places) > MAX_PLAIN_TENS
        or (places < 0 and digits > _MAX_PLAIN)
    ):
        return math.nan, at, False
    value, sure = (digits * TENS[-places], True) if places < 0 else divided(digits, places)
    return -value if negative else value, at, sure


@compiled(inner=True)
def _cell_end(data: Bytes, first: int, at: int, delimiter: int, sure: bool) -> tuple[int, bool]:
    """The end of the cell that begins at `first`, and whether only blanks follow a sure number up to `at`.

    The end is −1 where a byte may change what the line means: a quote, a bracket.
    """
    end = at
    while sure and (data[end] == _BLANK or data[end] == _TAB) and data[end] != delimiter != _BLANK:
        end += 1
    if sure and (data[end] in (delimiter, _NEWLINE) or (data[end] == _TAB and delimiter == _BLANK)):
        return end, True
    end = first
    if data[end] in _LINE_MARKS:
        return -1, False
    while data[end] != delimiter and data[end] != _NEWLINE and not (data[end] == _TAB and delimiter == _BLANK):
        byte = data[end]
        if byte in (34, 42) or byte > 126 or (byte < _BLANK and byte != _TAB):  # a quote, a star
            return -1, False
        end += 1
    return end, False


class RowForm(NamedTuple):
    """How the rows of a layout are written."""

    marks: tuple[int, int]
    """Delimiter and decimal mark."""
    reads: Bytes
    """TEXT, NUMBER or CELL of each column, shape (width,)."""
    fields: tuple[int, int]
    """Fewest and most fields of a line that is a row."""
    stamp: int
    """The column of the time; −1 where there is none."""


@compiled(error_model="numpy")
def read_plain_rows(
    data: Bytes, at: int, form: RowForm, out: NDArray[np.float64], odd: NDArray[np.int64]
) -> tuple[int, int, int]:
    """Rows from `at` on, until `out` or `odd` is full.

    Args:
        data: Whole lines, each with its newline.
        at: Where a line begins.
        form: How the rows are written.
        out: Their values, shape (rows, width), NaN where missing or not read.
        odd: What the line reader must read: row, column, begin and end of a cell, column −1 for a whole line; in
            their order, shape (many, 4), many > width.

    Returns:
        Rows, the place after them, how many are in `odd`.
    """
    marks, reads, stamp = form.marks, form.reads, form.stamp
    delimiter, decimal = marks
    width, row, new = len(reads), 0, 0
    while at < len(data) and row < len(out) and new + width < len(odd):
        begin, field, known, kept, is_row = at, 0, False, new, True
        while True:
            while data[at] == _BLANK or (data[at] == _TAB and delimiter != _TAB):
                at += 1
            if data[at] == _NEWLINE and delimiter == _BLANK:
                break
            first, value, reading = at, math.nan, reads[field] if field < width else TEXT
            sure = reading == NUMBER and data[at] != delimiter
            if sure:
                value, at, sure = read_number(data, at, decimal)
            if not (sure and (data[at] == delimiter or data[at] == _NEWLINE)):
                at, sure = _cell_end(data, first, at, delimiter, sure)
                value = value if sure else math.nan
                if not sure and at > first and reading != TEXT:
                    odd[new, 0], odd[new, 1], odd[new, 2], odd[new, 3] = row, field, first, at
                    new += 1
            is_row &= at >= first and (field < width or at == first)
            is_row &= field != stamp or abs(value) <= MAX_SURE_STAMP or new > kept
            if field < width:
                out[row, field] = value
            known |= at > first
            field += 1
            if not is_row or data[at] == _NEWLINE:
                break
            at += 1
        if is_row and known and form.fields[0] <= field <= form.fields[1]:
            out[row, field:] = math.nan
        else:
            at, new = max(at, begin), kept + 1
            odd[kept, 0], odd[kept, 1], odd[kept, 2] = row, -1, begin
            while data[at] != _NEWLINE:
                at += 1
        at, row = at + 1, row + 1
    return row, at, new
