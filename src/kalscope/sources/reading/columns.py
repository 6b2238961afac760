"""What the columns of a log hold: numbers, stamps, text; names, units, the time."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count, pairwise
from typing import Literal, NamedTuple

from kalscope.errors import BadSetting
from kalscope.recording import Assumption
from kalscope.sources.grammar.cells import (
    MISSING,
    MISSING_WORDS,
    NUMBER,
    OTHER_MARK,
    OVERFLOWS,
    SUFFIX_UNITS,
    NumberForm,
    is_grouped,
    is_measure,
    is_number,
    is_unit,
    split_measure,
    words,
)
from kalscope.sources.grammar.line_format import SERIES_KEY
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.grammar.timestamps import TimeColumn, is_stamp, is_weekday, month_of, row_stamp_parser
from kalscope.sources.reading.preface import Preface, find_preface

# Lines that differ in their digits only: the first few of each shape are judged for all of them.


_NUMBER = re.compile("[0-9]+")


class HeadLine(NamedTuple):
    """One line that may hold data; thousands are made for each file, and a dataclass is slow to make."""

    number: int
    """Line number, from 1; beyond the head for lines from further down the file."""
    text: str
    """The line without stamp and checksum."""
    stamp: str
    """The stamp that a monitor wrote before it; "" where there is none."""
    shape: str
    """What is the same in all lines that differ in their digits only: the text with 0 for each run."""


def head_line(number: int, text: str, stamp: str = "") -> HeadLine:
    """The line with its shape."""
    return HeadLine(number, text, stamp, _NUMBER.sub("0", text))


def first_of_each_shape(lines: Iterable[HeadLine]) -> Mapping[str, Sequence[str]]:
    """The texts of the first few lines of each shape."""
    found = defaultdict[str, list[str]](list)
    for line in lines:
        if len(texts := found[line.shape]) < 4:  # 0,123 and 1,234 may be read differently
            texts.append(line.text)
    return found


# What the columns of a log are: names, units, the time, text. Pure functions on cells.


Role = Literal["channel", "time", "text", "row name", "row number", "metadata", "empty", "series"]
"""How a column is used; "metadata" is beside the data in the first rows only."""

_INDEX = re.compile(r"\s*(?:[0-9]+|[xyzijk])\s*", re.IGNORECASE)
HOST_AND_DEVICE = ("host time", "device time")
"""The first two columns of our own recordings of a live source: two clocks of one row, neither is a channel."""
ROW_NUMBER_NAME = "sample"
"""Header of the first column of our own CSV where a recording has no time: it counts the rows."""

COUNTING_NAMES = frozenset(
    ("", "#", "count", "counter", "id", "idx", "index", "no", "no.", "nr", "number", "row", "samples")
)
"""Names, in lower case, of columns that may number the rows."""


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
    return Column(text, suffix if place > 0 and suffix.lower() in SUFFIX_UNITS else "")


def _split_brackets(text: str) -> tuple[str, str]:
    """(`accel`, `m/s^2`) of `accel (m/s^2)`; ("", "") where the text does not end in a bracket."""
    bare, opening, inside = text[:-1].rpartition({"]": "[", ")": "("}.get(text[-1:], "\n"))
    return (bare.rstrip(), inside) if opening and text[-1] not in inside else ("", "")


def role_of(column: Column, cells: Sequence[str], index: int, kind: ColumnType, width: int) -> Role:
    """Role of column `index` by its cells in the head: a channel where one is a number, text where none is."""
    if column.role != "channel":
        return column.role
    if kind.kind == "empty":
        # A spreadsheet's trailing ";;": no name, nothing in it. `tInc = 1e-06` is a setting of the instrument.
        nameless = not column.name or re.search(r"= *[-+]?[0-9.]", column.name)
        return "empty" if nameless and width > 1 and not any(cells) else "channel"
    said = [cell for cell in cells if cell.lower() not in MISSING]
    if index == 0 and width > 1 and said and _is_row_number(column.name, said):
        return "row number"
    return "channel" if kind.numbers else "text"


def _is_row_number(name: str, cells: list[str]) -> bool:
    """True for Kalscope's own column of row numbers, and for a similarly named one that counts without a gap."""
    own = name == ROW_NUMBER_NAME
    named = own or (name.lower() in COUNTING_NAMES and len(cells) >= 8)
    if not named or not all(cell.isascii() and cell.isdecimal() and len(cell) < 18 for cell in cells):
        return False
    numbers = [int(cell) for cell in cells]
    rising = numbers[0] <= 1 and all(b > a for a, b in pairwise(numbers))
    return rising and (own or numbers[-1] - numbers[0] == len(numbers) - 1)


