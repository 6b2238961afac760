"""How the first lines of a log could be split into rows, which way is best, and where the table starts."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Literal, NamedTuple

from kalscope.sources.grammar.cells import (
    COMMENT_MARKS,
    NumberForm,
    are_units,
    is_blank,
    is_comment,
    is_grouped,
    is_number,
    parse_number,
    split_fields,
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

# Columns of metadata beside the data, in the first rows only.


MIN_BESIDE_ROWS = 16
"""Fewest rows to judge that."""
MAX_BESIDE = 64
"""Most rows with metadata beside the data."""


def find_beside(rows: Sequence[tuple[int, Cells]], width: int, kinds: CellKinds) -> frozenset[int]:
    """Columns of labels and values that are in some of the first rows only, and empty ones up to the data."""
    last = [max((place for place, (_, cells) in enumerate(rows) if cells[i]), default=-1) for i in range(width)]
    brief = [0 <= place < min(MAX_BESIDE, len(rows) / 2) for place in last]
    if len(rows) < MIN_BESIDE_ROWS:
        return frozenset()
    beside: set[int] = set()
    for i in range(width - 1):
        if brief[i] and brief[i + 1] and any(kinds[cells[i]] == "text" for _, cells in rows):
            beside |= {i, i + 1}
    if not beside:
        return frozenset()
    end = max(beside) + 1
    while end < width and last[end] < 0:
        end += 1
    return frozenset(beside | {i for i in range(end) if last[i] < 0}) if end < width else frozenset(beside)


# Where the table starts, what its columns hold, and what is above and beside it.


MAX_HEADER_LINES = 5
"""Lines of names, units and what was done to each column that may be above a table."""
MAX_ABOVE = 0.2
"""Largest share of the rows that may be another table above the names, of calibration for instance."""
MAX_REPEATED = 64
"""Rows of one repeated word that may come between the names and the first number."""
_PAIR_LABELS = frozenset(
    """
    sample rate|sampling rate|sample frequency|sampling frequency|sample interval|sample period|sampling interval
    record length|serial number|serial no|serial no.|serial|operator|user|site|station|station name|location|gain
    firmware|firmware version|software version|version|model|model number|device|device id|instrument|manufacturer
    latitude|longitude|elevation|altitude|province|start time|start date|created|comment|comments|title|project
    """.replace("\n", "|")
    .replace("    ", "")
    .strip("|")
    .split("|")
)
"""Labels of the pairs above a table, in lower case."""
_WIDE_GAP = re.compile(r"[ \t]{2,}|\t")
_RULED = frozenset("-=_+|:;, \t")
"""Characters of a ruled line below the names."""
_MAX_NAME = 40
"""A longer single cell above a column of numbers is a sentence."""

Fit = Literal["row", "partial", "void", "text"]
"""All cells of a line suit their columns; some do; all are missing; none does, which is how names look."""


@dataclass(frozen=True)
class Body:
    """The rows of a table, and the lines above it."""

    rows: tuple[tuple[int, Cells], ...]
    """(line number, cells) of the rows of the head that look like data."""
    samples: tuple[tuple[int, Cells], ...]
    """The same from further down the file; their numbers only tell them apart."""
    first: int
    """Line number of the first row."""
    above: tuple[tuple[int, Cells], ...]
    """(line number, cells) of lines of text right above the first row, nearest first."""
    types: tuple[ColumnType, ...]
    """What each column holds."""
    beside: frozenset[int]
    """Columns that are filled in the first rows only: metadata beside the data."""
    narrow: frozenset[int] = frozenset()
    """Widths of rows that lack their last cells."""

    def starting_at(self, first: int) -> Body:
        """The same table without the rows above line `first`."""
        rows = tuple(row for row in self.rows if row[0] >= first)
        return replace(self, rows=rows or self.rows, first=first)

    def column(self, index: int) -> list[str]:
        """The cells of one column: of the head, then of the samples."""
        return [cells[index] for _, cells in self.rows] + [cells[index] for _, cells in self.samples]


def find_body(lines: list[HeadLine], table: HeadTable, plan: Plan, size: int, kinds: CellKinds) -> Body:
    """The rows of a table among the lines of a file.

    Args:
        lines: The lines that may hold data.
        table: How they are split.
        plan: What is decided already.
        size: Lines of the head; those with a larger number come from further down.
        kinds: The kinds of cells by the table's decimal mark.
    """
    least = plan.first_row
    rows = [row for row in table.rows if row[0] >= least] or list(table.rows)
    beside = find_beside(rows, table.width, kinds) | {i for i in plan.preface.left_out if i < table.width}
    types = tuple(column_type([cells[i] for _, cells in rows], kinds) for i in range(table.width))
    if table.form.kind != "table":
        inside = tuple(row for row in rows if row[0] <= size)
        samples = tuple(row for row in rows if row[0] > size)
        return Body(inside or tuple(rows[:1]), samples, rows[0][0], (), types, beside)
    grid = _Grid(lines, table, types, beside, kinds)
    first = grid.first_row(least)
    found, rows = rows, grid.rows_from(first)
    inside = tuple(row for row in rows if row[0] <= size)
    samples = tuple(row for row in rows if row[0] > size)
    if rows != found:
        types = tuple(column_type([cells[i] for _, cells in rows], kinds) for i in range(table.width))
    return Body(inside or table.rows[:1], samples, first, grid.above(first), types, beside, table.narrow)


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
        self._table = table
        self._least = _least_width(table, types)
        self._texts = {line.number: line.text for line in lines}
        known = {} if table.narrow else dict(table.rows)
        self._lines = [
            (line.number, known.get(line.number) or tuple(split_fields(line.text, table.form.delimiter)))
            for line in lines
        ]
        self._fits = self._all_fits([line.shape for line in lines])

    def _all_fits(self, shapes: list[str]) -> list[Fit | None]:
        """How each line suits the columns; one of the shape of a whole row is one as well."""
        whole: set[str] = set()
        fits: list[Fit | None] = []
        for (_, cells), shape in zip(self._lines, shapes, strict=True):
            fit: Fit | None = "row" if shape in whole else self._fit(cells)
            fits.append(fit)
            if fit == "row":
                whole.add(shape)
        return fits

    def _fit(self, cells: Cells) -> Fit | None:
        """How a line suits the columns; None where it has too few or too many cells."""
        width = len(cells)
        if not (self._least <= width <= self._table.width or width in self._table.narrow):
            return None
        fitting, said = 0, list[tuple[str, str]]()
        for i, cell in enumerate(cells):
            if i in self._beside:
                continue
            if self._kinds[cell] == self._types[i].kind != "text":
                fitting += 1  # nearly all cells of a log
            else:
                said.append((self._types[i].judge(cell, self._kinds), cell))
        fitting += sum(judged == "fits" for judged, _ in said)
        strange = sum(judged == "strange" for judged, _ in said)
        if fitting:
            return "partial" if strange else "row"
        known = [cell for judged, cell in said if judged == "missing" and cell and self._kinds[cell] != "text"]
        if not strange and known:
            return "void"
        # "-,-,ERR" is a row of missing samples, "t,M" are names.
        return "void" if len(known) > strange else "text"

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
        places = [i for i in places if i >= best]
        data = [i for i in places if self._fits[i] in ("row", "partial")]
        if not data:
            return self._table.rows[0][0]
        start = data[0]
        if not best:
            start = next((i for i in data if not self._is_label(i)), start)
        while start - 1 in places and (self._fits[start - 1] == "void" or self._repeats(start - 1)):
            start -= 1
        return self._lines[start][0]

    def _begins_anew(self, place: int) -> bool:
        """True for names that differ from those above, below an empty line or one that is not of the table."""
        number, cells = self._lines[place]
        parted = place > 0 and (self._fits[place - 1] in (None, "text") or self._lines[place - 1][0] < number - 1)
        distinct = len(set(cells)) == len(cells) and not any(self._kinds[cell] == "word" for cell in cells)
        return (
            parted
            and distinct
            and not any(cells == above for _, above in self._lines[:place])
            and not self._goes_on(place)
        )

    def _goes_on(self, place: int) -> bool:
        """True where the first column goes on below a line as it rose above it."""
        rows = [cells for (_, cells), fit in zip(self._lines, self._fits, strict=True) if fit == "row"]
        above = sum(fit == "row" for fit in self._fits[:place])
        found = [parse_number(cells[0], self._table.form.decimal) for cells in rows[max(0, above - 2) : above + 1]]
        if len(found) < 3 or None in found:
            return False
        before, last, after = (float(number or 0.0) for number in found)
        return before < last < after <= last + 3 * (last - before)

    def _repeats(self, place: int) -> bool:
        """True for the second ERR of several below other names: one word that repeats is not a name."""
        cells = self._lines[place][1]
        if self._fits[place] != "text" or len(set(cells)) > 1:
            return False
        above = [other for _, other in self._lines[max(0, place - MAX_REPEATED) : place]]
        below = self._lines[place + 1][1] if place + 1 < len(self._lines) else ()
        is_repeated = cells == below or (bool(above) and above[-1] == cells)
        return is_repeated and any(other != cells and self._may_name(other) for other in above)

    def _is_header(self, place: int) -> bool:
        """True for a line of text with a row right below it."""
        below = self._fits[place + 1 : place + 1 + MAX_HEADER_LINES]
        return "row" in below and len(self._lines[place][1]) >= self._least

    def _is_label(self, place: int) -> bool:
        """True for `Sample rate,100` with no names above it: text where the rows below have a number."""
        if self._fits[place] != "partial":
            return False
        cells = self._lines[place][1]
        if self._types[0].judge(cells[0], self._kinds) != "strange" or not any(c.isalpha() for c in cells[0]):
            return False
        return self._is_pair(cells) or not place or self._fits[place - 1] != "text"

    def _is_pair(self, cells: Cells) -> bool:
        """True for `Sample Rate,100 Hz`: a property of the recording, and its value."""
        label = cells[0].partition("(")[0].partition("[")[0].strip(" :=").lower()
        said = [cell for cell in cells[1:] if cell]
        return label in _PAIR_LABELS and len(said) == 1 and self._types[0].kind in ("number", "stamp")

    def rows_from(self, first: int) -> list[tuple[int, Cells]]:
        """(line number, cells) of the rows from line `first` on, each padded to the width of the table."""
        width = self._table.width
        return [
            line if len(line[1]) == width else (line[0], line[1] + ("",) * (width - len(line[1])))
            for line, fit in zip(self._lines, self._fits, strict=True)
            if line[0] >= first and fit in ("row", "partial", "void")
        ]

    def above(self, first: int) -> tuple[tuple[int, Cells], ...]:
        """(line number, cells) of the lines of text right above the first row that may name its columns."""
        lines = [line for line in self._lines if line[0] < first]
        found: list[tuple[int, Cells]] = []
        for number, _ in reversed(lines[-MAX_HEADER_LINES:]):
            cells = header_cells(self._texts[number], self._table.form.delimiter, self._least)
            if not set(self._texts[number]) - _RULED or (not found and self._is_remark(number, cells)):
                continue
            if not self._may_name(cells):
                break
            found.append((number, cells))
        if found and len(found[0][1]) < self._least:
            alike = sum(len(cells) == len(found[0][1]) for _, cells in lines[-MAX_HEADER_LINES:])
            return () if alike > 1 else tuple(found)  # `Gain;24` above `Site;Barn 7` are pairs, not names
        return tuple(found)

    def _is_remark(self, number: int, cells: Cells) -> bool:
        """True for one word alone below a line that names all columns."""
        width = self._table.width
        if width == 1 or len(cells) != 1 or self._kinds[cells[0]] != "text":
            return False
        above = [text for other, text in self._texts.items() if other < number]
        names = header_cells(above[-1], self._table.form.delimiter, self._least) if above else ()
        return len(names) == width and all(names) and self._may_name(names)

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
        return (
            fits
            and any(cells)
            and not cells[0].endswith(("=", ":"))
            and not self._is_pair(cells)
            and not any(self._kinds[cell] in ("number", "stamp") for cell in cells if cell)
        )


def header_cells(text: str, delimiter: str, width: int) -> Cells:
    """The cells of a line above `width` columns.

    Split at blanks, a unit in brackets belongs to the name before it (`t [us]   torque`), names may hold a blank
    where several separate them, and a row of units may lack that of the time.
    """
    cells = tuple(split_fields(text, delimiter))
    if delimiter != " " or len(cells) == width:
        return cells
    listed = tuple(split_fields(text, ","))
    if len(listed) == width:
        return listed
    joined: list[str] = []
    for cell in cells:
        if joined and cell and cell[0] in "[(" and cell[-1] in "])":
            joined[-1] += f" {cell}"
        else:
            joined.append(cell)
    wide = tuple(cell.strip() for cell in _WIDE_GAP.split(text.strip()))
    fitting = next((found for found in (tuple(joined), wide) if len(found) == width), cells)
    if len(fitting) < width and are_units(fitting) and text.startswith((" ", "\t")):
        return ("",) * (width - len(fitting)) + fitting
    return fitting


def _least_width(table: HeadTable, types: tuple[ColumnType, ...]) -> int:
    """The fewest cells of a whole row: those after the last column that is ever filled may be left out."""
    width = table.width
    while width > 1 and types[width - 1].kind == "empty":
        width -= 1
    return width


# Logs that gained a field: rows of two widths under one line of names.


MIN_RUN, MIN_NAMED_RUN = 8, 3
"""Successive lines of another width that mean a new field, not damage; and how many below its name."""
_MAX_CELLS = 4096
"""A line of more cells is not a row of any table."""
MAX_JUDGED = 500
"""Rows by which those of two widths are compared."""


class _Run(NamedTuple):
    """Consecutive rows of one width."""

    width: int
    """Cells of each."""
    lines: int
    """How many there are."""
    place: int
    """Place of the first among the lines."""


class SplitLines:
    """The lines of a log split at one delimiter, each when its cells are needed."""

    def __init__(
        self, lines: list[HeadLine], some: Mapping[str, Sequence[str]], delimiter: str, head: Sequence[str] = ()
    ) -> None:
        """Args: lines that may hold data, some of each shape, their delimiter, the head with comments."""
        self.lines, self._head = lines, head
        self.some = {shape: [_cells(text, delimiter) for text in texts] for shape, texts in some.items()}
        self._delimiter = delimiter
        self._known: dict[int, Cells] = {}
        self._widths = {shape: len(rows[0]) for shape, rows in self.some.items()}

    def width(self, line: HeadLine) -> int:
        """Cells of a line; quotes and delimiters are the same in all lines of a shape."""
        return self._widths[line.shape]

    def cells(self, line: HeadLine) -> Cells:
        """The cells of a line."""
        found = self._known.get(line.number)
        if found is None:
            found = self._known[line.number] = _cells(line.text, self._delimiter)
        return found

    def comment_above(self, line: HeadLine) -> Cells:
        """The cells of the comment right above a line; () where there is none."""
        place = line.number - 2
        text = self._head[place] if 0 <= place < len(self._head) else ""
        return tuple(split_fields(text, self._delimiter)) if is_comment(text) else ()


def _cells(text: str, delimiter: str) -> Cells:
    """The cells of a line; one that would have thousands is not a row and is not split."""
    if len(text) > _MAX_CELLS and text.count(delimiter) > _MAX_CELLS:
        return (text,)
    return tuple(split_fields(text, delimiter))


def grown_width(
    split: SplitLines, likely: Mapping[str, float], width: int, kinds: CellKinds
) -> tuple[int, frozenset[int]]:
    """The width of the rows, and the smaller widths of the rows above that a later field was added to.

    `width` is the commonest. A file grows where runs of rows of another width are below a line of names for the
    widest, or between the rows of the widest.
    """
    lines = split.lines
    rows = {shape for shape, cells in split.some.items() if likely[shape] or _is_void(cells[0], kinds)}
    if len({len(split.some[shape][0]) for shape in rows}) < 2:
        return width, frozenset()
    runs = _runs(split, rows, kinds)
    long = [run for run in runs if run.lines >= MIN_NAMED_RUN and run.width > 1]
    widest = max((run.width for run in long), default=width)
    named = bool(long) and _is_named(split, rows, long[0], widest, kinds.decimal)
    if not named:
        long = [run for run in long if run.lines >= MIN_RUN]
        widest = max((run.width for run in long), default=width)
    if len({run.width for run in long}) < 2 or width not in {run.width for run in long}:
        return width, frozenset()
    first = long[0] if named else next(run for run in long if run.width == widest)

    def judged(width: int) -> list[Cells]:
        of_width = (line for line in lines if split.width(line) == width and likely[line.shape])
        return [split.cells(line) for line in islice(of_width, MAX_JUDGED)]

    narrow = {run.width for run in long if run.width < widest and run.place >= first.place}
    narrow = frozenset(w for w in narrow if _alike(judged(widest), judged(w), w, kinds))
    return (widest, narrow) if width == widest or width in narrow else (width, frozenset())


def _is_void(cells: Cells, kinds: CellKinds) -> bool:
    """True for a row of a stamp and missing samples."""
    found = {kinds[cell] for cell in cells}
    return "stamp" in found and found <= {"stamp", "missing", "word"}


def _runs(split: SplitLines, rows: set[str], kinds: CellKinds) -> list[_Run]:
    """The rows, of shapes that are `rows`, in runs of one width that no line of texts interrupts."""
    runs: list[_Run] = []
    parted = False  # `Gain;24` above the names is not one of the rows below
    for place, line in enumerate(split.lines):
        here = split.width(line)
        if line.shape not in rows:
            parted |= here > 1 and all(kinds[cell] == "text" for cell in split.cells(line))
        elif runs and runs[-1].width == here and not parted:
            runs[-1] = runs[-1]._replace(lines=runs[-1].lines + 1)
        else:
            runs.append(_Run(here, 1, place))
            parted = False
    return runs


def _is_named(split: SplitLines, rows: set[str], first: _Run, width: int, decimal: str) -> bool:
    """True where a line of `width` names, or a comment right above, begins the table."""
    above, begin = split.lines[: first.place], split.lines[first.place]
    if any(split.width(line) == width and line.shape not in rows for line in above):
        return True
    names = split.comment_above(begin)
    marked = bool(names) and names[0] in COMMENT_MARKS  # the # of `# a b` or a name itself
    return only_text(names, decimal) and width in (len(names), len(names) - marked)


def _alike(wide: list[Cells], narrow: list[Cells], width: int, kinds: CellKinds) -> bool:
    """True where the first `width` columns hold the same in both: it is not another table."""
    return all(
        column_type([cells[i] for cells in wide], kinds).suits(column_type([cells[i] for cells in narrow], kinds))
        for i in range(width)
    )


# The ways in which the first lines of a log could be split into rows, each weighed by how its cells look.
#
# Pure functions on text.


_BEGIN = re.compile(
    r"[\W_]*(?:(?:begin|start)(?: of)?[ _]?)?(?:data|end[ _]?of[ _]?header|end[ _]header|(?<=\*)end)[\W_]*",
    re.IGNORECASE,
)
_MAX_PREFACE = 2000
"""Lines above which a table begins."""
MIN_TEXT_SHARE = 0.04
"""Of the lines, the share that must look like data in a table of mostly text, whose rows all look alike."""
MIN_UNIFORM = 0.6
"""Of the lines with numbers, the share that must have one width: records of several lines are not a table."""
MIN_UNIFORM_LINES = 20
"""Fewest lines to judge that."""
_SOME = 64
"""Lines that are searched for one that shows that a file may hold one column."""
MIN_COMPLETE, MIN_COMPLETE_ROWS = 0.95, 20
"""Share of labelled lines that hold every label, and how many there must be, for the others to be damaged."""


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


def marked_begin(head: Sequence[str]) -> int:
    """Line number of `*END*`, `[Data]`, `@data`, below which a table begins; 0 where no line says so.

    There must be more lines with digits below it than above.
    """
    marks = [i for i, line in enumerate(head[:_MAX_PREFACE], 1) if len(line) < 40 and _BEGIN.fullmatch(line)]
    if not marks:
        return 0
    digits = [any(c.isdecimal() for c in line) and not is_comment(line) for line in head]
    return next((i for i in reversed(marks) if sum(digits[i:]) >= max(3, sum(digits[:i]))), 0)


def filled_width(table: HeadTable) -> int:
    """Cells of a row without those at its end that never hold anything."""
    width = table.width
    while width > 1 and not any(cells[width - 1] for _, cells in table.rows):
        width -= 1
    return width


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
    form, some = LineFormat(), first_of_each_shape(lines)
    stamped = {shape for shape, texts in some.items() if split_stamp(texts[0])}
    if sum(line.shape in stamped for line in lines) > len(lines) / 2:
        split = [(line, split_stamp(line.text)) for line in lines]
        lines = shaped([HeadLine(line.number, parts[1], parts[0]) for line, parts in split if parts is not None])
        form, some = replace(form, stamped=True), first_of_each_shape(lines)
    if any(split_checksum(texts[0]) for texts in some.values()):
        lines, checked = _without_checksums(lines)
        form = replace(form, checksum=checked)
    return lines, form


def _may_be_data(text: str) -> bool:
    return not is_blank(text) and not is_comment(text)


def _without_checksums(lines: list[HeadLine]) -> tuple[list[HeadLine], bool]:
    """The lines whose checksum is right, and those without digits; all of them where fewer than half have one."""
    sums = [(line, split_checksum(line.text)) for line in lines]
    checked = [line._replace(text=parts[0]) for line, parts in sums if parts and parts[1] == parts[2]]
    if len(checked) <= len(lines) / 2:
        return lines, False
    plain = [line for line, parts in sums if parts is None and not any(c.isdigit() for c in line.text)]
    return shaped(sorted(checked + plain, key=lambda line: line.number)), True  # a header has no checksum


def candidate_tables(lines: list[HeadLine], plan: Plan, head: Sequence[str]) -> list[HeadTable]:
    """Every way to split the lines of a head, each with a score of how much they look like data."""
    some = first_of_each_shape(lines)
    candidates = [] if plan.delimiter else [_teleplot(lines, some), _labelled(lines, some, plan)]
    kinds = {mark: CellKinds(mark, plan.options.missing_texts) for mark in ".,"}
    for delimiter in (plan.delimiter,) if plan.delimiter else _delimiters(lines, some, kinds):
        split = SplitLines(lines, some, delimiter, head)
        for decimal in ".," if plan.decimal is None else plan.decimal:
            form = LineFormat("table", delimiter, decimal)
            if decimal != delimiter:
                candidates.append(_as_table(split, form, kinds[decimal]))
            elif any('"' in shape for shape in some):  # decimal commas inside the quotes of a comma file
                candidates.append(_as_table(split, form, CellKinds(decimal, plan.options.missing_texts, delimiter)))
    return [table for table in candidates if table is not None]


def _delimiters(
    lines: list[HeadLine], shapes: Mapping[str, Sequence[str]], kinds: dict[str, CellKinds]
) -> list[str]:
    """The delimiters that are in the lines, and one that is not where some of the lines are a single number."""
    found = [mark for mark in DELIMITERS if any(_holds(shape, mark) for shape in shapes)]
    some = [line.text.strip(" \t") for line in lines[:: max(1, len(lines) // _SOME)]]
    if not found or any(known[text] in NUMERIC for known in kinds.values() for text in some):
        absent = next((mark for mark in DELIMITERS if mark not in found), None)
        found = [mark for mark in DELIMITERS if mark in found or mark == absent]
    return found


def _holds(text: str, delimiter: str) -> bool:
    """True where a line has the delimiter between two cells."""
    return delimiter in text if delimiter != " " else " " in text.strip(" \t") or "\t" in text


def _as_table(split: SplitLines, form: LineFormat, kinds: CellKinds) -> HeadTable | None:
    """The lines of the commonest width, weighed by how much they look like data."""
    lines = split.lines
    likely = {
        shape: sum(likeness(cells, kinds) for cells in rows) / len(rows) for shape, rows in split.some.items()
    }
    weight: defaultdict[int, float] = defaultdict(float)
    for line in lines:
        weight[split.width(line)] += likely[line.shape]
    width = max(weight, key=lambda width: weight[width], default=0)
    if not width or weight[width] < MIN_TEXT_SHARE * len(lines):
        return None
    width, narrow = grown_width(split, likely, width, kinds)
    total = weight[width] + sum(weight[w] for w in narrow)
    fitting = [line for line in lines if split.width(line) == width or split.width(line) in narrow]
    if len(lines) >= MIN_UNIFORM_LINES and total < MIN_UNIFORM * sum(weight.values()):
        first = next(line.number for line in fitting if likely[line.shape])
        above = [line for line in lines if line.number < first]
        if not above or split.width(above[-1]) != width or not only_text(split.cells(above[-1]), form.decimal):
            return None
    best = max(likely[line.shape] for line in fitting)
    rows = [(line.number, split.cells(line)) for line in fitting if likely[line.shape] >= best / 2]
    if narrow:
        rows = [(number, cells + ("",) * (width - len(cells))) for number, cells in rows]
    return HeadTable(total / len(lines), form, width, tuple(rows), narrow)


def _labelled(lines: list[HeadLine], some: Mapping[str, Sequence[str]], plan: Plan) -> HeadTable | None:
    """The lines of `name:value` pairs whose names come often and with numbers."""
    shapes = {shape for shape, texts in some.items() if any(map(find_labels, texts))}
    labelled = [line for line in lines if line.shape in shapes]
    pairs = [(line.number, dict(found[0])) for line in labelled if (found := find_labels(line.text))]
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
    form = LineFormat("labels", ",", ".", labels, complete=complete)
    return HeadTable(len(rows) / len(lines), form, len(labels), rows)


def _teleplot(lines: list[HeadLine], some: Mapping[str, Sequence[str]]) -> HeadTable | None:
    """The lines `>name:ms:value§unit`; other lines beside them are the program's log and do not count."""
    shapes = {shape for shape in some if shape.lstrip().startswith(">")}
    marked = [line for line in lines if line.shape in shapes]
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
_COMMA_INSIDE = re.compile(r"[0-9],[0-9]")
CLOSE = 0.9
"""A second way with at least this share of the best score could be meant as well."""
TABS = 0.75
"""Rows split at tabs are chosen with at least this share of the score of rows split at blanks."""
_MIN_ALIKE = 8


