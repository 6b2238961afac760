"""The ways in which the first lines of a log could be split into rows, and which of them fits best.

Pure functions on text.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, replace

from kalscope.sources.grammar.cells import MISSING, is_blank, is_comment, is_number, split_fields
from kalscope.sources.grammar.line_format import (
    LineFormat,
    find_labels,
    split_checksum,
    split_stamp,
    split_teleplot,
)
from kalscope.sources.grammar.read_options import DELIMITERS, ReadOptions
from kalscope.sources.layout.columns import STAMP_SHAPE, Cells

MIN_SHARE = 0.15
"""Of the lines of the head, the share that must look like data: boot text may outweigh a short log."""
MIN_UNIFORM = 0.6
"""Of the lines with numbers, the share that must have one width: records of several lines are no table."""
MIN_UNIFORM_LINES = 20
"""Lines it takes to judge that."""


@dataclass(frozen=True)
class HeadLine:
    """One line that may hold data."""

    number: int
    """Line number, from 1."""
    text: str
    """The line without stamp and checksum."""
    stamp: str
    """The Arduino IDE's stamp; "" where there is none."""


@dataclass(frozen=True)
class HeadTable:
    """The data lines of the head, split in one of the possible ways."""

    score: float
    """Share of the lines that look like data, 0…1."""
    form: LineFormat
    """How they were split."""
    width: int
    """Cells of a row."""
    rows: tuple[tuple[int, Cells], ...]
    """(line number, cells) of the lines that look like data."""


def candidate_lines(head: list[str]) -> tuple[list[HeadLine], LineFormat]:
    """Lines that may hold data; stamp and checksum split off where most lines have one, which the form says."""
    lines = [HeadLine(i, text, "") for i, text in enumerate(head, 1) if not is_blank(text) and not is_comment(text)]
    form = LineFormat()
    split = [(line, split_stamp(line.text)) for line in lines]
    stamped = [HeadLine(line.number, parts[1], parts[0]) for line, parts in split if parts is not None]
    if stamped and len(stamped) > len(lines) / 2:
        lines, form = stamped, replace(form, stamped=True)
    sums = [(line, split_checksum(line.text)) for line in lines]
    checked = [replace(line, text=parts[0]) for line, parts in sums if parts and parts[1] == parts[2]]
    if checked and len(checked) > len(lines) / 2:
        plain = [line for line, parts in sums if parts is None and not any(c.isdigit() for c in line.text)]
        lines = sorted(checked + plain, key=lambda line: line.number)  # a header has no checksum
        form = replace(form, checksum=True)
    return lines, form


def best_table(lines: list[HeadLine], options: ReadOptions) -> HeadTable | None:
    """The way to split that makes most lines look like data; None where none makes MIN_SHARE of them."""
    candidates = [] if options.delimiter else [_teleplot(lines), _labelled(lines)]
    for delimiter in (options.delimiter,) if options.delimiter else DELIMITERS:
        split = [(line.number, tuple(split_fields(line.text, delimiter))) for line in lines]
        for decimal in (options.decimal,) if options.decimal else (".", ","):
            if decimal != delimiter:
                candidates.append(_as_table(split, LineFormat("table", delimiter, decimal)))
    found = [table for table in candidates if table is not None and table.score >= MIN_SHARE]
    return max(found, key=lambda table: _rank(lines, table), default=None)


def only_text(cells: Cells | list[str], decimal: str) -> bool:
    """True where no cell is a number, a stamp or a missing value, and one is there at all."""
    return any(cells) and all(
        not cell
        or (not is_number(cell, decimal) and not STAMP_SHAPE.fullmatch(cell) and cell.lower() not in MISSING)
        for cell in cells
    )


def are_names(cells: Cells | list[str], below: Cells, decimal: str) -> bool:
    """True for a header above the row `below`. One "Na" in it is sodium where another name is above a number."""
    others = [cell for cell in cells if cell.lower() != "na"]
    if len(others) == len(cells):
        return only_text(cells, decimal)
    is_above = any(
        cell and cell.lower() != "na" and is_number(under, decimal)
        for cell, under in zip(cells, below, strict=False)
    )
    return is_above and len(others) == len(cells) - 1 and only_text(others, decimal)


