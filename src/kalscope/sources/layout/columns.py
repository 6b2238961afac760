"""What the columns of a log are: names, units, the time, text. Pure functions on cells."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

from kalscope.sources.grammar.cells import MISSING, is_number
from kalscope.sources.grammar.timestamps import (
    TimeColumn,
)

Role = Literal["channel", "time", "text", "row name", "row number", "empty"]
Cells = tuple[str, ...]

STAMP_SHAPE = re.compile(
    r"[0-9]{1,4}[-/.][0-9]{1,2}[-/.][0-9]{1,4}(?:[T ]+[0-9]{1,2}[:.][0-9]{2}.*)?"
    r"|[0-9]{1,2}[:.][0-9]{2}[:.][0-9]{2}(?:[.,][0-9]+)?|[0-9]{1,2}:[0-9]{2}"
)
_BRACKETED = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")
_SUFFIXED = re.compile(r"(.+?)[_ ]([A-Za-zµμ%]+)")


def words(text: str) -> frozenset[str]:
    """The words of a text."""
    return frozenset(text.split())


_UNITS = words(
    """
    s sec second seconds ms us µs μs ns min h d yr year years v mv uv µv a ma ua µa g mg m mm cm km
    um µm m/s m/s2 m/s^2 m/s² m/s/s km/h mps ft in gal deg ° rad deg/s °/s dps rad/s rpm degc °c c
    celsius f degf °f k fahrenheit kelvin % %rh rh pa hpa kpa mpa mbar bar psi hz khz mhz lux lx ppm
    ppb count counts lsb adc raw w kw w/m2 w/m^2 w/m² n nm kg db dbm ohm kohm ω kω t ut µt gauss l
    ml l/min bpm
    """
)
# Suffixes of a channel's name that can hardly be anything else; one letter (a_g, a_x) could be.
_SUFFIX_UNITS = words(
    """
    mm cm km mv ma mg ms us degc degf hpa kpa mbar hz lux ppm ppb rpm dps kg
    """
)

HOST_AND_DEVICE = ("host time", "device time")
"""The first two columns of our own recordings of a live source: two clocks of one row, neither is a channel."""

ROW_NUMBER_NAME = "sample"
"""Header of the first column of our own CSV where a recording has no time: it counts the rows."""

_ROW_NUMBER_NAMES = frozenset(
    ("", "#", "count", "counter", "id", "idx", "index", "no", "no.", "nr", "row", "samples")
)
_MIN_COUNTED = 8


@dataclass(frozen=True)
class Column:
    """One field of the data lines."""

    name: str
    """Name without its unit, as the source says it; "" where it says none. Distinct among the channels."""
    unit: str = ""
    """Unit as the source says it; "" where it says none."""
    role: Role = "channel"
    """What becomes of it; only channels and the time are read."""


def named_column(text: str) -> Column:
    """`accel (m/s^2)` is accel in m/s^2; `Distance_cm` keeps its name, in cm; `CO(GT)` is a name."""
    text = "".join(c for c in text if c.isprintable()).strip()[:100]
    match = _BRACKETED.fullmatch(text)
    if match and match[1] and (match[2] is not None or _is_unit(match[3])):
        return Column(match[1], match[2] if match[2] is not None else match[3])
    match = _SUFFIXED.fullmatch(text)
    if match and match[2].lower() in _SUFFIX_UNITS:
        return Column(text, match[2])
    return Column(text)


def _is_unit(text: str) -> bool:
    return text.strip().lower() in _UNITS or re.search(r"[/^°²³%µ]", text) is not None


def are_units(cells: Cells) -> bool:
    """True for a row of units: each cell empty, "-", in brackets or known."""
    return all(not cell or cell != bare_unit(cell) or _is_unit(cell) or cell == "-" for cell in cells)


def bare_unit(unit: str) -> str:
    """The unit without its brackets; "" for "-"."""
    unit = unit[1:-1] if unit[:1] + unit[-1:] in ("[]", "()") and len(unit) > 1 else unit
    return "" if unit == "-" else unit.strip()


def role_of(column: Column, rows: list[Cells], index: int, decimal: str) -> Role:
    """Role of column `index` by its cells: a channel where one is a number, text where none is."""
    if column.role != "channel":
        return column.role
    cells = [row[index] for row in rows if row[index].lower() not in MISSING]
    if not cells:
        # A spreadsheet's trailing ";;": no name, nothing in it.
        return "empty" if not column.name and len(rows[0]) > 1 else "channel"
    if index == 0 and len(rows[0]) > 1 and _is_row_number(column.name, cells):
        return "row number"
    return "channel" if any(is_number(cell, decimal) for cell in cells) else "text"


def _is_row_number(name: str, cells: list[str]) -> bool:
    """True for Kalscope's own column of row numbers, and for another column named so that counts without a gap."""
    if name == ROW_NUMBER_NAME:
        return _counts(cells)
    if name.lower() not in _ROW_NUMBER_NAMES or len(cells) < _MIN_COUNTED or not _counts(cells):
        return False
    return int(cells[-1]) - int(cells[0]) == len(cells) - 1


def _counts(cells: list[str]) -> bool:
    """True for 0, 1, 2, … and 1, 2, 3, …, perhaps with a line left out."""
    if not all(cell.isascii() and cell.isdecimal() for cell in cells):
        return False
    numbers = [int(cell) for cell in cells]
    return numbers[0] <= 1 and all(b > a for a, b in pairwise(numbers))


def settle_roles(
    columns: list[Column], time: TimeColumn | None
) -> tuple[list[Column], TimeColumn | None, tuple[str, ...]]:
    """Columns with their final role and distinct channel names, the time column, and remarks about both.

    A time that stands alone is the channel: a file of rising numbers is a signal.
    """
    if time is not None and time.kind == "number" and sum(column.role != "empty" for column in columns) == 1:
        time = None
    if time is None:
        notes = ["no time column: samples are counted"]
    else:
        taken = time.indices
        if tuple(column.name for column in columns[:2]) == HOST_AND_DEVICE and {*taken} <= {0, 1}:
            taken = (0, 1)
        columns = [replace(column, role="time") if i in taken else column for i, column in enumerate(columns)]
        notes = [f'"{columns[time.index].name or f"column {time.index + 1}"}" is the time']
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
    distinct: list[str] = []
    for i, name in enumerate(names, 1):
        count = i if not name else 2
        candidate = name or f"value {count}"
        # A made-up name must not take one that a later column has of its own.
        while candidate in distinct or (candidate != name and candidate in given):
            candidate = f"{name or 'value'} {count}"
            count += 1
        distinct.append(candidate)
    return tuple(distinct)