def weigh(lines: list[HeadLine], tables: list[HeadTable]) -> tuple[HeadTable | None, HeadTable | None]:
    """(best, close second) of the ways to split the lines; None where no way makes enough of them look like data.

    The second is a way that gives other rows than the best, with nearly its score.
    """
    found = [table for table in tables if table.score >= MIN_SHARE or _all_alike(lines, table)]
    tabs = max((table.score for table in found if table.form.delimiter == "\t"), default=0.0)
    # Where tabs split the rows, blanks are inside the cells: of a stamp, of a text.
    # So do commas, unless they only end cells: `10:00 21.5, 40`.
    commas = max((table.score for table in found if table.form.delimiter == ","), default=0.0)
    best = {".": max(tabs, commas), ",": tabs}
    found = [
        table for table in found if table.form.delimiter != " " or TABS * table.score > best[table.form.decimal]
    ]
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
    return score, teleplot, fits, _is_padded(table) or _ends_in_commas(lines, table), table.form.decimal == "."


def _ends_in_commas(lines: list[HeadLine], table: HeadTable) -> bool:
    """True for `21,5, 40,2`: a comma before a blank separates cells, one inside a number is its decimal mark."""
    if (table.form.delimiter, table.form.decimal, table.form.kind) != (" ", ",", "table"):
        return False
    some = [line.text for line in lines[:: max(1, len(lines) // _SOME)]]
    return 2 * sum(", " in text and _COMMA_INSIDE.search(text) is not None for text in some) > len(some)


def _names_fit(lines: list[HeadLine], table: HeadTable) -> bool:
    """True where the line above the first row holds one name per column."""
    above = [line for line in lines if line.number < table.rows[0][0]]
    if not above or table.form.kind != "table":
        return False
    cells = split_fields(above[-1].text, table.form.delimiter)
    whole = table.form.decimal != "," or not any("," in cell for cell in cells)
    # A separator may end each row.
    return whole and only_text(cells, table.form.decimal) and filled_width(table) <= len(cells) <= table.width


def _differs(best: HeadTable, other: HeadTable) -> bool:
    """True where another way gives other rows, not the same ones by another mark."""
    if best.form.kind != "table" or other.form.kind != "table":
        return False
    return best.width != other.width or [cells for _, cells in best.rows] != [cells for _, cells in other.rows]
