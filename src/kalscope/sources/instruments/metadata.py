"""The lines above a table: their cells, the numbers and units in them, the first row of samples.

Pure functions on the first lines of a file. Every loop ends after MAX_LINES lines, and every step over a line is
linear in its length.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from kalscope.sources.grammar.cells import is_number, parse_number, split_fields

Cells = tuple[str, ...]

KEPT_COMMA = "\x1f"
"""A comma that is part of a text, where "," stands for the delimiter of a file (`dialect`)."""

MIN_PERIOD = 1e-15
"""Shortest period in s, and the inverse of the longest; any other is damage."""

MAX_LINES = 200
"""The table of a known instrument begins within this many lines."""

_WORDS = {
    "second": "s",
    "seconds": "s",
    "sec": "s",
    "volt": "V",
    "volts": "V",
    "ampere": "A",
    "amperes": "A",
    "amp": "A",
    "amps": "A",
    "watt": "W",
    "watts": "W",
    "unknown": "",
    "unitless": "",
    "value": "",
    "no_units": "",
    "no units": "",
    "n/a": "",
    "msecs": "ms",
    "msec": "ms",
    "hertz": "Hz",
}
_SYMBOLS = frozenset((
    "", "s", "ms", "us", "µs", "μs", "ns", "V", "kV", "mV", "uV", "µV", "μV", "nV", "A", "mA", "uA", "µA", "μA",
    "W", "mW", "Hz", "kHz", "MHz", "dB", "dBm", "dBV", "%", "Ω", "VV", "AA", "U",
))  # fmt: skip


def cells_of(line: str) -> Cells:
    """Cells of a line, without blanks, quotes, and the empty cells at its end."""
    cells = split_fields(line, ",")
    while cells and not cells[-1]:
        cells.pop()
    return tuple(cells)


def table_rows(head: Sequence[str]) -> list[Cells]:
    """Cells of the first MAX_LINES lines."""
    return [cells_of(line) for line in head[:MAX_LINES]]


def is_sample(cells: Cells) -> bool:
    """True for a row of numbers; those after the first may be missing."""
    return bool(cells) and is_number(cells[0]) and all(not cell or is_number(cell) for cell in cells)


def first_sample(rows: Sequence[Cells], after: int = 0) -> int | None:
    """Index of the first row of numbers at or after index `after`; None where there is none."""
    return next((i for i in range(after, len(rows)) if is_sample(rows[i])), None)


def first_stamp(rows: Sequence[Cells], after: int) -> int | None:
    """Index of the first row that begins with a number, whatever follows ("∞", 0x00); None where there is none."""
    return next((i for i in range(after, len(rows)) if is_sample(rows[i][:1])), None)


def index_of(rows: Sequence[Cells], *firsts: str) -> int | None:
    """Index of the first row whose first cell is one of `firsts`, in lower case; None where there is none."""
    return next((i for i, cells in enumerate(rows) if cells and cells[0].lower() in firsts), None)


def said(rows: Iterable[Cells], *keys: str) -> str:
    """The cell after the first of the keys, lower case, that a row begins with; "" where none does."""
    for cells in rows:
        if len(cells) > 1 and cells[0].lower().rstrip(" :=") in keys:
            return cells[1]
    return ""


def positive(text: str) -> float | None:
    """The positive number that a cell holds, of the size of a period or rate; None for any other cell ("Inf")."""
    value = parse_number(text.strip())
    return value if value is not None and MIN_PERIOD <= value <= 1 / MIN_PERIOD else None


def inverse(value: float | None) -> float | None:
    """The period of a rate, and the rate of a period."""
    return None if value is None else 1 / value


def unit_in(cell: str) -> str | None:
    """The unit that an oscilloscope's cell names ("Volt", "(ms)", "V"); None where it names none."""
    text = cell.strip()
    text = text[1:-1].strip() if text[:1] + text[-1:] in ("()", "[]") else text
    return _WORDS.get(text.lower(), text if text in _SYMBOLS else None)


def agrees(period: float, rows: Sequence[Cells], column: int) -> bool:
    """True where the stamps of the first rows are a period apart: a decimated export keeps the old rate above it.

    Args:
        period: Sample period in s.
        rows: Rows of samples.
        column: Column of the stamp, in s.
    """
    stamps = [parse_number(cells[column]) for cells in rows if len(cells) > column]
    known = [stamp for stamp in stamps if stamp is not None and math.isfinite(stamp)]
    if len(known) < 2:
        return True
    span = known[-1] - known[0]
    return abs(span - period * (len(known) - 1)) <= 0.02 * abs(span)


def in_words(period: float) -> str:
    """A period as a report writes it: "8 µs"."""
    period = float(f"{period:.6g}")
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9)):
        if period >= size:
            return f"{period / size:.6g} {unit}"
    return f"{period / 1e-12:.6g} ps"