def settle_roles(
    columns: list[Column], time: TimeColumn | None
) -> tuple[list[Column], TimeColumn | None, list[str]]:
    """Columns with their final role and distinct channel names, the time column, and remarks about both.

    A time column on its own is the channel: a file of rising numbers is a signal.
    """
    if time is not None and time.kind == "number" and sum(column.role != "empty" for column in columns) == 1:
        time = None
    if time is None:
        notes = ["no time column: samples are counted"]
    else:
        taken = time.indices
        if tuple(column.name for column in columns[:2]) == HOST_AND_DEVICE and {*taken} <= {0, 1}:
            taken = (0, 1)
        elif time.kind == "calendar":  # beside a whole stamp these repeat a part of it
            parts = ("year", "month", "day", "hour", "minute")
            taken = (*taken, *(i for i, column in enumerate(columns) if column.name.lower() in parts))
        columns = [replace(column, role="time") if i in taken else column for i, column in enumerate(columns)]
        notes = [f'"{columns[time.index].name or f"column {time.index + 1}"}" is the time', *time.notes]
    channels = [i for i, column in enumerate(columns) if column.role == "channel"]
    columns = list(columns)
    for i, name in zip(channels, distinct_names([columns[i].name for i in channels]), strict=True):
        if columns[i].name and columns[i].name != name:
            notes.append(f'"{columns[i].name}" is repeated and is renamed "{name}"')
        columns[i] = replace(columns[i], name=name)
    return columns, time, notes


def distinct_names(names: list[str]) -> tuple[str, ...]:
    """Distinct names: the second `temp` becomes `temp 2`, those without a name `value 1`, `value 2`."""
    distinct: dict[str, None] = {}
    for i, name in enumerate(names, 1):
        numbered = (f"{name or 'value'} {k}" for k in count(2 if name else i))
        # A made-up name must not be the given name of a later column.
        free = (made for made in numbered if made not in distinct and made not in names)
        distinct[name if name and name not in distinct else next(free)] = None
    return tuple(distinct)


# What is decided before anything is weighed: by the user, else by what the file says above its table.


class Plan(NamedTuple):
    """The choices that hold for one file; what is None is weighed."""

    options: ReadOptions
    """The choices of the user."""
    preface: Preface
    """What the lines above the table say, where the user did not choose otherwise."""


def make_plan(head: Sequence[str], options: ReadOptions) -> Plan:
    """The choices for a file with this head.

    Raises:
        BadSetting: a row is chosen that the head of the file does not have.
    """
    names, units = options.header_row, options.unit_row
    for word, row in (("header", names), ("unit", units)):
        if row is not None and row > len(head):
            must = f"{word} row must be one of the first {len(head)} lines, above the data"
            raise BadSetting(f"{must} (got --{word}-row {row})")
    preface = find_preface(head)
    if names is not None:
        preface = replace(preface, header_row=names)
    first = max(preface.first_row, (names or 0) + 1, (units or 0) + 1)
    return Plan(options, replace(preface, first_row=first))


# What each cell of the head looks like, and what a column of such cells holds. Pure functions on cells.


Cells = tuple[str, ...]
CellKind = Literal["number", "other number", "grouped", "measure", "missing", "word", "stamp", "text"]
"""A plain number, one with the other decimal mark, one with possible thousands separators, one with its unit, an
ordinary missing value, a word that loggers write for one, a stamp, anything else."""

NUMERIC: tuple[CellKind, ...] = ("number", "other number", "grouped", "measure")
"""The kinds that are numbers."""

_ANY_DIGIT = str.maketrans("123456789", "000000000")
"""Makes a shape of a text: each digit becomes 0."""
_HEXADECIMAL = re.compile(r"(?:0[xX])?[0-9A-Fa-f]{2,16}")
_MIN_TEXTS = 3
"""Cells of text by which a column of hexadecimal words, or a word that says "no sample", is known."""


