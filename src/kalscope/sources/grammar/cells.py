"""The cells of a line and the numbers in them: what is a number, a missing value, a comment, a blank line."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass

COMMENT_MARKS = ("#", "%", "//")
"""What a comment line begins with."""

MISSING = frozenset({"", "nan", "+nan", "-nan", "nil", "null", "na", "n/a", "none"})
"""Cells, in lower case, that say "no sample": ordinary missing values, never reported as bad."""

_MISSING_TEXT = r"""
m - -- --- ---- ----- * ** *** **** ***** / // /// //// ///// ? ?? ??? . .. ... _ __ \n
unavailable unknown offline disconnected missing invalid void undefined undef nodata no_data no-data
n.a. n.a n/d n.d. n.d nd #n/a #n/a! #na #value! #div/0! #ref! #num! <na> <null> (null) nat
"""
MISSING_WORDS = frozenset((*_MISSING_TEXT.split(), "no data", "not available"))
"""Other cells, in lower case, that loggers write for "no sample": missing as well, and counted in the report."""

OVERFLOWS = frozenset(sign + word for sign in ("", "+", "-") for word in ("inf", "infinity", "ovf"))
"""What boards print, in lower case, for a float that they cannot print: no sample, and never a name."""

NUMBER = {
    # [0-9], not \d: float() would take the digits of any script. No hexadecimal, no infinity, no "1_000".
    ".": re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"),
    # A decimal comma needs a digit after it, else "155," of "155, 0.76" would be a number.
    ",": re.compile(r"[-+]?(?:[0-9]+(?:,[0-9]+)?|,[0-9]+)(?:[eE][-+]?[0-9]+)?"),
}
"""The whole grammar of a number, by its decimal mark."""

_TYPED = str.maketrans({"\u00a0": " ", "\u2009": " ", "\u202f": " ", "\u2212": "-"})
"""Plain characters for non-breaking spaces, as browsers write them before AM, and for the typographic minus."""
_NUMBER_STARTS = (*"0123456789+-.", "nan", "NaN", "None", "null")
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")
DAMAGED = "\0"
"""Replaces a damaged line in sniffing: it counts as a line that is not a row, and costs nothing."""
_RUN_OF_SPACES = re.compile(r"[ \t]+")


def is_comment(line: str) -> bool:
    """True where the first mark on the line is #, % or //."""
    return line.lstrip(" \t").startswith(COMMENT_MARKS)


def is_blank(line: str, delimiter: str = "") -> bool:
    """True where nothing but blanks and delimiters (a spreadsheet's empty row) is on the line."""
    return not line.strip(" \t\r\n" + delimiter)


def is_damaged(line: str) -> bool:
    """Whether a line was damaged on the wire or on the disk: where it has control characters no cell is trusted."""
    return _CONTROL.search(line) is not None


def split_fields(line: str, delimiter: str) -> list[str]:
    """Cells of one table line, without blanks and quotes around them; typographic blanks and minus made plain.

    A quoted cell never spans lines: a stray quote is a damaged cell, and must not swallow
    the rows below it.
    """
    cells = _split(line, delimiter)
    return cells if line.isascii() else [cell.translate(_TYPED).strip(" ") for cell in cells]


def _split(line: str, delimiter: str) -> list[str]:
    text = line.strip(" \t\r\n") if delimiter == " " else line.rstrip("\r\n")
    if text.endswith(("]", ")")):
        text = _without_brackets(text)
    if '"' in text and text.count('"') % 2 == 0:
        try:
            text = _RUN_OF_SPACES.sub(" ", text) if delimiter == " " else text
            # strict: else `" 3"25` would be glued to 325, a number that is not in the file.
            reader = csv.reader([text], delimiter=delimiter, skipinitialspace=True, strict=True)
            return [cell.strip(" \t") for row in reader for cell in row]
        except csv.Error:  # a stray quote, or a cell above the module's limit
            pass
    if delimiter == " ":
        return _RUN_OF_SPACES.split(text) if text else []
    return [cell.strip(" \t") for cell in text.split(delimiter)]


