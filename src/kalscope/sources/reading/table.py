"""How the first lines of a log could be split into rows, which way is best, and where the table starts."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import groupby
from typing import Literal, NamedTuple

from kalscope.sources.grammar.cells import are_units, is_blank, is_comment, is_number, parse_number, split_fields
from kalscope.sources.grammar.line_format import LineFormat, find_pairs, split_checksum, split_stamp, split_teleplot
from kalscope.sources.grammar.read_options import DELIMITERS
from kalscope.sources.reading.columns import (
    NUMERIC,
    CellKinds,
    Cells,
    ColumnType,
    HeadLine,
    Plan,
    column_type,
    first_of_each_shape,
    head_line,
    likeness,
    only_text,
)

# Where the table starts, what its columns hold, and what is above and beside it.


MAX_HEADER_LINES = 5
"""Lines of names, units and what was done to each column that may be above a table."""
_WAYS = [re.compile(pattern) for pattern in (",", r"[ \t]+(?![\[(])", r"[ \t]{2,}|\t")]
"""How names above columns that blanks separate may be: at commas, with units in brackets, at wide gaps."""
_MAX_NAME = 40
"""A longer single cell above a column of numbers is a sentence."""

Row = tuple[int, Cells]
"""Line number, from 1, and the cells of a line."""

Fit = Literal["row", "partial", "void", "text"]
"""All cells of a line suit their columns; some do; all are missing; none does, which is how names look."""


@dataclass(frozen=True)
class HeadTable:
    """The data lines of the head, and of the samples from further down, split in one of the possible ways."""

    score: float
    """Share of the cells of all lines that look like those of one table, 0…1."""
    form: LineFormat
    """How they were split."""
    width: int
    """Cells of a row."""
    rows: tuple[Row, ...]
    """(line number, cells) of the lines that look like data, of `width` cells each."""
    narrow: frozenset[int] = frozenset()
    """Widths of rows that lack their last cells: a later version of the logger added these."""

    @property
    def least(self) -> int:
        """Fewest cells of a whole row: those after the last column that is ever filled may be left out."""
        filled = (width for width in range(self.width, 1, -1) if any(cells[width - 1] for _, cells in self.rows))
        return next(filled, 1)


@dataclass(frozen=True)
class Body:
    """The rows of a table, and the lines above it."""

    rows: tuple[Row, ...]
    """(line number, cells) of the rows that look like data; those of the samples have numbers beyond the head."""
    first: int
    """Line number of the first row."""
    above: tuple[Row, ...]
    """(line number, cells) of lines of text right above the first row, nearest first."""
    types: tuple[ColumnType, ...]
    """What each column holds."""
    beside: frozenset[int]
    """Columns that are filled in the first rows only: metadata beside the data."""


def find_body(head: Sequence[str], lines: list[HeadLine], table: HeadTable, plan: Plan, kinds: CellKinds) -> Body:
    """The rows of a table among the lines of a file.

    Args:
        head: The first lines of the file.
        lines: The lines that may hold data.
        table: How they are split.
        plan: What is decided already.
        kinds: The kinds of cells by the table's decimal mark.
    """
    rows = [row for row in table.rows if row[0] >= plan.preface.first_row] or list(table.rows)
    beside, types = _beside(rows, table.width, kinds), _types(rows, table.width, kinds)
    body = Body(tuple(rows), rows[0][0], (), types, beside)
    if table.form.kind != "table":
        return body
    grid = _Grid(lines, table, body, kinds)
    first = grid.first_row(plan.preface.first_row)
    whole = tuple(grid.rows_from(first) or table.rows[:1])
    types = types if whole == body.rows else _types(whole, table.width, kinds)
    return Body(whole, first, grid.above(first, head), types, beside)


def _types(rows: Sequence[Row], width: int, kinds: CellKinds) -> tuple[ColumnType, ...]:
    return tuple(column_type([cells[i] for _, cells in rows], kinds) for i in range(width))


def _beside(rows: Sequence[Row], width: int, kinds: CellKinds) -> frozenset[int]:
    """Columns of labels and values that are in some of the first rows only, and empty ones up to the data."""
    last = [max((place for place, (_, cells) in enumerate(rows) if cells[i]), default=-1) for i in range(width)]
    brief = [0 <= place < min(64, len(rows) / 2) for place in last]
    beside: set[int] = set()
    for i in range(width - 1 if len(rows) >= 16 else 0):
        if brief[i] and brief[i + 1] and any(kinds[cells[i]] == "text" for _, cells in rows):
            beside |= {i, i + 1}
    end = max(beside, default=-1) + 1
    while 0 < end < width and last[end] < 0:
        end += 1
    return frozenset(beside | {i for i in range(end) if last[i] < 0})


class _Line(NamedTuple):
    """One line of a file, split and compared with the columns of the table."""

    number: int
    text: str
    cells: Cells
    fit: Fit | None


class _Grid:
    """The lines of a file, each split and compared with the columns of the table."""

    def __init__(self, lines: list[HeadLine], table: HeadTable, body: Body, kinds: CellKinds) -> None:
        self._kinds, self._types, self._beside = kinds, body.types, body.beside
        self._table, self._least = table, table.least
        self._stamps = [*(kind.kind == "stamp" for kind in body.types), False].index(False)
        self._lines: list[_Line] = []
        known, fits = {} if table.narrow else dict(table.rows), dict[str, Fit | None]()
        for line in lines:
            cells = known.get(line.number) or tuple(split_fields(line.text, table.form.delimiter))
            fit = fits.get(line.shape) or self._fit(cells)
            if fit == "row":  # a line of the shape of a whole row is one as well
                fits[line.shape] = fit
            self._lines.append(_Line(line.number, line.text, cells, fit))

    def _fit(self, cells: Cells) -> Fit | None:
        """How a line suits the columns; None where it has too few or too many cells."""
        width = len(cells)
        if not (self._least <= width <= self._table.width or width in self._table.narrow):
            return None
        inside = [(self._types[i], cell) for i, cell in enumerate(cells) if i not in self._beside]
        judged = [(kind.judge(cell, self._kinds), cell) for kind, cell in inside]
        strange = sum(how == "strange" for how, _ in judged)
        if any(how == "fits" for how, _ in judged):
            return "partial" if strange else "row"
        known = sum(how == "missing" and cell != "" and self._kinds[cell] != "text" for how, cell in judged)
        # "-,-,ERR" is a row of missing samples, "t,M" are names.
        return "void" if known > strange else "text"

    def first_row(self, least: int) -> int:
        """Line number of the first row, from line `least` on.

        A line of names below others that are not whole rows begins the table: above it is metadata.
        """
        lines = [line for line in self._lines if line.number >= least]
        best, gained, whole, other = 0, 0, 0, 0
        few = 0.2 * sum(line.fit == "row" for line in lines)  # another table above the names, of calibration
        for i, line in enumerate(lines):
            heads = any(row.fit == "row" for row in lines[i + 1 : i + 1 + MAX_HEADER_LINES])
            if heads and line.fit == "text" and len(line.cells) >= self._least:
                if other - 2 * whole > gained:
                    best, gained = i + 1, other - 2 * whole
                elif 0 < whole <= few and self._begins_anew(line, lines[:i], lines[i:]):
                    best = i + 1
            whole += line.fit == "row"
            other += line.fit == "partial"
        data = [i for i, line in enumerate(lines) if i >= best and line.fit in ("row", "partial")]
        if not data:
            return self._table.rows[0][0]
        whole = next((i for i in data if lines[i].fit == "row"), data[0])
        # A word that repeats at once is no names and no label, but ERR in place of a sample.
        texts = [line.text if line.fit == "text" else self._label_of(line) for line in lines[: whole + 1]]
        names = {i for i in range(best, whole) if lines[i].fit == "text" and len({*lines[i].cells}) > 1}
        once = {i for i in range(best, whole) if texts[i] and texts[i] not in (texts[i - 1], texts[i + 1])}
        above = names | once
        start = max(above, default=best - 1) + 1
        return next(line.number for line in lines[start:] if line.fit is not None)

    def _label_of(self, line: _Line) -> str:
        """Text above numbers, `Sample rate,100`, or names beside a stamp, `08:30:05 CPU %user %nice`; else ""."""
        judged, first = zip(self._types, line.cells, strict=False), line.cells[0]
        texts = {cell for kind, cell in judged if kind.judge(cell, self._kinds) == "strange"}
        named = len(texts) > max(1, sum(self._kinds[cell] in NUMERIC for cell in line.cells))
        return first if line.fit == "partial" and (named or (first in texts and first[0].isalpha())) else ""

    def _begins_anew(self, line: _Line, above: Sequence[_Line], below: Sequence[_Line]) -> bool:
        """True for names that differ from those above, below an empty line or one that is not of the table.

        The first column of one table goes on below as it rose above: its lines of text are not names.
        """
        parted = above and (above[-1].fit in (None, "text") or above[-1].number < line.number - 1)
        distinct = len(set(line.cells)) == len(line.cells) and all(self._kinds[c] != "word" for c in line.cells)
        if not parted or not distinct or any(line.cells == other.cells for other in above):
            return False
        rows = [*[row for row in above if row.fit == "row"][-2:], next(row for row in below if row.fit == "row")]
        near = [parse_number(row.cells[0], self._table.form.decimal) for row in rows]
        before, last, after = (math.nan if number is None else number for number in (math.nan, *near)[-3:])
        return not before < last < after <= last + 3 * (last - before)

    def rows_from(self, first: int) -> list[Row]:
        """(line number, cells) of the rows from line `first` on, each padded to the width of the table."""
        lines = [line for line in self._lines if line.number >= first and line.fit in ("row", "partial", "void")]
        return [(line.number, line.cells + ("",) * (self._table.width - len(line.cells))) for line in lines]

    def above(self, first: int, head: Sequence[str]) -> tuple[Row, ...]:
        """(line number, cells) of the lines above the first row that may name its columns, nearest first.

        Comments are prose more often than names: only the nearest count, and below other names only units.
        """
        lines = [line for line in self._lines if line.number < first][-MAX_HEADER_LINES:]
        below = len(lines) > 1 and lines[-1].fit is None and len(lines[-1].cells) == 1
        if below and len(lines[-2].cells) in (self._table.width, self._table.width - self._stamps):
            lines.pop()  # `Step Information: R=1K` below the names, or the name of the index of pandas
        plain = {line.number: line.text for line in lines}
        remarks = {i: text for i, text in enumerate(head[: first - 1], 1) if is_comment(text)}
        found, closed = list[Row](), set[bool]()
        for number, text in sorted((plain | remarks).items(), reverse=True):
            is_remark = number in remarks
            cells = self._beside_names(header_cells(text, self._table.form.delimiter, self._least))
            if is_remark in closed or self._is_ruled(text, cells):
                continue
            is_aligned = self._table.form.delimiter == " " and not is_remark and not found
            if is_aligned and len(cells) < self._least and are_units(cells):
                continue  # above some of the columns, nobody knows which
            if self._are_listed(cells) if is_remark else self._may_name(cells):
                found.append((number, cells))
            else:
                closed.add(is_remark)
        if any(number in plain and not are_units(cells) for number, cells in found):
            found = [row for row in found if row[0] in plain or are_units(row[1])]
        widths = [len(line.cells) for line in lines if not self._is_ruled(line.text, line.cells)]
        if found and found[0][0] in plain and len(found[0][1]) < self._least and widths.count(len(found[0][1])) > 1:
            return ()  # `Gain;24` above `Site;Barn 7` are pairs, not names
        return tuple(found)

    def _is_ruled(self, text: str, cells: Cells) -> bool:
        return not set(text) - set("-=_+|:;,#%/ \t") and not (len(cells) > 1 and are_units(cells))

    def _beside_names(self, cells: Cells) -> Cells:
        """The cells without a stamp that begins a line of names, and without settings above empty columns."""
        kinds = [kind.kind for kind in self._types] if len(cells) == self._table.width else []
        data = {"stamp": ("stamp",), "empty": ("number", "stamp")}
        found = (self._kinds[cell] in data.get(kind, ()) for cell, kind in zip(cells, kinds, strict=False))
        return (
            tuple("" if is_data else cell for is_data, cell in zip(found, cells, strict=True)) if kinds else cells
        )

    def _are_listed(self, cells: Cells) -> bool:
        """True for a comment that is a list of names, as `# time ax ay` of numpy.savetxt, not a sentence."""
        width, names = self._table.width, cells[: max((i for i, cell in enumerate(cells, 1) if cell), default=0)]
        is_full = len(names) <= width and all(kind.kind == "empty" for kind in self._types[len(names) :])
        numeric = any(self._kinds[name] in ("number", "stamp", "missing") for name in names)
        are_names = len(names) > 0 and is_full and not numeric and all(map(_is_name, names))
        return width > 1 and (are_names or (len(cells) == width and are_units(cells)))

    def _may_name(self, cells: Cells) -> bool:
        """True for text in about as many cells as a row has."""
        width = self._table.width
        if width == 1:
            fits = len(cells) == 1 and len(cells[0]) <= _MAX_NAME
        else:
            # Split at blanks, any sentence has several cells.
            prose = self._table.form.delimiter == " "
            low, high = (
                (self._least - max(1, self._stamps), width)
                if prose
                else (self._least - self._least // 2, 2 * width)
            )
            fits = max(2, low) <= len(cells) <= high and not (prose and cells[-1].endswith((".", ":")))
        numeric = any(self._kinds[cell] in ("number", "stamp") for cell in cells if cell)
        is_setting = cells[0].endswith(("=", ":")) or (len(cells) == 2 and self._kinds[cells[1]] == "measure")
        return fits and any(cells) and not numeric and not is_setting


def _is_name(text: str) -> bool:
    """A few words, perhaps with their unit in brackets or after a comma: not a sentence."""
    bare = text.partition("[")[0].partition("(")[0].strip()
    short = 0 < len(bare) <= _MAX_NAME and len(bare.split()) <= 3
    return short and not bare.endswith(":") and not any(mark in bare for mark in "\t;|")


def header_cells(text: str, delimiter: str, width: int) -> Cells:
    """The cells of a line above `width` columns, a comment or not; in `#,level,flow` the mark is a name itself.

    Names of columns that blanks separate may be separated otherwise: `t [us]   torque`, `Air Temp  Rel Hum`. Names
    above tabs may be as well.
    """
    cells = tuple(split_fields(text.rstrip(" |") if delimiter == " " else text, delimiter))
    if is_comment(text) and (delimiter == " " or next(filter(None, cells)).strip("#%/")):
        text = text.strip().lstrip("#%/").strip()
        cells = tuple(split_fields(text, delimiter))
    if len(cells) in (width, 0) or (delimiter != " " and (delimiter != "\t" or len(cells) > 1)):
        return cells
    ways = (tuple(cell.strip() for cell in way.split(text.strip())) for way in _WAYS)
    return next((found for found in ways if len(found) == width), cells)


# The ways in which the first lines of a log could be split into rows, each weighed by how its cells look.
#
# Pure functions on text.


_MAX_CELLS = 4096
"""A line of more cells is not a row of any table."""
_BEGIN = re.compile(
    r"[\W_]*(?:(?:begin|start)(?: of)?[ _]?)?"
    r"(?:data|end[ _]?of[ _]?header|end[ _]header|(?<=\*)end|(?<=# )columns: [0-9]+)[\W_]*",
    re.IGNORECASE,
)
SCALE = re.compile(r"[ \t]{0,8}(1\.0e[+-][0-9]{2}) \*[ \t]{0,8}")
"""The common factor that MATLAB prints above a matrix."""
MIN_TOPIC = 4
"""Lines of a topic by which it is a channel; of another label a tenth of the lines."""


def marked_begin(head: Sequence[str]) -> int:
    """Line number of `*END*`, `[Data]`, `@data`, below which a table begins; 0 where no line says so.

    There must be more lines with digits below it than above.
    """
    marks = [i for i, line in enumerate(head[:2000], 1) if len(line) < 40 and _BEGIN.fullmatch(line)]
    if not marks:
        return 0
    digits = [any(c.isdecimal() for c in line) and not is_comment(line) for line in head]
    return next((i for i in reversed(marks) if sum(digits[i:]) >= max(3, sum(digits[:i]))), 0)


def best_table(
    head: Sequence[str], samples: Sequence[str], plan: Plan
) -> tuple[list[HeadLine], HeadTable | None, HeadTable | None]:
    """The lines that may hold data, the best way to split them, None where there is none, and a close second.

    Args:
        head: The first lines of the file.
        samples: Those from further down.
        plan: What is decided already.
    """
    lines, marks = candidate_lines([*head, "", *samples], marked_begin(head))
    best, second = weigh(lines, candidate_tables(lines, plan))
    if best is not None:
        best = replace(best, form=replace(best.form, stamped=marks.stamped, checksum=marks.checksum))
    return lines, best, second


def candidate_lines(head: Sequence[str], after: int = 0) -> tuple[list[HeadLine], LineFormat]:
    """Lines that may hold data; stamp and checksum split off where most lines have one, which the form says.

    Args:
        head: The first lines, and those from further down.
        after: Line number above the first that may hold data.
    """
    texts = enumerate(head[after:], after + 1)
    lines = [head_line(i, s) for i, s in texts if not (is_blank(s) or is_comment(s) or SCALE.fullmatch(s))]
    some = first_of_each_shape(lines)
    stamped = {shape for shape, texts in some.items() if split_stamp(texts[0])}
    is_stamped = sum(line.shape in stamped for line in lines) > len(lines) / 2
    split = [(line, split_stamp(line.text)) for line in lines] if is_stamped else []
    stamps = {parts[0] for _, parts in split if parts is not None}
    is_stamped = len(stamps) > 1 or len(split) == 1  # the 64 of `64 bytes from 10.0.0.1: time=12 ms` is none
    if is_stamped:
        lines = [head_line(line.number, parts[1], parts[0]) for line, parts in split if parts is not None]
    sums = [(line, split_checksum(line.text)) for line in lines]
    right = {line.number for line, parts in sums if parts and parts[1] == parts[2]}
    checked = len(right) > len(lines) / 2
    if checked:  # a header has no checksum; others lines without it were damaged
        kept = [pair for pair in sums if pair[0].number in right or not any(map(str.isdigit, pair[0].text))]
        lines = [head_line(line.number, parts[0] if parts else line.text, line.stamp) for line, parts in kept]
    return lines, LineFormat(stamped=is_stamped, checksum=checked)


def candidate_tables(lines: list[HeadLine], plan: Plan) -> list[HeadTable]:
    """Every way to split the lines of a head, each with a score of how much they look like data."""
    some = first_of_each_shape(lines)
    candidates = [] if plan.options.delimiter else [_teleplot(lines), _labelled(lines, some, plan)]
    kinds = {mark: CellKinds(mark, plan.options.missing_texts) for mark in ".,"}
    for delimiter in (plan.options.delimiter,) if plan.options.delimiter else _delimiters(some):
        split = _splitter(delimiter)
        for decimal in plan.options.decimal or ".,":
            form = LineFormat("table", delimiter, decimal)
            if decimal != delimiter:
                candidates.append(_as_table(lines, some, split, form, kinds[decimal]))
            elif any('"' in shape for shape in some):  # decimal commas inside the quotes of a comma file
                quoted = CellKinds(decimal, plan.options.missing_texts, delimiter)
                candidates.append(_as_table(lines, some, split, form, quoted))
    return [table for table in candidates if table is not None]


def _delimiters(some: Mapping[str, Sequence[str]]) -> list[str]:
    """The delimiters between two cells of a line, and one that is in none: a line may be a single number."""
    found = {mark for shape in some for mark in DELIMITERS if mark in shape.strip(" ")}
    found |= {" "} if "\t" in found else set()
    found.update([mark for mark in DELIMITERS if mark not in found][:1])
    return [mark for mark in DELIMITERS if mark in found]


def _splitter(delimiter: str) -> Callable[[str], Cells]:
    """Splits lines at a delimiter, each once; one of thousands of cells is not a row and is not split."""

    @cache
    def split(text: str) -> Cells:
        is_endless = len(text) > _MAX_CELLS and text.count(delimiter) > _MAX_CELLS
        return (text,) if is_endless else tuple(split_fields(text, delimiter))

    return split


def _as_table(
    lines: list[HeadLine],
    some: Mapping[str, Sequence[str]],
    split: Callable[[str], Cells],
    form: LineFormat,
    kinds: CellKinds,
) -> HeadTable | None:
    """The lines of the commonest width, weighed by how much they look like data."""
    shares = {shape: [likeness(split(text), kinds) for text in texts] for shape, texts in some.items()}
    likely = {shape: sum(found) / len(found) for shape, found in shares.items()}
    # Quotes and delimiters are the same in all lines of a shape.
    widths = {shape: len(split(texts[0])) for shape, texts in some.items()}
    weight: Counter[int] = Counter()
    for line in lines:
        weight[widths[line.shape]] += likely[line.shape]  # type: ignore[assignment]
    width = max(weight, key=lambda width: weight[width], default=0)
    if not width or weight[width] < 0.04 * len(lines):  # in a table of mostly text few cells are data
        return None
    rows = [(line.number, split(line.text)) for line in lines if likely[line.shape]]
    above = ((line.number, split(line.text)) for line in reversed(lines))
    width, narrow = _grown_width(rows, above, width, kinds)
    total = sum(weight[w] for w in (width, *narrow))
    if len(lines) >= 20 and total < 0.6 * sum(weight.values()):  # records of several lines are not a table
        return None
    rows = [(n, cells + ("",) * (width - len(cells))) for n, cells in rows if len(cells) in (width, *narrow)]
    return HeadTable(total / len(lines), form, width, tuple(rows), narrow)


def _grown_width(rows: list[Row], above: Iterable[Row], width: int, kinds: CellKinds) -> tuple[int, frozenset[int]]:
    """The width of the rows, and the smaller widths of those that lack a field which the logger added later.

    `width` is the commonest. Several rows of the other width follow each other, hold the same in each column, and
    have no names of their own.

    Args:
        rows: The lines that look like data.
        above: All lines, the last first.
        width: The commonest width.
        kinds: The kinds of cells.
    """
    runs = [list(run) for _, run in groupby(rows, key=lambda row: len(row[1]))]
    runs = [run for run in runs if len(run) >= 3 and len(run[0][1]) > 1]  # fewer are damage
    begin = runs[0][1][0] if runs else 0  # `Gain,24` above the names may look like the first row of the first run
    texts = (cells for number, cells in above if number < begin and only_text(cells, kinds.decimal))
    named = len(next(texts, ()))
    long: dict[int, list[Row]] = {}
    for run in runs:
        long.setdefault(len(run[0][1]), []).extend(run[:500])
    if rows and width < named == len(rows[0][1]):
        long.setdefault(named, rows[:1])  # it alone holds what is the same in all: a serial number
    if len(long) < 2 or width not in long:
        return width, frozenset()
    types, widest = {w: _types(some, w, kinds) for w, some in long.items()}, max(long)
    narrow = {w for w in {*long} - {widest, named} if all(map(ColumnType.suits, types[widest], types[w]))}
    return (widest, frozenset(narrow)) if width in {widest, *narrow} else (width, frozenset())


def _labelled(lines: list[HeadLine], some: Mapping[str, Sequence[str]], plan: Plan) -> HeadTable | None:
    """The lines of `name:value` pairs whose names come often and with numbers."""
    shapes = {shape for shape, texts in some.items() if any(map(find_pairs, texts))}
    labelled = ((line.number, find_pairs(line.text)) for line in lines if line.shape in shapes)
    pairs = [(number, dict(found)) for number, found in labelled if found]
    kinds = CellKinds(".", plan.options.missing_texts)
    values = Counter(label for _, found in pairs for label in found if kinds[found[label]] in (*NUMERIC, "stamp"))
    # Topics of MQTT have rates of their own.
    least = min(
        0.1 * len(pairs), MIN_TOPIC if all("/" in label for _, found in pairs for label in found) else math.inf
    )
    numeric = {label for label, n in values.items() if n >= least}
    # A text beside numbers, "status", is a column; lines of texts alone are the program's log.
    beside = Counter(label for _, found in pairs if found.keys() & numeric for label in found)
    labels = tuple(label for label, n in beside.items() if n >= least)
    kept = ((n, found) for n, found in pairs if found.keys() & numeric and found.keys() <= set(labels))
    cells = ((n, tuple(found.get(label, "") for label in labels)) for n, found in kept)
    rows = tuple(row for row in cells if any(kinds[cell] in NUMERIC for cell in row[1]))
    if not rows:
        return None
    whole = sum(found.keys() >= set(labels) for _, found in pairs)
    complete = len(rows) >= 20 and whole >= 0.95 * len(rows)  # then the others are damaged
    form = LineFormat("labels", labels=labels, complete=complete)
    return HeadTable(len(rows) / len(lines), form, len(labels), rows)


def _teleplot(lines: list[HeadLine]) -> HeadTable | None:
    """The lines `>name:ms:value§unit`; other lines beside them are the program's log and do not count."""
    marked = [line for line in lines if line.text.lstrip().startswith(">")]
    plots = ((line.number, split_teleplot(line.text)) for line in marked)
    found = [(n, plot) for n, plot in plots if plot and any(is_number(value) for _, value in plot.samples)]
    if not found:
        return None
    labels = tuple(dict.fromkeys(plot.name for _, plot in found))
    timed = any(stamp for _, plot in found for stamp, _ in plot.samples)
    held = ((n, plot.name, *sample) for n, plot in found for sample in plot.samples)
    named = ((n, stamp, tuple(value if one == name else "" for one in labels)) for n, name, stamp, value in held)
    rows = tuple((n, (stamp, *cells) if timed else cells) for n, stamp, cells in named)
    form = LineFormat("teleplot", ",", ".", labels)
    return HeadTable(len(found) / len(marked), form, len(labels) + timed, rows)