class CellKinds(dict[str, CellKind]):
    """The kind of each cell; a repeated cell is judged once."""

    def __init__(self, decimal: str, words: Iterable[str] = (), delimiter: str = "") -> None:
        """Args: decimal mark of the table, more texts, in lower case, that say "no sample", and the delimiter."""
        super().__init__()
        self.decimal = decimal
        # In the quotes of a comma file "1,234" may be either.
        self._quoted = decimal == delimiter
        self._words = MISSING_WORDS.union(OVERFLOWS, words)
        self._shapes = defaultdict[str, list[bool]](list)

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
        is_listed = not cell.strip("0123456789.,+-eE;| \t") and any(mark in cell for mark in ",;|\t")
        if not is_listed and self._is_stamp(cell):
            return "stamp"
        if is_grouped(cell) or NUMBER[OTHER_MARK[self.decimal]].fullmatch(cell):
            return "grouped" if is_grouped(cell) else "other number"
        measure = split_measure(cell)
        return "measure" if measure is not None and is_measure(measure[1]) else "text"

    def _is_stamp(self, cell: str) -> bool:
        """Whether a cell is a stamp; of those that differ in their digits only, the first few stand for all."""
        shape = cell.translate(_ANY_DIGIT)
        if len(cell) < 8 or len(cell) - shape.count("0") < 2:
            return is_stamp(cell)  # 12.50 may be a clock, 99.50 is not
        judged = self._shapes[shape]
        if len(judged) < 3:
            judged.append(is_stamp(cell))
        return judged[0] if len(set(judged)) == 1 else is_stamp(cell)


def only_text(cells: Sequence[str], decimal: str) -> bool:
    """True where no cell is a number, a stamp or a missing value, and there are cells at all."""
    kinds = CellKinds(decimal)
    return any(cells) and all(not cell or kinds[cell] not in ("number", "stamp", "missing") for cell in cells)


def likeness(cells: Cells, kinds: CellKinds) -> float:
    """Share of the cells that a data line may hold, 0…1; 0 where none is a number."""
    found = [kinds[cell] for cell in cells]
    numbers = float(found.count("number"))
    timed = "stamp" in found and 2 * (found.count("measure") + numbers) >= len(cells)
    # "outside 21 °C, wind 3 m/s" is prose
    if timed or "text" not in found or not any(" " in cell for cell in cells):
        numbers += found.count("measure")
    if len(cells) == 1 and found[0] == "grouped":
        numbers += "." in cells[0] and "," in cells[0]
    if len(cells) > 1:  # one `12,5` alone is two numbers, or one by the other mark
        numbers += 0.25 * found.count("other number") + 0.5 * found.count("grouped")
    others = found.count("missing") + found.count("word") + found.count("stamp")
    is_void = "stamp" in found and others == len(cells) > 1  # a stamp and missing samples
    return (numbers + others) / len(cells) if numbers or is_void else 0.0


@dataclass(frozen=True)
class ColumnType:
    """What most cells of a column hold."""

    kind: Literal["number", "stamp", "text", "empty"]
    """The majority among the cells that are not missing; "empty" where all are."""
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
        if kind in ("missing", "word") or self.kind in ("text", "empty") or cell.lower() in self.words:
            return "missing"
        if kind == "measure" and not self.measured:
            return "strange"  # `5V` above numbers is a name
        is_number = kind in NUMERIC
        return "fits" if is_number == (self.kind == "number") and kind != "text" else "strange"


def column_type(cells: Sequence[str], kinds: CellKinds) -> ColumnType:
    """What a column holds, by its cells."""
    counts = Counter(map(kinds.__getitem__, cells))
    numbers = sum(counts[kind] for kind in NUMERIC)
    measured = counts["measure"] > numbers / 2
    stamps, texts = counts["stamp"], counts["text"]
    if not numbers + stamps + texts:
        return ColumnType("empty")
    is_even = texts >= _MIN_TEXTS and len({len(cell) for cell in cells}) == 1
    if is_even and all(map(_HEXADECIMAL.fullmatch, cells)):
        return ColumnType("text")  # 4E, 1f03, 0x1A: those without a letter are no decimal numbers
    if numbers >= max(stamps, texts):
        said = frozenset(cell.lower() for cell in cells if kinds[cell] == "text" and texts >= _MIN_TEXTS)
        return ColumnType("number", numbers, measured, said if len(said) == 1 else frozenset())
    return ColumnType("stamp" if stamps >= texts else "text", numbers)


