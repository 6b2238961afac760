"""Blocks of plain rows, read by compiled loops: a hundredth of the time that the line reader needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kalscope.common.array import Array
from kalscope.sources.grammar.cells import is_number, parse_number
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.layout.sniffer import Layout
from kalscope.sources.lines.row_kernels import AFTER_ITS_LIKE, ALWAYS, RowForm, read_plain_rows

_MAX_NUMBERS = 1 << 18
"""Numbers that are read at once: 2 MiB, which fits a processor's cache."""
_MAX_ROUNDED = 1024
"""Numbers of more digits than the loops hold that are read again at once."""


@dataclass(frozen=True)
class PlainRows:
    """The plain rows at one place."""

    values: Array
    """Numbers, shape (rows, columns), NaN where missing or not read; overwritten by the next call."""
    end: int
    """The place after them."""
    fields: int
    """Fields of the last of them; what was given as `before` where there is none."""


class BlockParser:
    """Reads plain rows of one layout.

    A line is plain where it holds one number or missing value (nan or nothing) per channel and the line reader
    reads it alike. Whatever is doubtful ends the rows: other bytes, quotes, blank lines, numbers near the ends of
    float64, stamps out of range.
    """

    def __init__(self, layout: Layout) -> None:
        width, delimiter = len(layout.columns), layout.form.delimiter
        self._decimal = layout.form.decimal
        widths = np.zeros(width + 2, dtype=np.uint8)
        widths[list(layout.narrow)] = AFTER_ITS_LIKE
        widths[layout.least : width + 1 + (delimiter != " ")] = ALWAYS  # a separator may end the line
        self._form = RowForm(
            marks=(ord(delimiter), ord(self._decimal)),
            wanted=np.array(_are_read(layout), dtype=np.uint8),
            widths=widths,
            stamp=-1 if layout.time is None else layout.time.index,
        )
        self._out = np.empty((max(16, _MAX_NUMBERS // width), width))
        self._rounded = np.zeros((max(_MAX_ROUNDED, width + 1), 4), dtype=np.int64)

    def parse(self, data: bytes, at: int, end: int, before: int) -> PlainRows:
        r"""The plain rows from `at` on, none where the first line is not plain.

        Args:
            data: Lines, UTF-8, each with "\n" at its end, up to `end`.
            at: Where the first begins.
            end: Where the last ends.
            before: Fields of the row before; −1 at the first row.
        """
        lines: NDArray[np.uint8] = np.frombuffer(data, dtype=np.uint8, count=end)
        out = self._out
        rows, stop, before, again = read_plain_rows(lines, at, self._form, before, out, self._rounded)
        for row, column, first, last in self._rounded[:again].tolist():
            out[row, column] = float(data[first:last].decode().replace(self._decimal, "."))
        return PlainRows(out[:rows], stop, before)


def block_parser(layout: Layout, options: ReadOptions) -> BlockParser | None:
    """The parser of plain rows of a layout; None where each line needs the line reader."""
    form, time = layout.form, layout.time
    is_never_plain = (
        form.kind != "table"
        or form.stamped
        or form.checksum
        or form.decimal == form.delimiter  # inside quotes
        or (time is not None and time.kind != "number")
        or any(column.role == "series" or column.form is not None for column in layout.columns)
        or any(is_number(text, form.decimal) for text in options.missing_texts)
        or any(_may_be_row(row, layout) for row in layout.header_rows)
    )
    return None if is_never_plain else BlockParser(layout)


def _are_read(layout: Layout) -> list[bool]:
    """Whether each column is read: the channels and the time; the others may hold any text."""
    read = {*layout.channels, *(layout.time.indices if layout.time else ())}
    return [i in read for i in range(len(layout.columns))]


def _may_be_row(header: tuple[str, ...], layout: Layout) -> bool:
    """Whether a header, which may come again, would be taken for numbers: `state,2019,2020`."""
    read = [cell for cell, is_read in zip(header, _are_read(layout), strict=False) if is_read]
    return all(parse_number(cell, layout.form.decimal) is not None for cell in read)
