"""The ways in which the first lines of a log could be split into rows, each weighed by how its cells look.

Pure functions on text.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from kalscope.sources.grammar.cells import is_blank, is_comment, is_number, split_fields
from kalscope.sources.grammar.line_format import (
    LineFormat,
    split_checksum,
    split_stamp,
    split_teleplot,
)
from kalscope.sources.grammar.read_options import DELIMITERS
from kalscope.sources.layout.labels import find_labels
from kalscope.sources.layout.plan import Plan
from kalscope.sources.layout.rows.kinds import NUMERIC, CellKinds, Cells, column_type, likeness, only_text

MIN_UNIFORM = 0.6
"""Of the lines with numbers, the share that must have one width: records of several lines are no table."""
MIN_UNIFORM_LINES = 20
"""Lines it takes to judge that."""
_SOME = 64
"""Lines of which one shows that a file may hold one column."""
MAX_JUDGED = 500
"""Rows by which those of two widths are compared."""
MIN_COMPLETE, MIN_COMPLETE_ROWS = 0.95, 20
"""Share of labelled lines that hold every label, and how many there must be, for the others to be damaged."""
MIN_RUN, MIN_NAMED_RUN = 8, 3
"""Lines in a row of another width that are no damage: the logger gained a field; and below its name."""


@dataclass(frozen=True)
class HeadLine:
    """One line that may hold data."""

    number: int
    """Line number, from 1; beyond the head for lines from further down the file."""
    text: str
    """The line without stamp and checksum."""
    stamp: str = ""
    """The stamp that a monitor wrote before it; "" where there is none."""


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


def candidate_lines(
    head: Sequence[str], samples: Iterable[Sequence[str]] = ()
) -> tuple[list[HeadLine], LineFormat]:
    """Lines that may hold data; stamp and checksum split off where most lines have one, which the form says."""
    lines = [HeadLine(i, text) for i, text in enumerate(head, 1)]
    for sample in samples:
        # A line is left out, so that the last line above is no neighbour of the first below.
        lines += [HeadLine(i, text) for i, text in enumerate(sample, lines[-1].number + 2 if lines else 2)]
    lines = [line for line in lines if not is_blank(line.text) and not is_comment(line.text)]
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


def candidate_tables(lines: list[HeadLine], plan: Plan) -> list[HeadTable]:
    """Every way to split the lines, with how much each makes them look like data."""
    candidates = [] if plan.delimiter else [_teleplot(lines), _labelled(lines, plan)]
    kinds = {mark: CellKinds(mark, plan.options.missing_texts) for mark in ".,"}
    for delimiter in (plan.delimiter,) if plan.delimiter else _delimiters(lines, kinds):
        split = [(line.number, tuple(split_fields(line.text, delimiter))) for line in lines]
        for decimal in ".," if plan.decimal is None else plan.decimal:
            form = LineFormat("table", delimiter, decimal)
            if decimal != delimiter:
                candidates.append(_as_table(split, form, kinds[decimal]))
            elif any('"' in line.text for line in lines):  # decimal commas inside the quotes of a comma file
                candidates.append(_as_table(split, form, CellKinds(decimal, plan.options.missing_texts, delimiter)))
    return [table for table in candidates if table is not None]


def _delimiters(lines: list[HeadLine], kinds: dict[str, CellKinds]) -> list[str]:
    """The delimiters that are in the lines, and one that is not where some of the lines are a single number."""
    found = [mark for mark in DELIMITERS if any(_holds(line.text, mark) for line in lines)]
    some = [line.text.strip(" \t") for line in lines[:: max(1, len(lines) // _SOME)]]
    if not found or any(known[text] in NUMERIC for known in kinds.values() for text in some):
        absent = next((mark for mark in DELIMITERS if mark not in found), None)
        found = [mark for mark in DELIMITERS if mark in found or mark == absent]
    return found


def _holds(text: str, delimiter: str) -> bool:
    """True where a line has the delimiter between two cells."""
    return delimiter in text if delimiter != " " else " " in text.strip(" \t") or "\t" in text


def _as_table(split: list[tuple[int, Cells]], form: LineFormat, kinds: CellKinds) -> HeadTable | None:
    """The lines of the commonest width, weighed by how much they look like data."""
    likely = {number: likeness(cells, kinds) for number, cells in split}
    weight: defaultdict[int, float] = defaultdict(float)
    for number, cells in split:
        weight[len(cells)] += likely[number]
    width = max(weight, key=lambda width: weight[width], default=0)
    if not width or not weight[width]:
        return None
    width, narrow = _grown(split, likely, width, kinds)
    total = weight[width] + sum(weight[w] for w in narrow)
    fitting = [(number, cells) for number, cells in split if len(cells) == width or len(cells) in narrow]
    if len(split) >= MIN_UNIFORM_LINES and total < MIN_UNIFORM * sum(weight.values()):
        first = next(number for number, _ in fitting if likely[number])
        above = [cells for number, cells in split if number < first]
        if not above or len(above[-1]) != width or not only_text(above[-1], form.decimal):
            return None
    best = max(likely[number] for number, _ in fitting)
    rows = tuple((n, cells + ("",) * (width - len(cells))) for n, cells in fitting if likely[n] >= best / 2)
    return HeadTable(total / len(split), form, width, rows, narrow)


def _grown(
    split: list[tuple[int, Cells]], likely: dict[int, float], width: int, kinds: CellKinds
) -> tuple[int, frozenset[int]]:
    """The width of the rows, and the smaller widths of the rows above that a later field was added to.

    `width` is the commonest. A file grows where runs of rows of another width stand below a line of names for the
    widest, or between the rows of the widest.
    """
    runs: list[tuple[int, int, int]] = []  # width, lines, place of the first
    parted = False  # `Gain;24` above the names is no row of those below
    for i, (number, cells) in enumerate(split):
        if not likely[number]:
            parted |= len(cells) > 1 and all(kinds[cell] == "text" for cell in cells)
        elif runs and runs[-1][0] == len(cells) and not parted:
            runs[-1] = (runs[-1][0], runs[-1][1] + 1, runs[-1][2])
        else:
            runs.append((len(cells), 1, i))
            parted = False
    long = [run for run in runs if run[1] >= MIN_NAMED_RUN and run[0] > 1]
    widest = max((run[0] for run in long), default=width)
    named = bool(long) and any(len(cells) == widest and not likely[number] for number, cells in split[: long[0][2]])
    long = long if named else [run for run in long if run[1] >= MIN_RUN]
    if len({run[0] for run in long}) < 2 or width not in {run[0] for run in long}:
        return width, frozenset()
    first = long[0][2] if named else next(run[2] for run in long if run[0] == widest)
    narrow = frozenset(run[0] for run in long if run[0] < widest and run[2] >= first)
    wide = [cells for number, cells in split if len(cells) == widest and likely[number]][:MAX_JUDGED]
    narrow = frozenset(
        w
        for w in narrow
        if _alike(
            wide, [cells for number, cells in split if len(cells) == w and likely[number]][:MAX_JUDGED], w, kinds
        )
    )
    return (widest, narrow) if width == widest or width in narrow else (width, frozenset())


def _alike(wide: list[Cells], narrow: list[Cells], width: int, kinds: CellKinds) -> bool:
    """True where the first `width` columns hold the same in both: no table of another kind."""
    return all(
        column_type([cells[i] for cells in wide], kinds).suits(column_type([cells[i] for cells in narrow], kinds))
        for i in range(width)
    )


def _labelled(lines: list[HeadLine], plan: Plan) -> HeadTable | None:
    """The lines of `name:value` pairs whose names come often and with numbers."""
    pairs = [(line.number, dict(found[0])) for line in lines if (found := find_labels(line.text))]
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