def number_form(cells: Sequence[str], kinds: CellKinds, wanted: str | None) -> tuple[NumberForm, NumberForm | None]:
    """How the numbers of a column are written, and how else they could be; None where nothing else fits.

    The decimal mark is that of the table where that fits as many cells as any other; `wanted`, the user's choice,
    outranks it.
    """
    plain = NumberForm(wanted or kinds.decimal)
    numeric = [cell for cell in cells if kinds[cell] in NUMERIC]
    measures = [parts[1] for cell in numeric if kinds[cell] == "measure" and (parts := split_measure(cell))]
    if measures and 2 * len(measures) >= len(numeric):
        plain = replace(plain, suffix=Counter(measures).most_common(1)[0][0])
    usual = ("number",) if plain.decimal == kinds.decimal else ()
    if all(kinds[cell] in usual or (kinds[cell] in ("number", "measure") and plain.fits(cell)) for cell in numeric):
        return plain, None  # 20.271C is no more in doubt than 20.271
    # "1,234" above "2,345": English thousands rather than decimal commas.
    marks = [wanted] if wanted else [kinds.decimal, OTHER_MARK[kinds.decimal]]
    forms = [NumberForm(mark, thousands, plain.suffix) for mark in marks for thousands in (False, True)]
    counts = {form: sum(map(form.fits, numeric)) for form in forms}
    best = max(forms, key=lambda form: counts[form])
    equals = (form for form in forms if counts[form] == counts[best])
    return best, next((form for form in equals if any(differ(form, best, cell) for cell in numeric)), None)


def differ(form: NumberForm, rival: NumberForm, cell: str) -> bool:
    """True where both forms read a cell, and read different numbers."""
    return form.fits(cell) and rival.fits(cell) and len({form.parse(cell), rival.parse(cell)} - {None}) == 2


# Long ("tidy") tables: one value per row, beside the name of what was measured, as databases export them.
#
# Home Assistant writes `entity_id,state,last_changed`, InfluxDB `_time,_value,_field,_measurement` and tags, others
# time, name, value and perhaps the unit.


MAX_SERIES = 256
"""Distinct names that are read from one long table."""

UNIT_NAMES = words("unit units unit_of_measurement uom")
"""Names of a column that holds the unit of each value, lower case."""

_NAMES = words(
    """
    name varname entity entity_id sensor sensor_id sensor_name sensorname field _field _measurement measurement key
    variable parameter channel signal metric tag topic series quantity attribute point
    """
)
_VALUES = words("value _value state reading val sensor_value measured_value")
_NO_TAGS = words("result table _start _stop")
_KEYS = _NAMES | words(
    """
    id device device_id deviceid dev dev_id node node_id nodeid mac mac_address address addr room location place
    station station_id site probe unit_id serial sn imei eui deveui dev_eui name_id ch port slot board source src
    pid gpu cpu core
    """
)
"""Names of a column that says which sensor a row is of, beside its values."""