# Which of the ways to split a log is the best, and which other one comes close. Pure functions.


MIN_SHARE = 0.15
"""Of the lines of the head, the share that must look like data: boot text may outweigh a short log."""


def weigh(lines: list[HeadLine], tables: list[HeadTable]) -> tuple[HeadTable | None, HeadTable | None]:
    """(best, close second) of the ways to split the lines; None where no way makes enough of them look like data.

    The second is a way that gives other rows than the best, with nearly its score.
    """
    found = [table for table in tables if table.score >= MIN_SHARE]
    scores = [round(_score(lines, table), 6) for table in found]
    ranks = [(s, t.form.kind == "teleplot", t.form.decimal == ".") for s, t in zip(scores, found, strict=True)]
    order = sorted(range(len(found)), key=lambda i: ranks[i], reverse=True)
    if not order:
        return None, None
    best = found[order[0]]
    close = (found[i] for i in order if scores[i] >= 0.9 * scores[order[0]] and found[i].rows != best.rows)
    tables_only = (table for table in close if best.form.kind == table.form.kind == "table")
    return best, next(tables_only, None)


def _score(lines: list[HeadLine], table: HeadTable) -> float:
    """How much the lines look like this table, above all by the share of its cells that do."""
    form, step = table.form, max(1, len(lines) // 64)
    if form.kind != "table":
        return table.score
    if form.delimiter == " ":
        some = [line.text for line in lines[::step]]
        listed = sum(2 * len(re.findall(r"[0-9],[0-9]", text)) > text.count(", ") > 0 for text in some)
        # Blanks may be inside the cells of a stamp or a text, but of `21,5, 40,2` they separate.
        return table.score * (1.01 if form.decimal == "," and 2 * listed > len(some) else 0.76)
    if table.width > 1:
        return table.score
    above = [line.text for line in lines if line.number < table.rows[0][0]][-1:]
    is_named = above and "," not in above[0] and only_text(above, form.decimal)
    # Any two numbers are a single column with decimal commas.
    return table.score * (0.5 if form.decimal == "," and not is_named else 1.0)
