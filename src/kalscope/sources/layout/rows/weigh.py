"""Which of the ways to split a log is the best, and which other one comes close. Pure functions."""

from __future__ import annotations

from collections import Counter

from kalscope.sources.grammar.cells import NumberForm, is_grouped, split_fields
from kalscope.sources.layout.rows.kinds import CellKinds, only_text
from kalscope.sources.layout.rows.shapes import HeadLine
from kalscope.sources.layout.rows.tables import MIN_TEXT_SHARE, HeadTable

MIN_SHARE = 0.15
"""Of the lines of the head, the share that must look like data: boot text may outweigh a short log."""
CLOSE = 0.9
"""A second way with at least this share of the best score could be meant as well."""
TABS = 0.75
"""Rows split at tabs are chosen with at least this share of the score of rows split at blanks."""
_MIN_ALIKE = 8
_SOME = 64
"""Rows by which one column is judged."""


def weigh(lines: list[HeadLine], tables: list[HeadTable]) -> tuple[HeadTable | None, HeadTable | None]:
    """(best, close second) of the ways to split the lines; None where no way makes enough of them look like data.

    The second is a way that gives other rows than the best, with nearly its score.
    """
    found = [table for table in tables if table.score >= MIN_SHARE or _all_alike(lines, table)]
    tabs = max((table.score for table in found if table.form.delimiter == "\t"), default=0.0)
    # Where tabs split the rows, blanks are inside the cells: of a stamp, of a text.
    found = [table for table in found if table.form.delimiter != " " or TABS * table.score > tabs]
    ranked = sorted(found, key=lambda table: _rank(lines, table), reverse=True)
    if not ranked:
        return None, None
    best = ranked[0]
    close = (table for table in ranked[1:] if _likely(lines, table) >= CLOSE * _score(lines, best))
    return best, next((table for table in close if _differs(best, table)), None)


def _all_alike(lines: list[HeadLine], table: HeadTable) -> bool:
    """True for a wide table of mostly text: nearly all lines are rows whose cells are of one kind per column."""
    if table.score < MIN_TEXT_SHARE or len(table.rows) < max(_MIN_ALIKE, len(lines) / 2) or table.width < 4:
        return False
    return _consistency(table) > 0.9


def _consistency(table: HeadTable) -> float:
    """Mean share of the commonest kind among the cells of a column that are not missing, 0…1."""
    kinds = CellKinds(table.form.decimal)
    shares: list[float] = []
    for i in range(table.width):
        found = Counter(kinds[cells[i]] for _, cells in table.rows)
        said = sum(found.values()) - found["missing"] - found["word"]
        commonest = max((found[kind] for kind in found if kind not in ("missing", "word")), default=0)
        shares.append(commonest / said if said else 1.0)
    return sum(shares) / len(shares)


def _score(lines: list[HeadLine], table: HeadTable) -> float:
    if table.form.decimal == "," and table.width == 1 and not _names_fit(lines, table) and not _is_padded(table):
        # Any "12,5" is one number as well as two: the header must decide for the one.
        return table.score / 2
    return table.score


def _likely(lines: list[HeadLine], table: HeadTable) -> float:
    """The score by which a second is close: of `1.013,25` alone on each line, that of one whole number."""
    return table.score if _is_grouped(table) else _score(lines, table)


def _is_grouped(table: HeadTable) -> bool:
    """True for one column of numbers, some of them with thousands separators: `990,00` and `1.013,25`."""
    if table.width != 1 or table.form.kind != "table":
        return False
    some = [cells[0] for _, cells in table.rows[:: max(1, len(table.rows) // _SOME)]]
    form = NumberForm(table.form.decimal, thousands=True)
    return all(map(form.fits, some)) and any(is_grouped(cell) and "." in cell and "," in cell for cell in some)


def _is_padded(table: HeadTable) -> bool:
    """True for one column of such numbers where the digits after a mark show that it does not split two cells.

    No cell of its own would be written like the 05 of `1.013,05` or the 013.25 of `1,013.25`.
    """
    if not _is_grouped(table):
        return False
    parts = [cells[0].split(",") for _, cells in table.rows]
    return any(part[:1] == "0" and part[1:2].isdecimal() for _, *after in parts for part in after)


def _rank(lines: list[HeadLine], table: HeadTable) -> tuple[float, bool, bool, bool, bool]:
    """The score; among equals Teleplot, the one whose header has as many cells, the one with the decimal point.

    Numbers with thousands separators come before the cells that they could be.
    """
    fits = _names_fit(lines, table)
    score, teleplot = round(_score(lines, table), 6), table.form.kind == "teleplot"
    return score, teleplot, fits, _is_padded(table), table.form.decimal == "."


def _names_fit(lines: list[HeadLine], table: HeadTable) -> bool:
    """True where the line above the first row holds one name per column."""
    above = [line for line in lines if line.number < table.rows[0][0]]
    if not above or table.form.kind != "table":
        return False
    cells = split_fields(above[-1].text, table.form.delimiter)
    whole = table.form.decimal != "," or not any("," in cell for cell in cells)
    width = table.width
    while width > 1 and len(cells) < width and not any(row[width - 1] for _, row in table.rows):
        width -= 1  # a separator at the end of each row
    return whole and only_text(cells, table.form.decimal) and len(cells) == width


def _differs(best: HeadTable, other: HeadTable) -> bool:
    """True where another way gives other rows, not the same ones by another mark."""
    if best.form.kind != "table" or other.form.kind != "table":
        return False
    return best.width != other.width or [cells for _, cells in best.rows] != [cells for _, cells in other.rows]
