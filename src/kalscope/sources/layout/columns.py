"""What the columns of a log are: names, units, the time, text. Pure functions on cells."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

from kalscope.sources.grammar.cells import MISSING, NumberForm
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.grammar.units import is_unit, is_unit_suffix
from kalscope.sources.layout.rows.kinds import ColumnType

Role = Literal["channel", "time", "text", "row name", "row number", "metadata", "empty", "series"]
"""How a column is used; "metadata" is beside the data in the first rows only."""

_INDEX = re.compile(r"\s*(?:[0-9]+|[xyzijk])\s*", re.IGNORECASE)
_SUFFIX = re.compile(r"[A-Za-zµμ%]+")


HOST_AND_DEVICE = ("host time", "device time")
"""The first two columns of our own recordings of a live source: two clocks of one row, neither is a channel."""

ROW_NUMBER_NAME = "sample"
"""Header of the first column of our own CSV where a recording has no time: it counts the rows."""

COUNTING_NAMES = frozenset(("", "#", "count", "counter", "id", "idx", "index", "no", "no.", "nr", "row", "samples"))
"""Names, in lower case, of columns that may number the rows."""
_MIN_COUNTED = 8


@dataclass(frozen=True)
class Column:
    """One field of the data lines."""

    name: str
    """Name without its unit, as the source gives it; "" where it gives none. Distinct among the channels."""
    unit: str = ""
    """Unit as the source gives it; "" where it gives none."""
    role: Role = "channel"
    """How it is used; only channels and the time are read."""
    form: NumberForm | None = None
    """How its numbers are written, where that differs from the rest of the table."""
    words: frozenset[str] = frozenset()
    """Texts, in lower case, that say "no sample" in this column, besides those that say it everywhere."""


def named_column(text: str) -> Column:
    """`accel (m/s^2)` is accel in m/s^2, `Temp, °C (S/N: 10229)` is Temp in °C, `Pressure in hPa` Pressure in hPa.

    `Distance_cm` keeps its name, in cm; `CO(GT)` is a name.
    """
    text = "".join(c for c in text if c.isprintable()).strip()[:100]
    bare, unit = _split_brackets(text)
    # Square brackets hold a unit, unless they count or name an axis: `axisP[1]`, `acc[x]`.
    if bare and (is_unit(unit) or (text[-1] == "]" and not _INDEX.fullmatch(unit))):
        return Column(bare, unit)
    for mark in (", ", " in "):
        name, _, unit = (bare if ":" in unit else text).rpartition(mark)
        if name and is_unit(unit):
            return Column(name.rstrip(), unit.strip())
    place = max(text.rfind("_"), text.rfind(" "))
    suffix = text[place + 1 :]
    if place > 0 and _SUFFIX.fullmatch(suffix) and is_unit_suffix(suffix):
        return Column(text, suffix)
    return Column(text)


def _split_brackets(text: str) -> tuple[str, str]:
    """(`accel`, `m/s^2`) of `accel (m/s^2)`; ("", "") where the text does not end in a bracket."""
    opening = {"]": "[", ")": "("}.get(text[-1:])
    start = -1 if opening is None else text.rfind(opening)
    inside = text[start + 1 : -1]
    return ("", "") if start < 0 or text[-1] in inside else (text[:start].rstrip(), inside)


def role_of(column: Column, cells: Sequence[str], index: int, kind: ColumnType, width: int) -> Role:
    """Role of column `index` by its cells in the head: a channel where one is a number, text where none is."""
    if column.role != "channel":
        return column.role
    if kind.kind == "empty":
        # A spreadsheet's trailing ";;": no name, nothing in it.
        return "empty" if not column.name and width > 1 and not any(cells) else "channel"
    said = [cell for cell in cells if cell.lower() not in MISSING]
    if index == 0 and width > 1 and said and _is_row_number(column.name, said):
        return "row number"
    return "channel" if kind.numbers else "text"


def _is_row_number(name: str, cells: list[str]) -> bool:
    """True for Kalscope's own column of row numbers, and for a similarly named one that counts without a gap."""
    if name == ROW_NUMBER_NAME:
        return _counts(cells)
    if name.lower() not in COUNTING_NAMES or len(cells) < _MIN_COUNTED or not _counts(cells):
        return False
    return int(cells[-1]) - int(cells[0]) == len(cells) - 1


def _counts(cells: list[str]) -> bool:
    """True for 0, 1, 2, … and 1, 2, 3, …, perhaps with a line left out."""
    if not all(cell.isascii() and cell.isdecimal() and len(cell) < 18 for cell in cells):
        return False
    numbers = [int(cell) for cell in cells]
    return numbers[0] <= 1 and all(b > a for a, b in pairwise(numbers))


def settle_roles(
    columns: list[Column], time: TimeColumn | None
) -> tuple[list[Column], TimeColumn | None, tuple[str, ...]]:
    """Columns with their final role and distinct channel names, the time column, and remarks about both.

    A time column on its own is the channel: a file of rising numbers is a signal.
    """
    if time is not None and time.kind == "number" and sum(column.role != "empty" for column in columns) == 1:
        time = None
    if time is None:
        notes = ["no time column: samples are counted"]
    else:
        taken = (*time.indices, *time.also)
        if tuple(column.name for column in columns[:2]) == HOST_AND_DEVICE and {*taken} <= {0, 1}:
            taken = (0, 1)
        columns = [replace(column, role="time") if i in taken else column for i, column in enumerate(columns)]
        notes = [f'"{columns[time.index].name or f"column {time.index + 1}"}" is the time', *time.notes]
    channels = [i for i, column in enumerate(columns) if column.role == "channel"]
    columns = list(columns)
    for i, name in zip(channels, distinct_names([columns[i].name for i in channels]), strict=True):
        if columns[i].name and columns[i].name != name:
            notes.append(f'"{columns[i].name}" is repeated and is renamed "{name}"')
        columns[i] = replace(columns[i], name=name)
    return columns, time, tuple(notes)


def distinct_names(names: list[str]) -> tuple[str, ...]:
    """Distinct names: the second `temp` becomes `temp 2`, those without a name `value 1`, `value 2`."""
    given = {name for name in names if name}
    distinct: dict[str, None] = {}
    counts: dict[str, int] = {}
    for i, name in enumerate(names, 1):
        count = counts.get(name, 2) if name else i
        candidate = name or f"value {count}"
        # A made-up name must not be the given name of a later column.
        while candidate in distinct or (candidate != name and candidate in given):
            candidate = f"{name or 'value'} {count}"
            count += 1
        distinct[candidate], counts[name] = None, count
    return tuple(distinct)