def _likeness(cells: Cells, decimal: str) -> float:
    """Share of the cells that a data line may hold; 0 where none is a number."""
    numbers = sum(is_number(cell, decimal) for cell in cells)
    if not numbers:
        return 0.0
    others = sum(cell.lower() in MISSING or STAMP_SHAPE.fullmatch(cell) is not None for cell in cells)
    return (numbers + others) / len(cells)


def _rank(lines: list[HeadLine], table: HeadTable) -> tuple[float, bool, bool, bool]:
    """Best score; of equals Teleplot, the one whose header has as many cells, the one with the decimal point."""
    fits = _header_fits(lines, table)
    score = table.score
    if table.form.decimal == "," and table.width == 1 and not fits:
        # Any "12,5" is one number as well as two: the header must speak for the one.
        score /= 2
    return round(score, 6), table.form.kind == "teleplot", fits, table.form.decimal == "."


def _as_table(split: list[tuple[int, Cells]], form: LineFormat) -> HeadTable | None:
    """The lines of the commonest width, weighed by how much they look like data."""
    likeness = {number: _likeness(cells, form.decimal) for number, cells in split}
    weight: defaultdict[int, float] = defaultdict(float)
    for number, cells in split:
        weight[len(cells)] += likeness[number]
    width = max(weight, key=lambda width: weight[width], default=0)
    if not width or not weight[width]:
        return None
    if len(split) >= MIN_UNIFORM_LINES and weight[width] < MIN_UNIFORM * sum(weight.values()):
        return None
    fitting = [(number, cells) for number, cells in split if len(cells) == width]
    best = max(likeness[number] for number, _ in fitting)
    rows = tuple((number, cells) for number, cells in fitting if likeness[number] >= best / 2)
    return HeadTable(weight[width] / len(split), form, width, rows)


def _labelled(lines: list[HeadLine]) -> HeadTable | None:
    """The lines of `name:value` pairs whose names come often and with numbers."""
    pairs = [(line.number, dict(found[0])) for line in lines if (found := find_labels(line.text))]
    count: defaultdict[str, int] = defaultdict(int)
    for _, found in pairs:
        for label, value in found.items():
            count[label] += is_number(value) or STAMP_SHAPE.fullmatch(value) is not None
    numeric = {label for label, n in count.items() if n and n >= 0.1 * len(pairs)}
    # A text beside numbers, "status", is a column; lines of texts alone are the program's log.
    beside = Counter(label for _, found in pairs if found.keys() & numeric for label in found)
    labels = tuple(label for label, n in beside.items() if n >= 0.1 * len(pairs))
    rows = tuple(
        (number, tuple(found.get(label, "") for label in labels))
        for number, found in pairs
        if found.keys() & numeric and found.keys() <= set(labels)
    )
    rows = tuple(row for row in rows if _likeness(row[1], "."))
    if not rows:
        return None
    return HeadTable(len(rows) / len(lines), LineFormat("labels", ",", ".", labels), len(labels), rows)


def _teleplot(lines: list[HeadLine]) -> HeadTable | None:
    """The lines `>name:ms:value§unit`; other lines beside them are the program's log and do not count."""
    marked = [line for line in lines if line.text.lstrip().startswith(">")]
    found = [(line.number, plot) for line in marked if (plot := split_teleplot(line.text))]
    found = [(number, plot) for number, plot in found if any(is_number(value) for _, value in plot.samples)]
    if not found:
        return None
    labels = tuple(dict.fromkeys(plot.name for _, plot in found))
    timed = any(stamp for _, plot in found for stamp, _ in plot.samples)
    rows = tuple(
        (number, (*((stamp,) if timed else ()), *(value if name == plot.name else "" for name in labels)))
        for number, plot in found
        for stamp, value in plot.samples
    )
    form = LineFormat("teleplot", ",", ".", labels)
    return HeadTable(len(found) / len(marked), form, len(labels) + timed, rows)


def _header_fits(lines: list[HeadLine], table: HeadTable) -> bool:
    above = [line for line in lines if line.number < table.rows[0][0]]
    if not above or table.form.kind != "table":
        return False
    cells = split_fields(above[-1].text, table.form.delimiter)
    whole = table.form.decimal != "," or not any("," in cell for cell in cells)
    return whole and len(cells) == table.width and are_names(cells, table.rows[0][1], table.form.decimal)
