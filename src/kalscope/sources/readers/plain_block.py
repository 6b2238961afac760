"""Blocks of plain rows, parsed by numpy at once: a tenth of the time that the line reader needs."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kalscope.common.array import Array
from kalscope.sources.grammar.cells import is_number
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.grammar.timestamps import MAX_STAMP
from kalscope.sources.layout.sniffer import Layout

_OPEN_COMMA = re.compile(",(?![0-9])")
"""A decimal comma needs a digit after it; float() takes "5." as a number."""


@dataclass(frozen=True)
class PlainRows:
    """The rows of a block of lines."""

    values: Array
    """Numbers, shape (lines, columns), NaN where missing."""
    fields: int
    """Fields that each line holds; fewer than columns where the last ones are empty or lacking."""


BlockParser = Callable[[list[str]], PlainRows | None]
"""From whole lines, newline included, to their rows; None where one of the lines is not plain. A block is taken
exactly where each of its lines would be taken alone."""


def block_parser(layout: Layout, options: ReadOptions) -> BlockParser | None:
    """The parser of plain rows of a layout; None where no line of it is plain.

    A line is plain where it holds one number or missing value (nan or nothing) a column and means the same to the
    line reader. Whatever is doubtful is refused: other bytes, blank lines, infinite numbers, stamps out of range.
    """
    if _is_never_plain(layout, options):
        return None
    form, width = layout.form, len(layout.columns)
    delimiter = None if form.delimiter == " " else form.delimiter
    kept = width
    while kept > 1 and layout.columns[kept - 1].role == "empty":
        kept -= 1
    plain = f"0123456789+-eEnaN \t\n{form.delimiter}{form.decimal}".encode()

    def parse(lines: list[str]) -> PlainRows | None:
        text = "".join(lines)
        if not text.isascii() or text.encode().translate(None, plain) or text.isspace():
            return None
        if form.decimal == ",":
            if _OPEN_COMMA.search(text):
                return None
            text = text.replace(",", ".")
            lines = text.splitlines()
        if kept < width:
            shorter = _without_ending(text, form.delimiter * (width - kept), len(lines))
            lines = lines if shorter is text else shorter.splitlines()
            text = shorter
            if text.isspace():
                return None
        rows = _loaded(lines, delimiter)
        if rows is None and delimiter is not None:
            filled = _filled(text, delimiter)
            rows = None if filled is text else _loaded(filled.splitlines(), delimiter)
        if rows is None or len(rows) != len(lines) or np.isinf(rows).any():
            return None
        fields = rows.shape[1]
        known = fields in (width, kept) or fields in layout.narrow
        return _checked(rows, fields, layout) if known else None

    return parse


def _is_never_plain(layout: Layout, options: ReadOptions) -> bool:
    """True where each line needs the line reader."""
    form, time = layout.form, layout.time
    return (
        form.kind != "table"
        or form.stamped
        or form.checksum
        or form.decimal == form.delimiter  # inside quotes
        or (time is not None and time.kind != "number")
        or any(column.role in ("text", "series") or column.form is not None for column in layout.columns)
        or any(is_number(text, form.decimal) for text in options.missing_texts)
    )


def _checked(rows: Array, fields: int, layout: Layout) -> PlainRows | None:
    """The rows with NaN in the columns that the lines lack; None where a stamp or a whole line is in doubt."""
    lacking = len(layout.columns) - fields
    if lacking:
        rows = np.hstack((rows, np.full((len(rows), lacking), np.nan)))
    if layout.time is not None:
        is_doubtful = ~(np.abs(rows[:, layout.time.index]) <= MAX_STAMP)  # NaN fails as well
    else:
        is_doubtful = np.isnan(rows).all(axis=1)  # a line of delimiters alone is blank
    return None if is_doubtful.any() else PlainRows(rows, fields)


def _without_ending(text: str, ending: str, count: int) -> str:
    """The lines without the separators at their ends; `text` itself where one of the `count` lines has others."""
    bare = text.replace(" \n", "\n") if " \n" in text else text
    return bare.replace(f"{ending}\n", "\n") if bare.count(f"{ending}\n") == count else text


def _loaded(lines: list[str], delimiter: str | None) -> Array | None:
    try:
        return np.loadtxt(lines, delimiter=delimiter, comments=None, ndmin=2, encoding=None)
    except ValueError:
        return None


def _filled(text: str, delimiter: str) -> str:
    """The lines with "nan" in empty cells; `text` itself where there is none."""
    twice, last, first = delimiter * 2, f"{delimiter}\n", f"\n{delimiter}"
    framed = f"\n{text}"
    if not any(mark in framed for mark in (twice, last, first)):
        return text
    framed = framed.replace(twice, f"{delimiter}nan{delimiter}").replace(twice, f"{delimiter}nan{delimiter}")
    return framed.replace(last, f"{delimiter}nan\n").replace(first, f"\nnan{delimiter}")[1:]
