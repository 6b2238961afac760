"""What each cell of the head looks like, and what a column of such cells holds. Pure functions on cells."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from kalscope.sources.grammar.cells import (
    MISSING,
    MISSING_WORDS,
    NUMBER,
    OTHER_MARK,
    OVERFLOWS,
    NumberForm,
    is_grouped,
    split_measure,
)
from kalscope.sources.grammar.stamps.shapes import is_stamp
from kalscope.sources.grammar.units import is_measure
from kalscope.sources.layout.rows.shapes import ANY_DIGIT

Cells = tuple[str, ...]
CellKind = Literal["number", "other number", "grouped", "measure", "missing", "word", "stamp", "text"]
"""A plain number, one with the other decimal mark, one with possible thousands separators, one with its unit, an
ordinary missing value, a word that loggers write for one, a stamp, anything else."""

NUMERIC: tuple[CellKind, ...] = ("number", "other number", "grouped", "measure")
"""The kinds that are numbers."""

_NUMERIC_CHARACTERS = "0123456789.,+-eE;| \t"
_MIN_SHAPE, _MIN_JUDGED = 8, 3
"""Characters from which the shape of a cell shows a stamp, and how many cells of the shape must agree."""
_MIN_REPEATED = 3
"""How often the one word of an otherwise numeric column must occur to mean "no sample"."""


class CellKinds(dict[str, CellKind]):
    """The kind of each cell; a repeated cell is judged once."""

    def __init__(self, decimal: str, words: Iterable[str] = (), delimiter: str = "") -> None:
        """Args: decimal mark of the table, more texts, in lower case, that say "no sample", and the delimiter."""
        super().__init__()
        self.decimal = decimal
        # In the quotes of a comma file "1,234" may be either.
        self._quoted = decimal == delimiter
        self._words = MISSING_WORDS.union(OVERFLOWS, words)
        self._shapes: dict[str, int] = {}

    def __missing__(self, cell: str) -> CellKind:
        kind = self[cell] = self._judge(cell)
        return kind

    def _judge(self, cell: str) -> CellKind:
        if cell.lower() in MISSING:
            return "missing"
        if NUMBER[self.decimal].fullmatch(cell):
            return "grouped" if self._quoted and is_grouped(cell) else "number"
        if cell.lower() in self._words:
            return "word"
        # Most other cells of a log are several numbers, split at the wrong mark.
        is_listed = not cell.strip(_NUMERIC_CHARACTERS) and any(mark in cell for mark in ",;|\t")
        return "stamp" if not is_listed and self._is_stamp(cell) else _odd_kind(cell, self.decimal)

    def _is_stamp(self, cell: str) -> bool:
        """Whether a cell is a stamp; cells that differ in their digits only are judged by the first few."""
        shape = cell.translate(ANY_DIGIT)
        if len(cell) < _MIN_SHAPE or len(cell) - shape.count("0") < 2:
            return is_stamp(cell)  # 12.50 may be a clock, 99.50 is not
        known = self._shapes.get(shape, 0)
        if abs(known) >= _MIN_JUDGED:
            return known > 0
        found = is_stamp(cell)
        self._shapes[shape] = known + (1 if found else -1)
        return found


def _odd_kind(cell: str, decimal: str) -> CellKind:
    """The kind of a cell that is not a plain number, a missing value or a stamp."""
    if is_grouped(cell):
        return "grouped"
    if NUMBER[OTHER_MARK[decimal]].fullmatch(cell):
        return "other number"
    measure = split_measure(cell)
    return "measure" if measure is not None and is_measure(measure[1]) else "text"


def only_text(cells: Sequence[str], decimal: str) -> bool:
    """True where no cell is a number, a stamp or a missing value, and there are cells at all."""
    kinds = CellKinds(decimal)
    return any(cells) and all(not cell or kinds[cell] not in ("number", "stamp", "missing") for cell in cells)


def likeness(cells: Cells, kinds: CellKinds) -> float:
    """Share of the cells that a data line may hold, 0…1; 0 where none is a number."""
    found = [kinds[cell] for cell in cells]
    numbers = float(found.count("number"))
    if "text" not in found or not any(" " in cell for cell in cells):  # "outside 21 °C, wind 3 m/s" is prose
        numbers += found.count("measure")
    if len(cells) == 1 and found[0] == "grouped":
        numbers += "." in cells[0] and "," in cells[0]
    if len(cells) > 1:  # one `12,5` alone is two numbers, or one by the other mark
        numbers += 0.25 * found.count("other number") + 0.5 * found.count("grouped")
    if not numbers:
        return 0.0
    others = found.count("missing") + found.count("word") + found.count("stamp")
    return (numbers + others) / len(cells)


@dataclass(frozen=True)
class ColumnType:
    """What most cells of a column hold."""

    kind: Literal["number", "stamp", "text", "empty"]
    """The majority among the cells that are not missing; "empty" where all are."""
    share: float
    """Share of the cells that are not missing and are of that kind."""
    numbers: int = 0
    """How many of its cells are numbers, of whatever form."""
    measured: bool = False
    """True where most of the numbers are followed by their unit."""
    words: frozenset[str] = frozenset()
    """The one text, in lower case, that an otherwise numeric column repeats: it says "no sample"."""

    def suits(self, other: ColumnType) -> bool:
        """True where both may be parts of one column."""
        return "empty" in (self.kind, other.kind) or self.kind == other.kind

    def judge(self, cell: str, kinds: CellKinds) -> Literal["fits", "missing", "strange"]:
        """Whether a cell may be in this column; in one of text any cell is "missing", because it tells nothing."""
        kind = kinds[cell]
        if kind in ("missing", "word") or cell.lower() in self.words:
            return "missing"
        if self.kind in ("text", "empty"):
            return "missing"
        if kind == "measure" and not self.measured:
            return "strange"  # `5V` above numbers is a name
        is_number = kind in NUMERIC
        return "fits" if is_number == (self.kind == "number") and kind != "text" else "strange"


def column_type(cells: Sequence[str], kinds: CellKinds) -> ColumnType:
    """What a column holds, by its cells."""
    counts = Counter(kinds[cell] for cell in cells)
    numbers = sum(counts[kind] for kind in NUMERIC)
    measured = counts["measure"] > numbers / 2
    stamps, texts = counts["stamp"], counts["text"]
    total = numbers + stamps + texts
    if not total:
        return ColumnType("empty", 1.0)
    if numbers >= _MIN_REPEATED and texts >= _MIN_REPEATED and not stamps:
        said = {cell.lower() for cell in cells if kinds[cell] == "text"}
        if len(said) == 1:
            return ColumnType("number", 1.0, numbers, measured, frozenset(said))
    if numbers >= max(stamps, texts):
        return ColumnType("number", numbers / total, numbers, measured)
    if stamps >= texts:
        return ColumnType("stamp", stamps / total, numbers)
    return ColumnType("text", texts / total, numbers)


def number_form(
    cells: Sequence[str], kinds: CellKinds, wanted: str | None = None
) -> tuple[NumberForm, NumberForm | None]:
    """How the numbers of a column are written, and how else they could be; None where nothing else fits.

    The decimal mark is that of the table where that fits as many cells as any other; `wanted`, the user's choice,
    outranks it.
    """
    marks = Counter(kinds[cell] for cell in cells)
    plain = NumberForm(wanted or kinds.decimal)
    odd = marks["other number"] + marks["grouped"] + marks["measure"]
    if not odd and plain.decimal == kinds.decimal:
        return plain, None
    suffix = _common_suffix([cell for cell in cells if kinds[cell] == "measure"])
    numeric = [cell for cell in cells if kinds[cell] in NUMERIC]
    measures = replace(plain, suffix=suffix)
    if odd == marks["measure"] and all(map(measures.fits, numeric)):
        return measures, None  # 20.271C is no more in doubt than 20.271
    bases = [wanted] if wanted else [kinds.decimal, OTHER_MARK[kinds.decimal]]
    forms = [NumberForm(mark, grouped, suffix) for grouped in (False, True) for mark in bases]
    counts = {form: sum(map(form.fits, numeric)) for form in forms}
    best = max(forms, key=lambda form: counts[form])
    if best.decimal != kinds.decimal and not best.thousands and not wanted:
        # "1,234" above "2,345": English thousands rather than decimal commas.
        grouped = NumberForm(kinds.decimal, thousands=True, suffix=suffix)
        best = grouped if counts[grouped] == counts[best] else best
    rivals = [
        form for form in forms if counts[form] == counts[best] and any(differ(form, best, cell) for cell in numeric)
    ]
    return best, next(iter(rivals), None)


def differ(form: NumberForm, rival: NumberForm, cell: str) -> bool:
    """True where both forms read a cell, and read different numbers."""
    both = form.fits(cell) and rival.fits(cell)
    return both and None not in (read := (form.parse(cell), rival.parse(cell))) and read[0] != read[1]


def _common_suffix(measures: list[str]) -> str:
    """The unit after most of the numbers; "" where there is none."""
    found = Counter(parts[1] for cell in measures if (parts := split_measure(cell)))
    return found.most_common(1)[0][0] if found else ""
