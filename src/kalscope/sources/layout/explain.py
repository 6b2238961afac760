"""The sentences that explain a layout, and that name another one that could be meant."""

from __future__ import annotations

from collections.abc import Sequence

from kalscope.sources.grammar.cells import NumberForm
from kalscope.sources.grammar.line_format import LineFormat
from kalscope.sources.layout.columns import Column
from kalscope.sources.layout.plan import Plan
from kalscope.sources.layout.rows.body import Body
from kalscope.sources.layout.rows.kinds import differ
from kalscope.sources.layout.rows.tables import HeadTable

_MARKS = {"\t": "tabs", " ": "blanks"}
_WORDS = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", " ": "space"}


def explain(
    form: LineFormat, plan: Plan, body: Body, columns: Sequence[Column], second: HeadTable | None
) -> list[str]:
    """How the lines are split, what is beside the data, and which other way comes close."""
    notes = [f"written by {plan.preface.instrument}"] if plan.preface.instrument else []
    if form.kind == "table":
        notes.append(table_note(form))
    if form.checksum:
        notes.append("each line ends with a checksum, which is checked")
    if form.stamped:
        notes.append("the stamp before each line is the time")
    left_out = body.beside & plan.preface.left_out
    for places, what in ((left_out, "no samples"), (body.beside - left_out, "metadata beside the data")):
        if places:
            notes.append(f"{_places(places)} {what}")
    notes += [
        f"{_named(column, i)}: {_about_numbers(column.form, form)}"
        for i, column in enumerate(columns)
        if column.form is not None
    ]
    if body.narrow:
        fields = " or ".join(map(str, sorted(body.narrow)))
        notes.append(f"successive rows of {fields} fields lack the last columns, which the logger added later")
    if second is not None:
        notes.append(_could_be(form, second))
    return notes


def explain_doubt(column: Column, index: int, form: NumberForm, rival: NumberForm, cells: Sequence[str]) -> str:
    """The question about a column whose numbers could be written in two ways."""
    example = next(cell for cell in cells if differ(form, rival, cell))
    word = "comma" if rival.decimal == "," else "point"
    return (
        f'is "{example}" in {_named(column, index)} {form.parse(example):.15g} or {rival.parse(example):.15g}?'
        f" The first was used; --decimal {word} selects the second"
    )


def table_note(form: LineFormat) -> str:
    """The sentence about delimiter and decimal mark."""
    mark = _MARKS.get(form.delimiter, f'"{form.delimiter}"')
    return f'columns are separated by {mark}, the decimal mark is "{form.decimal}"'


def _could_be(form: LineFormat, second: HeadTable) -> str:
    """The sentence about a close second: what it is, and the option that would take it."""
    other = second.form
    count = "1 column" if second.width == 1 else f"{second.width} columns"
    chosen: list[str] = []
    if other.delimiter != form.delimiter:
        chosen.append(f"--delimiter {_WORDS[other.delimiter]}")
    if other.decimal != form.decimal:
        chosen.append(f"--decimal {'comma' if other.decimal == ',' else 'point'}")
    return f"it could also be {count}: {' '.join(chosen)}"


def _about_numbers(number: NumberForm, form: LineFormat) -> str:
    """How the numbers of a column differ from those of the rest of the table."""
    said: list[str] = []
    if number.suffix:
        said.append(f'each number is followed by its unit, "{number.suffix}"')
    if number.decimal != form.decimal:
        said.append(f'the decimal mark is "{number.decimal}"')
    if number.thousands:
        said.append(f'"{"." if number.decimal == "," else ","}" or a blank separates thousands')
    return ", ".join(said)


def _named(column: Column, index: int) -> str:
    return f'"{column.name}"' if column.name else f"column {index + 1}"


def _places(indices: frozenset[int]) -> str:
    """`column 3 holds`, `columns 1, 2 and 3 hold`."""
    numbers = [str(i + 1) for i in sorted(indices)]
    if len(numbers) == 1:
        return f"column {numbers[0]} holds"
    return f"columns {', '.join(numbers[:-1])} and {numbers[-1]} hold"