def _without_brackets(text: str) -> str:
    """`1, 2, 3` of `[1, 2, 3]` and `(1, 2, 3)`, as Python prints lists and tuples; any other line unchanged."""
    bare = text.strip(" \t")
    inner = bare[1:-1]
    is_pair = bare[:1] + bare[-1] in ("[]", "()") and not any(mark in inner for mark in "[]()")
    numbers = inner.strip(" \t").startswith(_NUMBER_STARTS) and any(mark in inner for mark in ",; \t")
    return inner.strip(" \t") if is_pair and numbers else text


def is_number(cell: str, decimal: str = ".") -> bool:
    """True where the whole cell is a plain decimal number, within float64 or not."""
    return NUMBER[decimal].fullmatch(cell) is not None


def parse_number(cell: str, decimal: str = ".") -> float | None:
    """The number in a cell.

    Returns:
        NaN for a missing value (empty, NaN, nil, null, NA, none); None for what is not a finite number
        (`12abc`, `0x1F`, `Infinity`, `ERR`, `1e999`, `1_000`).
    """
    if NUMBER[decimal].fullmatch(cell):
        value = float(cell.replace(",", "."))
        return value if math.isfinite(value) else None
    return math.nan if cell.lower() in MISSING else None


_MEASURE = re.compile(
    r"([-+]?(?:[0-9]+(?:[.,][0-9]+){0,4}|[.,][0-9]+)(?:[eE][-+]?[0-9]+)?) ?([^\s0-9.,+\-][^\s]{0,7}(?: [AD]C)?)"
)
_GROUPED = {
    # The thousands of "1,234.5" by its decimal mark; 0,123 has none.
    ".": re.compile(r"[-+]?[1-9][0-9]{0,2}(?:,[0-9]{3})+(?:\.[0-9]+)?"),
    ",": re.compile(r"[-+]?[1-9][0-9]{0,2}(?:\.[0-9]{3})+(?:,[0-9]+)?"),
}
_BLANK_GROUPED = {
    mark: re.compile(rf"[-+]?[1-9][0-9]{{0,2}}(?:[ \u00a0\u202f'’][0-9]{{3}})+(?:{re.escape(mark)}[0-9]+)?")
    for mark in ".,"
}
"""The same with blanks or the Swiss apostrophe: 1 234,5."""
_NO_BLANKS = str.maketrans("", "", " \u00a0\u202f'’")
OTHER_MARK = {".": ",", ",": "."}
"""The mark that is not the decimal mark, and may separate thousands."""


@dataclass(frozen=True)
class NumberForm:
    """How the numbers of one column are written."""

    decimal: str = "."
    """Decimal mark, "." or ","."""
    thousands: bool = False
    """True where the other mark, a blank or an apostrophe may separate thousands: 1,234.5."""
    suffix: str = ""
    """Unit that is written after each number: the C of 26.69C."""

    def fits(self, cell: str) -> bool:
        """True where the whole cell is a number of this form, within float64 or not."""
        cell = self._bare(cell)
        return bool(self.thousands and self._is_grouped(cell)) or NUMBER[self.decimal].fullmatch(cell) is not None

    def parse(self, cell: str) -> float | None:
        """The number in a cell, as `parse_number`."""
        cell = self._bare(cell)
        if self.thousands and self._is_grouped(cell):
            cell = cell.replace(OTHER_MARK[self.decimal], "").translate(_NO_BLANKS)
        return parse_number(cell, self.decimal)

    def _is_grouped(self, cell: str) -> bool:
        patterns = (_GROUPED[self.decimal], _BLANK_GROUPED[self.decimal])
        return any(pattern.fullmatch(cell) for pattern in patterns)

    def _bare(self, cell: str) -> str:
        return cell.removesuffix(self.suffix).rstrip(" ") if self.suffix else cell


def split_measure(cell: str) -> tuple[str, str] | None:
    """(number, unit) of `26.69C`, `45 %`, `3,3V`, whatever the unit; None for any other cell."""
    match = _MEASURE.fullmatch(cell) if len(cell) <= 40 else None
    return (match[1], match[2]) if match else None


def is_grouped(cell: str) -> bool:
    """True for a number that has thousands separators, or may have them: 1,234.5, 1 234,5 and 1.234."""
    return any(pattern.fullmatch(cell) for pattern in (*_GROUPED.values(), *_BLANK_GROUPED.values()))
