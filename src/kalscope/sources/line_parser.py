"""One line of text in, its cells and numbers out: no file, no port, no state.

The CSV reader and the live serial port share these functions, so that a recording and the wire agree.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

COMMENT_MARKS = ("#", "%", "//")
"""What a comment line begins with."""

MISSING = frozenset({"", "nan", "+nan", "-nan", "nil", "null", "na", "n/a", "none"})
"""Cells, in lower case, that say "no sample": ordinary missing values, never reported as bad."""

_NUMBER = {
    # [0-9], not \d: float() would take the digits of any script. No hexadecimal, no infinity, no "1_000".
    ".": re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"),
    # A decimal comma needs a digit after it, else "155," of "155, 0.76" would be a number.
    ",": re.compile(r"[-+]?(?:[0-9]+(?:,[0-9]+)?|,[0-9]+)(?:[eE][-+]?[0-9]+)?"),
}
_RUN_OF_SPACES = re.compile(r"[ \t]+")
_LABEL_PAIR = re.compile(r"([^\s:]+)\s*:\s*(\S+)")
_MONITOR_STAMP = re.compile(r"\s*([0-9]{1,2}:[0-9]{2}:[0-9]{2}(?:\.[0-9]+)?)\s*->\s?(.*)", re.DOTALL)


@dataclass(frozen=True)
class LineFormat:
    """How the data lines of one source are written."""

    kind: Literal["table", "labels"] = "table"
    """"table": values in fixed places; "labels": `name:value` pairs."""
    delimiter: str = ","
    """Between the cells of a table: one of `, ; TAB |`, or a space for any run of blanks."""
    decimal: str = "."
    """Decimal mark, "." or ","; never equal to the delimiter."""
    labels: tuple[str, ...] = ()
    """Labels in column order; () for a table."""
    stamped: bool = False
    """True where each line begins with the Arduino IDE's `12:00:00.023 -> `; that stamp is cell 0."""


def is_comment(line: str) -> bool:
    """True where the first mark on the line is #, % or //."""
    return line.lstrip(" \t").startswith(COMMENT_MARKS)


def is_blank(line: str, delimiter: str = "") -> bool:
    """True where nothing but blanks and delimiters (a spreadsheet's empty row) stands on the line."""
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
            # strict: else `" 3"25` would be glued to 325, a number that nobody wrote.
            row = next(csv.reader([text], delimiter=delimiter, skipinitialspace=True, strict=True), [])
            return [cell.strip(" \t") for cell in row]
        except csv.Error:  # a stray quote, or a cell above the module's limit
            pass
    if delimiter == " ":
        return _RUN_OF_SPACES.split(text) if text else []
    return [cell.strip(" \t") for cell in text.split(delimiter)]


def split_labels(line: str) -> list[tuple[str, str]] | None:
    """(label, value text) pairs of `a:1,b:2`, `a: 1 b: 2`, `Sensor Value: 155, Volts: 0.76`, `>a:1`.

    Returns:
        None where the line is not wholly made of pairs, or a label is a number (`12:30:05`).
    """
    text = line.strip().removeprefix(">")
    if any(mark in text for mark in ",;\t"):
        parts = [part for part in re.split(r"[,;\t]", text) if part.strip()]
        pairs = [(label.strip(), value.strip()) for label, _, value in (part.partition(":") for part in parts)]
        complete = all(":" in part for part in parts)
    elif text.count(":") == 1:
        label, _, value = text.partition(":")
        pairs, complete = [(label.strip(), value.strip())], True
    else:
        pairs = _LABEL_PAIR.findall(text)
        complete = not _LABEL_PAIR.sub("", text).strip()
    if not pairs or not complete or any(not label or is_number(label) for label, _ in pairs):
        return None
    return pairs


def split_stamp(line: str) -> tuple[str, str] | None:
    """(`12:00:00.023`, rest) of a line copied from the Arduino IDE's monitor; None for any other line."""
    match = _MONITOR_STAMP.fullmatch(line)
    return (match[1], match[2]) if match else None


def split_line(line: str, form: LineFormat) -> list[str] | None:
    """Cells of one line in column order.

    Returns:
        None where a labelled line holds no pairs, an unknown label or one label twice, and where the
        stamp of a stamped line is missing. The number of cells of a table line is for the caller to check.
    """
    head: list[str] = []
    if form.stamped:
        stamped = split_stamp(line)
        if stamped is None:
            return None
        head, line = [stamped[0]], stamped[1]
    if form.kind == "table":
        return head + split_fields(line, form.delimiter)
    pairs = split_labels(line)
    if pairs is None:
        return None
    found = dict(pairs)
    if len(found) != len(pairs) or not found.keys() <= set(form.labels):
        return None
    return head + [found.get(label, "") for label in form.labels]


def is_number(cell: str, decimal: str = ".") -> bool:
    """True where the whole cell is a plain decimal number, within float64 or not."""
    return _NUMBER[decimal].fullmatch(cell) is not None


def parse_number(cell: str, decimal: str = ".") -> float | None:
    """The number in a cell.

    Returns:
        NaN for a missing value (empty, NaN, nil, null, NA, none); None for what is no finite number
        (`12abc`, `0x1F`, `Infinity`, `ERR`, `1e999`, `1_000`).
    """
    if _NUMBER[decimal].fullmatch(cell):
        value = float(cell.replace(",", "."))
        return value if math.isfinite(value) else None
    return math.nan if cell.lower() in MISSING else None


def plain_row_parser(form: LineFormat, width: int) -> Callable[[str], list[float] | None]:
    """The fast path: a function from a line of nothing but `width` numbers, newline included, to the numbers.

    It answers None for every other line, which then takes the slow path; the two agree wherever it answers.
    """
    if form.kind != "table" or form.stamped:
        return lambda _: None
    delimiter, decimal = form.delimiter, form.decimal
    allowed = re.compile(f"[-+0-9eE \t{re.escape(delimiter)}{re.escape(decimal)}]+\n")
    number = _NUMBER[decimal]

    def parse(line: str) -> list[float] | None:
        if not allowed.fullmatch(line):
            return None
        cells = line.split() if delimiter == " " else line.split(delimiter)
        if len(cells) != width:
            return None
        if decimal == ",":
            # float() takes "5." but this grammar does not take "5,": leave the odd ones to the slow path.
            if not all(number.fullmatch(cell.strip(" \t\n")) for cell in cells):
                return None
            cells = [cell.replace(",", ".") for cell in cells]
        try:
            values = list(map(float, cells))
        except ValueError:
            return None
        # Only an exponent or 300 digits can reach infinity.
        if (len(line) > 300 or "e" in line or "E" in line) and not all(map(math.isfinite, values)):
            return None
        return values

    return parse
