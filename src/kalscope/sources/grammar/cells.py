"""The cells of a line and the numbers in them: what is a number, a missing value, a comment, a blank line."""

from __future__ import annotations

import csv
import math
import re

COMMENT_MARKS = ("#", "%", "//")
"""What a comment line begins with."""

MISSING = frozenset({"", "nan", "+nan", "-nan", "nil", "null", "na", "n/a", "none"})
"""Cells, in lower case, that say "no sample": ordinary missing values, never reported as bad."""

NUMBER = {
    # [0-9], not \d: float() would take the digits of any script. No hexadecimal, no infinity, no "1_000".
    ".": re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"),
    # A decimal comma needs a digit after it, else "155," of "155, 0.76" would be a number.
    ",": re.compile(r"[-+]?(?:[0-9]+(?:,[0-9]+)?|,[0-9]+)(?:[eE][-+]?[0-9]+)?"),
}
"""The whole grammar of a number, by its decimal mark."""

_RUN_OF_SPACES = re.compile(r"[ \t]+")


def is_comment(line: str) -> bool:
    """True where the first mark on the line is #, % or //."""
    return line.lstrip(" \t").startswith(COMMENT_MARKS)


def is_blank(line: str, delimiter: str = "") -> bool:
    """True where nothing but blanks and delimiters (a spreadsheet's empty row) is on the line."""
    return not line.strip(" \t\r\n" + delimiter)


def split_fields(line: str, delimiter: str) -> list[str]:
    """Cells of one table line, without the blanks and quotes around them.

    A quote never reaches over the end of the line: a stray one is a damaged cell, and must not swallow
    the rows below it.
    """
    text = line.strip(" \t\r\n") if delimiter == " " else line.rstrip("\r\n")
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


def is_number(cell: str, decimal: str = ".") -> bool:
    """True where the whole cell is a plain decimal number, within float64 or not."""
    return NUMBER[decimal].fullmatch(cell) is not None


def parse_number(cell: str, decimal: str = ".") -> float | None:
    """The number in a cell.

    Returns:
        NaN for a missing value (empty, NaN, nil, null, NA, none); None for what is no finite number
        (`12abc`, `0x1F`, `Infinity`, `ERR`, `1e999`, `1_000`).
    """
    if NUMBER[decimal].fullmatch(cell):
        value = float(cell.replace(",", "."))
        return value if math.isfinite(value) else None
    return math.nan if cell.lower() in MISSING else None