def mark_series(
    columns: list[Column], rows: list[Cells], time: TimeColumn | None, decimal: str
) -> tuple[list[Column], list[str]]:
    """The columns of a long table with the role "series" for those that name the value, and a note about it.

    Rows that hold several values, each row of one of several sensors, are long as well. Any other table is returned
    unchanged. Few tables are long, so the rule is strict: a column named as such holds
    repeated texts, one named as such holds the values, and no other column but the time holds numbers.
    """
    bases = ["_".join(column.name.lower().split()) for column in columns]
    times = time.indices if time is not None else ()
    values = [i for i, base in enumerate(bases) if base in _VALUES and i not in times]
    by_field = "_field" in bases and "_value" in bases  # InfluxDB: its other texts are tags
    texts = [i for i, column in enumerate(columns) if column.role == "text" and i not in times]
    names = [i for i in texts if bases[i] in _NAMES and i not in values]
    numbers = [i for i, column in enumerate(columns) if column.role == "channel" and i not in (*times, *values)]
    units = [i for i in texts if bases[i] in UNIT_NAMES]
    named = {*names, *(i for i in texts if bases[i] in _KEYS)}
    by_unit = _are_of_units(rows, sorted(named), units)
    if len(values) == 1 and (names or by_unit) and (by_field or by_unit or not numbers) and len(rows) >= 4:
        keys = [i for i in texts if by_field and bases[i] not in _NO_TAGS and i not in values] or sorted(named)
        keys = [i for i in keys if i in names or by_field or by_unit or _parts(rows, names, i)]
        few = len({tuple(row[i] for i in keys) for row in rows}) <= len(rows) / 2
        is_long = few and any(is_number(row[values[0]], decimal) for row in rows)
        roles: dict[int, Role] = {**dict.fromkeys(numbers, "text"), values[0]: "channel"}
        note = "each row holds one value, named by " + ", ".join(f'"{columns[i].name}"' for i in keys)
    else:
        others = (i for i in range(len(columns)) if i not in times)
        found = (i for i in others if _is_key(i, columns, rows, time, decimal))
        tagged = [i for i, column in enumerate(columns) if column.name == SERIES_KEY]
        finest = sorted(found, key=lambda i: -len({row[i] for row in rows}))
        keys, roles = tagged or finest[:1], {}
        is_long, name = bool(keys), "".join(columns[i].name or f"column {i + 1}" for i in keys)
        note = f'each row is of one of {len({row[i] for row in rows for i in keys})} sensors, by "{name}"'
        note = note if tagged else Assumption(note)
    if not is_long:
        return columns, []
    roles |= dict.fromkeys((*keys, *units), "series")
    return [replace(column, role=roles.get(i, column.role)) for i, column in enumerate(columns)], [note]


def _parts(rows: list[Cells], names: list[int], key: int) -> bool:
    """Whether a key, such as the room, parts the rows of a name: temp of the kitchen, temp of the bath."""
    whole = {tuple(row[i] for i in names) for row in rows}
    return len({tuple(row[i] for i in (*names, key)) for row in rows}) > len(whole)


def _are_of_units(rows: list[Cells], names: list[int], units: list[int]) -> bool:
    """Whether each name has its own unit in a column of units, of which there are several."""
    if len(units) != 1:
        return False
    found = {(*(row[i] for i in names), row[units[0]]) for row in rows}
    return len({pair[:-1] for pair in found}) == len(found) > 1 < len({pair[-1] for pair in found})


def _is_key(index: int, columns: list[Column], rows: list[Cells], time: TimeColumn | None, decimal: str) -> bool:
    """True for a column that says which sensor each row is of.

    Its texts, or small whole numbers where its name says so, come again and again, in turn or mixed. A status or a
    phase does not: it has no such name, and lasts.
    """
    role, keys = columns[index].role, [row[index] for row in rows]
    named = "_".join(columns[index].name.lower().split()) in _KEYS
    times = () if time is None else time.indices
    rest = any(c.role == "channel" for j, c in enumerate(columns) if j != index and j not in times)
    is_code = all((key.isdecimal() and len(key) <= 5) or key == "-" for key in keys)
    is_text = role in ("text", "row name")
    if not rest or len(rows) < 12 or not (is_text or (named and role == "channel" and is_code)):
        return False
    is_date = not named and all(month_of(key) or is_weekday(key) for key in keys[:7])
    count = len(set(keys))
    if is_date or any(map(is_stamp, keys[:4])) or "" in keys or not 2 <= count <= min(64, len(rows) // 4):
        return False
    shares = Counter(keys).values()
    if is_code and max(shares) > 4 * min(shares):
        return False  # a quantity has rare values
    changes = sum(a != b for a, b in pairwise(keys)) / len(keys)
    in_turn = sum(a == b for a, b in zip(keys, keys[count:], strict=False)) / (len(keys) - count)
    if not named:
        return min(changes, in_turn) >= 0.8
    if changes >= 0.2 or time is None:
        return changes >= 0.2
    stamps = list(map(row_stamp_parser(time, decimal), rows))
    ends = [i for i in range(1, len(keys)) if keys[i] != keys[i - 1]]
    return all((stamps[i] or 0) < (stamps[i - 1] or 0) for i in ends)  # one sensor after the other, all of one time
