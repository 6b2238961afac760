"""How the first lines of a log could be split into rows, which way is best, and where the table starts."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, islice
from typing import Literal

from kalscope.sources.grammar.cells import (
    NumberForm,
    is_blank,
    is_comment,
    is_number,
    parse_number,
    split_fields,
    words,
)
from kalscope.sources.grammar.line_format import (
    LineFormat,
    find_labels,
    split_checksum,
    split_stamp,
    split_teleplot,
)
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
    likeness,
    only_text,
    shaped,
)

# Where the table starts, what its columns hold, and what is above and beside it.


MIN_BESIDE_ROWS, MAX_BESIDE = 16, 64
"""Fewest rows to judge metadata beside the data, and most rows that have it."""
MAX_HEADER_LINES = 5
"""Lines of names, units and what was done to each column that may be above a table."""
MAX_ABOVE = 0.2
"""Largest share of the rows that may be another table above the names, of calibration for instance."""
_WAYS = [re.compile(pattern) for pattern in (",", r"[ \t]+(?![\[(])", r"[ \t]{2,}|\t")]
"""How names above columns that blanks separate may be: at commas, with units in brackets, at wide gaps."""
_RULED = frozenset("-=_+|:;, \t")
"""Characters of a ruled line below the names."""
_SETTINGS = words(
    """
    sample sampling record serial operator user site station gain offset firmware software version model device
    instrument manufacturer start created comment comments title project province
    """
)
"""First words, in lower case, of the properties of a recording that may be above its table."""
_MAX_NAME = 40
"""A longer single cell above a column of numbers is a sentence."""

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
    rows: tuple[tuple[int, Cells], ...]
    """(line number, cells) of the lines that look like data, of `width` cells each."""
    narrow: frozenset[int] = frozenset()
    """Widths of rows that lack their last cells: a later version of the logger added these."""

    @property
    def least(self) -> int:
        """Fewest cells of a whole row: those after the last column that is ever filled may be left out."""
        width = self.width
        while width > 1 and not any(cells[width - 1] for _, cells in self.rows):
            width -= 1
        return width


@dataclass(frozen=True)
class Body:
    """The rows of a table, and the lines above it."""

    rows: tuple[tuple[int, Cells], ...]
    """(line number, cells) of the rows that look like data; those of the samples have numbers beyond the head."""
    first: int
    """Line number of the first row."""
    above: tuple[tuple[int, Cells], ...]
    """(line number, cells) of lines of text right above the first row, nearest first."""
    types: tuple[ColumnType, ...]
    """What each column holds."""
    beside: frozenset[int]
    """Columns that are filled in the first rows only: metadata beside the data."""


def find_body(lines: list[HeadLine], table: HeadTable, plan: Plan, kinds: CellKinds) -> Body:
    """The rows of a table among the lines of a file.

    Args:
        lines: The lines that may hold data.
        table: How they are split.
        plan: What is decided already.
        kinds: The kinds of cells by the table's decimal mark.
    """
    least = plan.preface.first_row or 1
    rows = [row for row in table.rows if row[0] >= least] or list(table.rows)
    beside = _beside(rows, table.width, kinds) | {i for i in plan.preface.left_out if i < table.width}
    types = _types(rows, table.width, kinds)
    if table.form.kind != "table":
        return Body(tuple(rows), rows[0][0], (), types, beside)
    grid = _Grid(lines, table, types, beside, kinds)
    first = grid.first_row(least)
    found, rows = rows, grid.rows_from(first) or list(table.rows[:1])
    types = types if rows == found else _types(rows, table.width, kinds)
    return Body(tuple(rows), first, grid.above(first), types, beside)


def _types(rows: Sequence[tuple[int, Cells]], width: int, kinds: CellKinds) -> tuple[ColumnType, ...]:
    return tuple(column_type([cells[i] for _, cells in rows], kinds) for i in range(width))


def _beside(rows: Sequence[tuple[int, Cells]], width: int, kinds: CellKinds) -> frozenset[int]:
    """Columns of labels and values that are in some of the first rows only, and empty ones up to the data."""
    last = [max((place for place, (_, cells) in enumerate(rows) if cells[i]), default=-1) for i in range(width)]
    brief = [0 <= place < min(MAX_BESIDE, len(rows) / 2) for place in last]
    beside: set[int] = set()
    for i in range(width - 1 if len(rows) >= MIN_BESIDE_ROWS else 0):
        if brief[i] and brief[i + 1] and any(kinds[cells[i]] == "text" for _, cells in rows):
            beside |= {i, i + 1}
    end = max(beside, default=-1) + 1
    while 0 < end < width and last[end] < 0:
        end += 1
    return frozenset(beside | {i for i in range(end) if last[i] < 0})


class _Grid:
    """The lines of a file, each split and compared with the columns of the table."""

    def __init__(
        self,
        lines: list[HeadLine],
        table: HeadTable,
        types: tuple[ColumnType, ...],
        beside: frozenset[int],
        kinds: CellKinds,
    ) -> None:
        self._kinds, self._types, self._beside = kinds, types, beside
        self._table, self._least = table, table.least
        self._texts = {line.number: line.text for line in lines}
        known = {} if table.narrow else dict(table.rows)
        self._lines = [
            (line.number, known.get(line.number) or tuple(split_fields(line.text, table.form.delimiter)))
            for line in lines
        ]
        whole: set[str] = set()  # a line of the shape of a whole row is one as well
        self._fits: list[Fit | None] = []
        for (_, cells), line in zip(self._lines, lines, strict=True):
            fit = "row" if line.shape in whole else self._fit(cells)
            self._fits.append(fit)
            if fit == "row":
                whole.add(line.shape)

    def _fit(self, cells: Cells) -> Fit | None:
        """How a line suits the columns; None where it has too few or too many cells."""
        width = len(cells)
        if not (self._least <= width <= self._table.width or width in self._table.narrow):
            return None
        judged = [
            (self._types[i].judge(cell, self._kinds), cell) for i, cell in enumerate(cells) if i not in self._beside
        ]
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
        places = [i for i, (number, _) in enumerate(self._lines) if number >= least]
        best, gained, whole, other = 0, 0, 0, 0
        few = MAX_ABOVE * sum(self._fits[i] == "row" for i in places)
        for i in places:
            if self._fits[i] == "text" and self._is_header(i):
                if other - 2 * whole > gained:
                    best, gained = i + 1, other - 2 * whole
                elif 0 < whole <= few and self._begins_anew(i):
                    best = i + 1
            whole += self._fits[i] == "row"
            other += self._fits[i] == "partial"
        data = [i for i in places if i >= best and self._fits[i] in ("row", "partial")]
        if not data:
            return self._table.rows[0][0]
        start = data[0] if best else next((i for i in data if not self._is_label(i)), data[0])
        while start - 1 in places and (self._fits[start - 1] == "void" or self._repeats(start - 1)):
            start -= 1
        return self._lines[start][0]

    def _is_header(self, place: int) -> bool:
        """True for a line of text with a row right below it."""
        below = self._fits[place + 1 : place + 1 + MAX_HEADER_LINES]
        return "row" in below and len(self._lines[place][1]) >= self._least

    def _is_label(self, place: int) -> bool:
        """True for `Sample rate,100` with no names above it: text where the rows below have a number."""
        first = self._lines[place][1][0]
        cells, partial = self._lines[place][1], self._fits[place] == "partial"
        judged = zip(self._types, cells, strict=False)
        texts = {cell for kind, cell in judged if partial and kind.judge(cell, self._kinds) == "strange"}
        if len(texts) > max(1, sum(self._kinds[cell] in NUMERIC for cell in cells)):
            return True  # `08:30:05 CPU %user %nice`: a stamp beside names
        strange = partial and self._types[0].judge(first, self._kinds) == "strange"
        nameless = not place or self._fits[place - 1] != "text" or self._is_setting(self._lines[place][1])
        return strange and any(map(str.isalpha, first)) and nameless

    def _is_setting(self, cells: Cells) -> bool:
        """True for `Firmware,v2.31b`: a property of the recording, and its value."""
        first = cells[0].lower().strip(" :=").split()[:1]
        others = sum(cell != "" for cell in cells[1:])
        return others == 1 and self._types[0].kind in ("number", "stamp") and not _SETTINGS.isdisjoint(first)

    def _repeats(self, place: int) -> bool:
        """True for the first ERR of several below other names: one word that repeats is not a name."""
        cells = self._lines[place][1]
        near = [line for _, line in self._lines[max(0, place - 1) : place + 2]]
        return place > 0 and self._fits[place] == "text" and len(set(cells)) == 1 and near.count(cells) > 1

    def _begins_anew(self, place: int) -> bool:
        """True for names that differ from those above, below an empty line or one that is not of the table.

        The first column of one table goes on below as it rose above: its lines of text are not names.
        """
        number, cells = self._lines[place]
        parted = place > 0 and (self._fits[place - 1] in (None, "text") or self._lines[place - 1][0] < number - 1)
        distinct = len(set(cells)) == len(cells) and not any(self._kinds[cell] == "word" for cell in cells)
        if not parted or not distinct or any(cells == above for _, above in self._lines[:place]):
            return False
        rows = [cells for (_, cells), fit in zip(self._lines, self._fits, strict=True) if fit == "row"]
        above = sum(fit == "row" for fit in self._fits[:place])
        near = [parse_number(row[0], self._table.form.decimal) for row in rows[max(0, above - 2) : above + 1]]
        if len(near) < 3 or None in near:
            return True
        before, last, after = (float(number or 0.0) for number in near)
        return not before < last < after <= last + 3 * (last - before)

    def rows_from(self, first: int) -> list[tuple[int, Cells]]:
        """(line number, cells) of the rows from line `first` on, each padded to the width of the table."""
        width = self._table.width
        return [
            (line[0], line[1] + ("",) * (width - len(line[1]))) if len(line[1]) < width else line
            for line, fit in zip(self._lines, self._fits, strict=True)
            if line[0] >= first and fit in ("row", "partial", "void")
        ]

    def above(self, first: int) -> tuple[tuple[int, Cells], ...]:
        """(line number, cells) of the lines of text right above the first row that may name its columns."""
        lines = [line for line in self._lines if line[0] < first][-MAX_HEADER_LINES:]
        found, remark, width = list[tuple[int, Cells]](), False, self._table.width
        for number, _ in reversed(lines):
            if not set(self._texts[number]) - _RULED:
                continue
            cells = header_cells(self._texts[number], self._table.form.delimiter, self._least)
            if len(cells) == 1 < width and not found and not remark and self._kinds[cells[0]] == "text":
                remark = True  # `SD card ok` below the names
                continue
            if not self._may_name(cells) or (remark and not found and not (len(cells) == width and all(cells))):
                break
            found.append((number, cells))
        narrow = found and len(found[0][1]) < self._least
        if narrow and sum(len(cells) == len(found[0][1]) for _, cells in lines) > 1:
            return ()  # `Gain;24` above `Site;Barn 7` are pairs, not names
        return tuple(found)

    def _may_name(self, cells: Cells) -> bool:
        """True for text in about as many cells as a row has."""
        width = self._table.width
        if width == 1:
            fits = len(cells) == 1 and len(cells[0]) <= _MAX_NAME
        else:
            # Split at blanks, any sentence has several cells.
            prose = self._table.form.delimiter == " "
            low, high = (self._least - 1, width) if prose else (self._least // 2, 2 * width)
            fits = max(2, low) <= len(cells) <= high and not (prose and cells[-1].endswith((".", ":")))
        numeric = any(self._kinds[cell] in ("number", "stamp") for cell in cells if cell)
        return (
            fits
            and any(cells)
            and not numeric
            and not cells[0].endswith(("=", ":"))
            and not self._is_setting(cells)
        )


def header_cells(text: str, delimiter: str, width: int) -> Cells:
    """The cells of a line above `width` columns.

    Names of columns that blanks separate may be separated otherwise: `t [us]   torque`, `Air Temp  Rel Hum`.
    """
    cells = tuple(split_fields(text, delimiter))
    if delimiter != " " or len(cells) == width:
        return cells
    ways = (tuple(cell.strip() for cell in way.split(text.strip())) for way in _WAYS)
    return next((found for found in ways if len(found) == width), cells)


# The ways in which the first lines of a log could be split into rows, each weighed by how its cells look.
#
# Pure functions on text.


_MAX_CELLS = 4096
"""A line of more cells is not a row of any table."""
MIN_RUN, MIN_NAMED_RUN = 8, 3
"""Successive lines of another width that mean a new field, not damage; and how many below its name."""
MAX_JUDGED = 500
"""Rows by which those of two widths are compared."""
_BEGIN = re.compile(
    r"[\W_]*(?:(?:begin|start)(?: of)?[ _]?)?"
    r"(?:data|end[ _]?of[ _]?header|end[ _]header|(?<=\*)end|(?<=# )columns: [0-9]+)[\W_]*",
    re.IGNORECASE,
)
SCALE = re.compile(r"[ \t]{0,8}(1\.0e[+-][0-9]{2}) \*[ \t]{0,8}")
"""The common factor that MATLAB prints above a matrix."""
_MAX_PREFACE = 2000
"""Lines above which a table begins."""
MIN_TEXT_SHARE = 0.04
"""Of the lines, the share that must look like data in a table of mostly text, whose rows all look alike."""
MIN_UNIFORM, MIN_UNIFORM_LINES = 0.6, 20
"""Of the lines with numbers, the share that must have one width, where there are so many: records of several lines
are not a table."""
MIN_COMPLETE, MIN_COMPLETE_ROWS = 0.95, 20
"""Share of labelled lines that hold every label, and how many there must be, for the others to be damaged."""


def marked_begin(head: Sequence[str]) -> int:
    """Line number of `*END*`, `[Data]`, `@data`, below which a table begins; 0 where no line says so.

    There must be more lines with digits below it than above.
    """
    marks = [i for i, line in enumerate(head[:_MAX_PREFACE], 1) if len(line) < 40 and _BEGIN.fullmatch(line)]
    if not marks:
        return 0
    digits = [any(c.isdecimal() for c in line) and not is_comment(line) for line in head]
    return next((i for i in reversed(marks) if sum(digits[i:]) >= max(3, sum(digits[:i]))), 0)


def candidate_lines(
    head: Sequence[str], samples: Iterable[Sequence[str]] = (), after: int = 0
) -> tuple[list[HeadLine], LineFormat]:
    """Lines that may hold data; stamp and checksum split off where most lines have one, which the form says.

    Args:
        head: The first lines.
        samples: Runs of lines from further down.
        after: Line number above the first that may hold data.
    """
    lines = [HeadLine(i, text) for i, text in enumerate(head, 1) if i > after and _may_be_data(text)]
    last = len(head)
    for sample in samples:
        # A line number is skipped, so that the last line above is not next to the first below.
        lines += [HeadLine(i, text) for i, text in enumerate(sample, last + 2) if _may_be_data(text)]
        last += 1 + len(sample)
    lines = shaped(lines)
    some = first_of_each_shape(lines)
    stamped = {shape for shape, texts in some.items() if split_stamp(texts[0])}
    is_stamped = sum(line.shape in stamped for line in lines) > len(lines) / 2
    if is_stamped:
        split = [(line, split_stamp(line.text)) for line in lines]
        lines = shaped([HeadLine(line.number, parts[1], parts[0]) for line, parts in split if parts is not None])
    sums = [(line, split_checksum(line.text)) for line in lines]
    right = {line.number for line, parts in sums if parts and parts[1] == parts[2]}
    checked = len(right) > len(lines) / 2
    if checked:  # a header has no checksum; others lines without it were damaged
        kept = [pair for pair in sums if pair[0].number in right or not any(map(str.isdigit, pair[0].text))]
        lines = shaped([line._replace(text=parts[0] if parts else line.text) for line, parts in kept])
    return lines, LineFormat(stamped=is_stamped, checksum=checked)


def _may_be_data(text: str) -> bool:
    return not is_blank(text) and not is_comment(text) and not SCALE.fullmatch(text)


def candidate_tables(lines: list[HeadLine], plan: Plan) -> list[HeadTable]:
    """Every way to split the lines of a head, each with a score of how much they look like data."""
    some = first_of_each_shape(lines)
    candidates = [] if plan.preface.delimiter else [_teleplot(lines), _labelled(lines, some, plan)]
    kinds = {mark: CellKinds(mark, plan.options.missing_texts) for mark in ".,"}
    for delimiter in (plan.preface.delimiter,) if plan.preface.delimiter else _delimiters(some, kinds):
        split = _SplitLines(lines, some, delimiter)
        for decimal in plan.options.decimal or ".,":
            form = LineFormat("table", delimiter, decimal)
            if decimal != delimiter:
                candidates.append(_as_table(split, form, kinds[decimal]))
            elif any('"' in shape for shape in some):  # decimal commas inside the quotes of a comma file
                candidates.append(_as_table(split, form, CellKinds(decimal, plan.options.missing_texts, delimiter)))
    return [table for table in candidates if table is not None]


def _delimiters(some: Mapping[str, Sequence[str]], kinds: Mapping[str, CellKinds]) -> list[str]:
    """The delimiters between two cells of a line, and one that is in none where some lines are a single number."""
    found = {mark for shape in some for mark in DELIMITERS if mark in shape.strip(" ")}
    found |= {" "} if "\t" in found else set()
    single = any(known[texts[0].strip(" \t")] in NUMERIC for known in kinds.values() for texts in some.values())
    absent = [mark for mark in DELIMITERS if mark not in found][: single or not found]
    return [mark for mark in DELIMITERS if mark in found or mark in absent]


class _SplitLines:
    """The lines of a log split at one delimiter, each when its cells are needed."""

    def __init__(self, lines: list[HeadLine], some: Mapping[str, Sequence[str]], delimiter: str) -> None:
        """Args: lines that may hold data, some of each shape, their delimiter."""
        self.lines, self._delimiter = lines, delimiter
        self.some = {shape: list(map(self._split, texts)) for shape, texts in some.items()}
        # Quotes and delimiters are the same in all lines of a shape.
        self.widths = {shape: len(rows[0]) for shape, rows in self.some.items()}
        self._known: dict[int, Cells] = {}

    def cells(self, line: HeadLine) -> Cells:
        """The cells of a line."""
        found = self._known.get(line.number)
        if found is None:
            found = self._known[line.number] = self._split(line.text)
        return found

    def _split(self, text: str) -> Cells:
        """The cells of a line; one that would have thousands is not a row and is not split."""
        if len(text) > _MAX_CELLS and text.count(self._delimiter) > _MAX_CELLS:
            return (text,)
        return tuple(split_fields(text, self._delimiter))


def _as_table(split: _SplitLines, form: LineFormat, kinds: CellKinds) -> HeadTable | None:
    """The lines of the commonest width, weighed by how much they look like data."""
    likely = {
        shape: sum(likeness(cells, kinds) for cells in rows) / len(rows) for shape, rows in split.some.items()
    }
    weight: Counter[int] = Counter()
    for line in split.lines:
        weight[split.widths[line.shape]] += likely[line.shape]  # type: ignore[assignment]
    width = max(weight, key=lambda width: weight[width], default=0)
    if not width or weight[width] < MIN_TEXT_SHARE * len(split.lines):
        return None
    width, narrow = _grown_width(split, likely, width, kinds)
    total = sum(weight[w] for w in (width, *narrow))
    if len(split.lines) >= MIN_UNIFORM_LINES and total < MIN_UNIFORM * sum(weight.values()):
        return None
    fitting = [line for line in split.lines if split.widths[line.shape] in (width, *narrow)]
    best = max(likely[line.shape] for line in fitting)
    rows = [(line.number, split.cells(line)) for line in fitting if likely[line.shape] >= best / 2]
    rows = [(number, cells + ("",) * (width - len(cells))) for number, cells in rows]
    return HeadTable(total / len(split.lines), form, width, tuple(rows), narrow)


def _is_void(cells: Cells, kinds: CellKinds) -> bool:
    """True for a row of a stamp and missing samples."""
    found = {kinds[cell] for cell in cells}
    return "stamp" in found and found <= {"stamp", "missing", "word"}


def _grown_width(
    split: _SplitLines, likely: Mapping[str, float], width: int, kinds: CellKinds
) -> tuple[int, frozenset[int]]:
    """The width of the rows, and the smaller widths of those that lack a field which the logger added later.

    `width` is the commonest. Several rows of the other width follow each other, hold the same in each column, and
    have no names of their own.
    """
    rows = [line for line in split.lines if likely[line.shape] or _is_void(split.some[line.shape][0], kinds)]
    runs = [(w, list(run)) for w, run in groupby(rows, key=lambda line: split.widths[line.shape])]
    # `Gain,24` above the names may look like the first row of the first run.
    begin = next((run[1].number for _, run in runs if len(run) >= MIN_NAMED_RUN), 0)
    above = (split.cells(line) for line in reversed(split.lines) if line.number < begin)
    named = next((len(cells) for cells in above if only_text(cells, kinds.decimal)), 0)
    widest = max((w for w, run in runs if len(run) >= MIN_NAMED_RUN), default=0)
    least = MIN_NAMED_RUN if named == widest else MIN_RUN
    long = {w for w, run in runs if len(run) >= least and w > 1}
    if width < named == runs[0][0]:  # the first row alone holds what is the same in all, such as a serial number
        long.add(named)
        widest = named
    if len(long) < 2 or width not in long:
        return width, frozenset()

    def types(w: int, count: int) -> tuple[ColumnType, ...]:
        judged = islice((line for line in rows if split.widths[line.shape] == w), MAX_JUDGED)
        return _types([(line.number, split.cells(line)) for line in judged], count, kinds)

    widest = max(long)
    narrow = {
        w
        for w in long - {widest, named}
        if all(wide.suits(less) for wide, less in zip(types(widest, w), types(w, w), strict=True))
    }
    return (widest, frozenset(narrow)) if width in {widest, *narrow} else (width, frozenset())


def _labelled(lines: list[HeadLine], some: Mapping[str, Sequence[str]], plan: Plan) -> HeadTable | None:
    """The lines of `name:value` pairs whose names come often and with numbers."""
    shapes = {shape for shape, texts in some.items() if any(map(find_labels, texts))}
    labelled = [line for line in lines if line.shape in shapes]
    pairs = [(line.number, dict(found)) for line in labelled if (found := find_labels(line.text))]
    kinds = CellKinds(".", plan.options.missing_texts)
    count: Counter[str] = Counter()
    for _, found in pairs:
        for label, value in found.items():
            count[label] += kinds[value] in NUMERIC or kinds[value] == "stamp"
    numeric = {label for label, n in count.items() if n and n >= 0.1 * len(pairs)}
    # A text beside numbers, "status", is a column; lines of texts alone are the program's log.
    beside = Counter(label for _, found in pairs if found.keys() & numeric for label in found)
    labels = tuple(label for label, n in beside.items() if n >= 0.1 * len(pairs))
    rows = tuple(
        (number, tuple(found.get(label, "") for label in labels))
        for number, found in pairs
        if found.keys() & numeric and found.keys() <= set(labels)
    )
    rows = tuple(row for row in rows if likeness(row[1], kinds))
    if not rows:
        return None
    whole = sum(found.keys() >= set(labels) for _, found in pairs)
    complete = len(rows) >= MIN_COMPLETE_ROWS and whole >= MIN_COMPLETE * len(rows)
    form = LineFormat("labels", labels=labels, complete=complete)
    return HeadTable(len(rows) / len(lines), form, len(labels), rows)


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


# Which of the ways to split a log is the best, and which other one comes close. Pure functions.


MIN_SHARE = 0.15
"""Of the lines of the head, the share that must look like data: boot text may outweigh a short log."""
CLOSE = 0.9
"""A second way with at least this share of the best score could be meant as well."""
BLANKS, BARE_COMMA, LISTED = 0.76, 0.5, 1.01
"""What the score is multiplied with: of rows split at blanks, which may be inside the cells of a stamp or a text;
of a single column with decimal commas and no name, which any two numbers are; of `21,5, 40,2`, where the comma
before a blank separates, and of `1.013,05` alone, because no cell is written like its 05."""
_PADDED = re.compile(r",0[0-9]")
_COMMA_INSIDE = re.compile(r"[0-9],[0-9]")


def weigh(lines: list[HeadLine], tables: list[HeadTable]) -> tuple[HeadTable | None, HeadTable | None]:
    """(best, close second) of the ways to split the lines; None where no way makes enough of them look like data.

    The second is a way that gives other rows than the best, with nearly its score.
    """
    found = [table for table in tables if table.score >= MIN_SHARE]
    scores = {id(table): _score(lines, table) for table in found}

    def rank(table: HeadTable) -> tuple[float, bool, bool, bool]:
        by_kind = table.form.kind == "teleplot", _names_fit(lines, table), table.form.decimal == "."
        return (round(scores[id(table)], 6), *by_kind)

    ranked = sorted(found, key=rank, reverse=True)
    if not ranked:
        return None, None
    best = ranked[0]
    close = (table for table in ranked[1:] if scores[id(table)] >= CLOSE * scores[id(best)])
    return best, next((table for table in close if _differs(best, table)), None)


def _score(lines: list[HeadLine], table: HeadTable) -> float:
    """How much the lines look like this table, above all by the share of its cells that do."""
    form, step = table.form, max(1, len(lines) // 64)
    if form.kind != "table":
        return table.score
    if form.delimiter == " ":
        some = [line.text for line in lines[::step]]
        listed = sum(2 * len(_COMMA_INSIDE.findall(text)) > text.count(", ") > 0 for text in some)
        return table.score * (LISTED if form.decimal == "," and 2 * listed > len(some) else BLANKS)
    if table.width > 1:
        return table.score
    cells = [cells[0] for _, cells in table.rows[::step]]
    if all(map(NumberForm(form.decimal, thousands=True).fits, cells)) and any("." in c and "," in c for c in cells):
        return table.score * (LISTED if any(map(_PADDED.search, cells)) else 1.0)
    return table.score * (BARE_COMMA if form.decimal == "," and not _names_fit(lines, table) else 1.0)


def _names_fit(lines: list[HeadLine], table: HeadTable) -> bool:
    """True where the line above the first row holds one name per column."""
    above = [line for line in lines if line.number < table.rows[0][0]]
    if not above or table.form.kind != "table":
        return False
    cells = split_fields(above[-1].text, table.form.delimiter)
    whole = table.form.decimal != "," or not any("," in cell for cell in cells)
    return whole and only_text(cells, table.form.decimal) and table.least <= len(cells) <= table.width


def _differs(best: HeadTable, other: HeadTable) -> bool:
    """True where another way gives other rows, not the same ones by another mark."""
    if best.form.kind != "table" or other.form.kind != "table":
        return False
    return best.width != other.width or [cells for _, cells in best.rows] != [cells for _, cells in other.rows]
