"""Logs that gained a field: rows of two widths under one line of names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice
from typing import NamedTuple

from kalscope.sources.grammar.cells import COMMENT_MARKS, is_comment, split_fields
from kalscope.sources.layout.rows.kinds import CellKinds, Cells, column_type, only_text
from kalscope.sources.layout.rows.shapes import HeadLine

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
