"""The compiled loops of plain rows, nothing else: numbers exactly as `float` reads them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kalscope.common.compiled import compiled

# Decimal numbers of text, exactly as `float` reads them: by one division, and its remainder for 16 to 18 digits.
#
# Source: W. D. Clinger, How to read floating point numbers accurately (1990); T. J. Dekker, A floating-point
# technique for extending the available precision (1971), for the exact product of two numbers.


Bytes = NDArray[np.uint8]

EXACT, ROUNDED, BAD = 0, 1, 2
"""What `read_number` found: the number; a number that `float` must read again; none."""

MAX_DIGITS = 18
"""Digits that always fit an int64."""
_MANY_DIGITS = 100
MAX_TENS = 60
"""Largest power of ten, up or down, of a number that is read here: far from the ends of float64."""
_MAX_PLAIN = 1 << 53
"""Up to here a whole number is a float64, and one division by an exact power of ten is rounded correctly."""
MAX_PLAIN_TENS = 22
TENS = np.array([10.0**i for i in range(MAX_PLAIN_TENS + 1)])
_SPLIT = float((1 << 27) + 1)
_DOUBT = 2.0**-48


@compiled(inner=True, error_model="numpy")
def divided(digits: int, tens: int) -> tuple[float, int]:
    """A whole number below 2^63 divided by a power of ten of at most MAX_PLAIN_TENS; EXACT where rounded once."""
    power, high = TENS[tens], float(digits)
    found = high / power
    if digits <= _MAX_PLAIN:
        return found, EXACT
    # The exact remainder: of the division, and of the digits that a float64 lacks.
    a = found * _SPLIT
    a -= a - found
    b = power * _SPLIT
    b -= b - power
    product = found * power
    error = ((a * b - product) + a * (power - b) + (found - a) * b) + (found - a) * (power - b)
    more = (((high - product) - error) + float(digits - int(high))) / power
    value = found + more
    sure = found + more * (1.0 + _DOUBT) == value == found + more * (1.0 - _DOUBT)
    return value, EXACT if sure else ROUNDED


@compiled(inner=True)
def _exponent(data: Bytes, at: int) -> tuple[int, int]:
    """The power of ten after an e, and its end; 1000 where it is that large or missing."""
    down = data[at] == 45
    at += down or data[at] == 43
    start, power = at, 0
    while 48 <= data[at] <= 57:
        power = min(10 * power + (data[at] - 48), 1000)
        at += 1
    if at == start:
        return 1000, at
    return (-power if down else power), at


@compiled(inner=True)
def read_number(data: Bytes, at: int, decimal: int) -> tuple[float, int, int]:
    """The number, or nan, that begins at `at`; where it ends; and EXACT, ROUNDED or BAD.

    The bytes must end with a newline. Its grammar is that of `grammar.cells.parse_number`: no hexadecimal, no
    infinity, and a digit after a decimal comma.
    """
    byte = data[at]
    negative = byte == 45
    if negative or byte == 43:
        at += 1
        byte = data[at]
    first, digits, tens = at, 0, 0
    while 48 <= byte <= 57:
        digits = 10 * digits + (byte - 48)
        at += 1
        byte = data[at]
    count = at - first
    if byte == decimal:
        at += 1
        byte = data[at]
        while 48 <= byte <= 57:
            digits = 10 * digits + (byte - 48)
            at += 1
            byte = data[at]
        tens = count + 1 + first - at
        count -= tens
        if decimal == 44 and tens == 0:
            return 0.0, at, BAD
    end = at
    if count == 0 or count > _MANY_DIGITS:
        is_nan = end == first and byte | 32 == 110 and data[at + 1] | 32 == 97 and data[at + 2] | 32 == 110
        return (math.nan, at + 3, EXACT) if is_nan else (0.0, at, BAD)
    if byte | 32 == 101:  # e
        power, at = _exponent(data, at + 1)
        tens += power
    if not -MAX_TENS <= tens <= MAX_TENS:
        return 0.0, at, BAD
    if count > MAX_DIGITS or abs(tens) > MAX_PLAIN_TENS or (tens > 0 and digits > _MAX_PLAIN):
        return 0.0, at, ROUNDED
    value, how = (digits * TENS[tens], EXACT) if tens > 0 else divided(digits, -tens)
    return (-value if negative else value), at, how


# Plain rows of a table, many lines per call: each line is read as the line reader reads it, or ends the call.


MAX_SURE_STAMP = 0.99e20
"""Larger stamps may be damage, which the line reader decides by `timestamps.MAX_STAMP`."""

_NEWLINE, _BLANK, _TAB, _QUOTE, _STAR, _MINUS = 10, 32, 9, 34, 42, 45
_LINE_MARKS = (35, 37, 47, 40, 91)
"""Marks that may make a line a comment, `#%/`, or be removed from its ends, `([`."""
_EMPTY, _NO_CELL = -1, -2
"""What `_odd_cell` found besides what `read_number` finds: nothing between two delimiters; the end of the line."""


@compiled(inner=True)
def _past_blanks(data: Bytes, at: int, delimiter: int) -> int:
    while data[at] == _BLANK or (data[at] == _TAB and delimiter != _TAB):
        at += 1
    return at


@compiled(inner=True)
def _past_text(data: Bytes, at: int, delimiter: int) -> int:
    """The end of a cell of text; −1 where a byte may change what the line means: a quote, a bracket."""
    if data[at] in _LINE_MARKS:
        return -1
    while data[at] != delimiter and data[at] != _NEWLINE and not (data[at] == _TAB and delimiter == _BLANK):
        byte = data[at]
        if byte in (_QUOTE, _STAR) or byte > 126 or (byte < _BLANK and byte != _TAB):
            return -1
        at += 1
    return at


@compiled(inner=True)
def _odd_cell(data: Bytes, at: int, marks: tuple[int, int], wanted: int) -> tuple[float, int, int]:
    """The cell at `at`, however it is written: its value, the byte before the next cell or the newline, kind."""
    delimiter, decimal = marks
    at = _past_blanks(data, at, delimiter)
    value, how = math.nan, _EMPTY
    if data[at] == _NEWLINE and delimiter == _BLANK:
        return value, at, _NO_CELL
    if data[at] != _NEWLINE and data[at] != delimiter:
        if wanted:
            value, at, how = read_number(data, at, decimal)
        else:
            at, how = _past_text(data, at, delimiter), EXACT
        if how == BAD or at < 0:
            return value, at, BAD
    end = at
    at = _past_blanks(data, at, delimiter)
    if data[at] == _NEWLINE or (data[at] == delimiter and delimiter != _BLANK):
        return value, at, how
    return value, at - 1, how if delimiter == _BLANK and at > end else BAD


class RowForm(NamedTuple):
    """How the rows of a layout are written."""

    marks: tuple[int, int]
    """Delimiter and decimal mark."""
    wanted: Bytes
    """1 where a column is read, 0 where it may hold any text; shape (width,)."""
    fields: tuple[int, int]
    """Fewest and most fields of a line that is a row."""
    stamp: int
    """The column of the time; −1 where there is none."""


@compiled(error_model="numpy")
def read_plain_rows(
    data: Bytes, at: int, form: RowForm, out: NDArray[np.float64], rounded: NDArray[np.int64]
) -> tuple[int, int, int]:
    """Plain rows from `at` on, up to the first line that is not plain, or until `out` or `rounded` is full.

    The usual cell, 15 digits at most and a mark after them, is read here: with a call for each it takes four times
    as long.

    Args:
        data: Whole lines, each with its newline.
        at: Where a line begins.
        form: How the rows are written.
        out: Their values, shape (rows, width), NaN where missing or not wanted.
        rounded: Numbers of too many digits, which `float` must read again: row, column, begin and end of the cell;
            shape (many, 4), many > width.

    Returns:
        Rows, the place after them, numbers in `rounded`.
    """
    marks, wanted = form.marks, form.wanted
    delimiter, decimal = marks
    width, row, end, fields, known, hard, new = len(wanted), 0, at, 0, False, 0, 0
    while at < len(data) and row < len(out) and hard + width < len(rounded):
        start, count, tens, digits, how = at, 0, 0, 0, EXACT
        negative = data[at] == _MINUS
        byte = data[at + negative]
        if fields < width and wanted[fields]:
            at += negative
            first, point = at, -1
            while 48 <= byte <= 57 or (byte == decimal and point < 0):
                digits = digits if byte == decimal else 10 * digits + (byte - 48)
                point = at if byte == decimal else point
                at += 1
                byte = data[at]
            tens = at - point - 1 if point >= 0 else 0
            count = at - first - (point >= 0) if point < 0 or tens else 0
        if 0 < count <= 15 and byte in (delimiter, _NEWLINE):
            value = digits / TENS[tens]
            value = -value if negative else value
        else:
            value, at, how = _odd_cell(data, start, marks, fields < width and wanted[fields])
            if how == BAD or (how >= 0 and fields >= width):
                break
            rounded[new, 0], rounded[new, 1], rounded[new, 2], rounded[new, 3] = row, fields, start, at
            new += how == ROUNDED
        if how != _NO_CELL:
            known = known or how != _EMPTY
            if fields < width:
                out[row, fields] = value
            fields += 1
        at += 1
        if data[at - 1] == _NEWLINE:
            out[row, fields:] = math.nan
            whole = form.fields[0] <= fields <= form.fields[1]
            sure = form.stamp < 0 or abs(out[row, form.stamp]) <= MAX_SURE_STAMP  # else it may be damage
            if not (known and whole and sure):
                break
            row, end, hard, fields, known = row + 1, at, new, 0, False
    return row, end, hard
