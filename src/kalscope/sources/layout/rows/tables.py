"""The ways in which the first lines of a log could be split into rows, each weighed by how its cells look.

Pure functions on text.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from kalscope.sources.grammar.cells import is_blank, is_comment, is_number
from kalscope.sources.grammar.labels import find_labels
from kalscope.sources.grammar.line_format import (
    LineFormat,
    split_checksum,
    split_stamp,
    split_teleplot,
)
from kalscope.sources.grammar.read_options import DELIMITERS
from kalscope.sources.layout.plan import Plan
from kalscope.sources.layout.rows.grown import SplitLines, grown_width
from kalscope.sources.layout.rows.kinds import NUMERIC, CellKinds, Cells, likeness, only_text
from kalscope.sources.layout.rows.shapes import HeadLine, first_of_each_shape, shaped

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


def candidate_lines(
    head: Sequence[str], samples: Iterable[Sequence[str]] = ()
) -> tuple[list[HeadLine], LineFormat]:
    """Lines that may hold data; stamp and checksum split off where most lines have one, which the form says."""
    lines = [HeadLine(i, text) for i, text in enumerate(head, 1) if _may_be_data(text)]
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
