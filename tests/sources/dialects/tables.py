"""Tables in random dialects and lines that name their values, and their right reading."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from random import Random

import numpy as np
from tests.sources.dialects.stamps import Stamps, make_stamps

NAMES = [
    "temp", "hum", "pressure", "volts", "dist", "accel_x", "accel_y", "gyro", "flow", "level", "speed", "torque",
    "light", "CO2", "Load", "Angle",
]  # fmt: skip
SPACED_NAMES = ("Air Temp", "Rel Hum", "Wind Spd", "EXG Channel 0", "Battery Level", "Sensor Value")
UNITS = ("V", "mm", "hPa", "%", "degC", "°C", "m/s^2", "g", "lux", "mA", "rpm", "kPa")
WORDS = ("nan", "NaN", "NA", "N/A", "null", "None", "-", "--", "M", "unavailable", "ERR", "missing")
STATES = ("OK", "STILL", "WALK", "idle", "LOST COMMUNICATION")
STATUS = (
    "WiFi reconnecting...", "sensor timeout!", "SD card flushed", "reboot (watchdog)", "calibrating, please wait",
)  # fmt: skip
PROSE = ("Data logger export", "Recorded at the weather mast behind the barn.", "All times are local standard time")
PREFACES = ("comments", "pairs", "colons", "prose")
FACTS = (
    ("Serial Number", "C030756"), ("Firmware", "v2.31b"), ("Operator", "J. Smith"), ("Site", "Barn 7"),
    ("Gain", "24"),
)  # fmt: skip


Cells = list[list[str]]
Optional = list[str] | None
Words = tuple[str, ...]


@dataclass
class Case:
    """One log and its right reading."""

    delimiter: str = ","
    quoted: bool = False
    """Whether all cells are in quotes."""
    counter: bool = False
    """Whether a column numbers the rows."""
    data: bytes = b""
    """The file."""
    names: Words = ()
    """Names of the channels; () where the file names none."""
    units: Words = ()
    """Their units."""
    values: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    """Samples, NaN where missing."""
    stamps: Stamps | None = None
    """The time columns."""
    period: float | None = None
    """s, where stamps or preface say it."""


def make_table(rng: Random) -> Case:
    """A table of delimited cells."""
    n, width = rng.randint(30, 160), rng.randint(1, 5)
    delimiter = rng.choice([",", ",", ";", "\t", "|", " "])
    header = rng.random() < 0.8
    quoted = rng.random() < 0.15 and delimiter != " "
    comma = rng.random() < (0.4 if delimiter in ";\t" else 0.15) and (delimiter != "," or quoted)
    decimal = "," if comma else "."
    width = max(width, 2) if comma or not header or delimiter == "," else width
    case = Case(delimiter, quoted)
    if rng.random() < 0.8:
        case.stamps = make_stamps(rng, n, delimiter, decimal, named=header)
        case.period = case.stamps.period
    cells = samples(rng, case, n, width, decimal)
    columns = list(map(list, zip(*cells, strict=True)))
    names, units, labels = headings(rng, width, delimiter, header)
    case.names, case.units = (names if header else ()), units
    unit_row = header and delimiter != " " and case.stamps is not None and any(units) and rng.random() < 0.3
    labels = list(names) if unit_row else labels
    suffix_units(rng, case, columns, delimiter, header=header)
    heads, unit_cells = list(labels), list(units)
    if case.stamps is not None:
        at = 0 if not header or rng.random() < 0.8 else rng.randint(0, width)
        heads[at:at] = case.stamps.names
        unit_cells[at:at] = [""] * len(case.stamps.names)
        columns[at:at] = map(list, zip(*case.stamps.cells, strict=True))
    if header and delimiter != " " and rng.random() < 0.15:
        heads.append("state")
        unit_cells.append("")
        columns.append([rng.choice(STATES) for _ in range(n)])
    if header and rng.random() < 0.12:
        heads.insert(0, rng.choice(["seq", "RECORD", "index", "#"]) if delimiter != " " else "seq")
        unit_cells.insert(0, "")
        columns.insert(0, [str(i + 1) for i in range(n)])
        case.counter = True
    rows = [list(row) for row in zip(*columns, strict=True)]
    lines = table_lines(rng, case, rows, heads if header else None, unit_cells if unit_row else None)
    finish(rng, case, lines)
    return case


def samples(rng: Random, case: Case, n: int, width: int, decimal: str) -> Cells:
    """Cells of the channels; the values they mean go into the case."""
    case.values = np.empty((n, width))
    cells = [[""] * width for _ in range(n)]
    thousands = "." if decimal == "," else ","
    grouped = rng.random() < 0.06 and (thousands != case.delimiter or case.quoted)
    for j in range(width):
        # Whole numbers alone, between commas, could be decimals of one another.
        digits = rng.choice([1, 2, 2, 3, 4] if j == 0 or decimal == "," else [0, 1, 2, 3, 4])
        size, level = rng.choice([0.1, 1, 5, 40]), rng.choice([0, 20, -3, 1013 if not grouped else 4500])
        power = rng.random() < 0.06
        for i in range(n):
            level += rng.gauss(0, size)
            text = f"{level:.{digits}e}" if power else f"{level:.{digits}f}"
            case.values[i, j] = float(text)
            if grouped and not power and digits:
                text = f"{float(text):,.{digits}f}"
            cells[i][j] = text.translate(str.maketrans(",.", thousands + decimal))
    lose_some(rng, case, cells)
    return cells


def lose_some(rng: Random, case: Case, cells: Cells) -> None:
    """Missing words in random places, the first rows among them."""
    n, width = case.values.shape
    if rng.random() < 0.6:
        return
    word = rng.choice(WORDS if case.delimiter == " " or width == 1 else (*WORDS, "", ""))
    places = {(rng.randrange(n), rng.randrange(width)) for _ in range(rng.randint(1, n // 8))}
    if rng.random() < 0.5:
        places |= {(i, rng.randrange(width)) for i in range(rng.randint(1, 12))}
        if rng.random() < 0.5 and case.stamps is not None:
            places |= {(i, j) for i in range(rng.randint(1, 12)) for j in range(width)}
    if word == "" and case.stamps is None:
        # A row of separators alone is what a spreadsheet makes of nothing.
        places = {(i, j) for i, j in places if j > 0}
    for i, j in places:
        cells[i][j] = word
        case.values[i, j] = np.nan


def headings(rng: Random, width: int, delimiter: str, header: bool) -> tuple[Words, Words, list[str]]:
    """(names, units, labels as the header writes them)."""
    pool = NAMES if delimiter == " " else [*NAMES, *SPACED_NAMES]
    names = tuple(rng.sample(pool, width))
    style = rng.choice(["", "", " [{}]", " ({})", "[{}]"]) if delimiter != " " else rng.choice(["", "[{}]"])
    units = tuple(rng.choice(UNITS) if style and header else "" for _ in names)
    labels = [name + style.format(unit) if unit else name for name, unit in zip(names, units, strict=True)]
    return names, units, labels


def suffix_units(rng: Random, case: Case, columns: Cells, delimiter: str, *, header: bool) -> None:
    """Units behind the numbers: 26.69C."""
    if rng.random() > 0.05 or any(case.units) or delimiter == " ":
        return
    j, unit = rng.randrange(len(columns)), rng.choice(["C", "V", "%", " V", "mm"])
    columns[j] = [cell + unit if cell[-1:].isdigit() else cell for cell in columns[j]]
    case.units = tuple(unit.strip() if i == j else "" for i in range(len(columns)))


def table_lines(rng: Random, case: Case, rows: Cells, heads: Optional, units: Optional) -> list[str]:
    """The lines from the header on."""
    delimiter = case.delimiter
    between = delimiter + " " if delimiter in ",;" and rng.random() < 0.15 and not case.quoted else delimiter
    between = " " * rng.randint(1, 3) if delimiter == " " else between
    may_trail = delimiter != " " and len(rows[0]) > 1
    trailing = rng.choice(["none"] * 6 + ["rows", "both", "spaced"]) if may_trail else "none"
    end = {"none": "", "rows": delimiter, "both": delimiter, "spaced": delimiter + " "}[trailing]

    def line(cells: list[str], ending: str) -> str:
        return between.join(f'"{cell}"' for cell in cells) + ending if case.quoted else between.join(cells) + ending

    above = end if trailing == "both" else ""
    lines = [] if heads is None else [line(heads, above)]
    if units is not None:
        style = rng.choice(["{}", "[{}]", "({})"])
        lines.append(line([style.format(unit) if unit else "" for unit in units], above))
    if heads and delimiter not in " |" and rng.random() < 0.06 and trailing == "none" and len(rows[0]) > 2:
        added = rng.randint(5, len(rows) // 2)
        where = [i for i, name in enumerate(case.names) if heads[-1].startswith(name)]
        if where:
            rows = [row[:-1] if i < added else row for i, row in enumerate(rows)]
            case.values[:added, where[-1]] = np.nan
    return lines + [line(row, end) for row in rows]


def finish(rng: Random, case: Case, lines: list[str], prefaces: tuple[str, ...] = PREFACES) -> None:
    """Preface, lines in between, line ends and encoding."""
    headed = bool(case.names)
    lines = preface(rng, case, rng.choice(prefaces)) + lines if prefaces and rng.random() < 0.35 else lines
    first = len(lines) - case.values.shape[0]
    if case.stamps is not None and headed and rng.random() < 0.1:
        for _ in range(rng.randint(1, 4)):
            lines.insert(rng.randint(first + 3, len(lines)), rng.choice(STATUS))
    newline = rng.choice(["\n", "\n", "\n", "\r\n", "\r\n", "\r"])
    encoding = rng.choice(["utf-8"] * 5 + ["utf-8-sig", "utf-16", "latin-1"])
    case.data = (newline.join(lines) + newline).encode(encoding)
    if encoding.startswith("utf-8") and rng.random() < 0.04:
        case.data += b"\0" * rng.choice([1, 40, 512])


def preface(rng: Random, case: Case, style: str) -> list[str]:
    """What a logger writes above its table."""
    mark = rng.choice(["# ", "#", "% ", "// "]) if style == "comments" else ""
    between = ": " if style in ("comments", "colons", "prose") or case.delimiter == " " else case.delimiter
    lines = [mark + rng.choice(PROSE)] if style in ("comments", "prose") else []
    if style != "prose":
        lines += [mark + between.join(pair) for pair in rng.sample(FACTS, rng.randint(1, 4))]
    if case.stamps is None and rng.random() < 0.7:
        rate = rng.choice([10, 25, 50, 100, 128, 250, 1000])
        hertz = ("Sample Rate", f"{rate} Hz"), ("Sampling Rate (Hz)", f"{rate}")
        said = rng.choice([*hertz, ("Sample Interval", f"{1 / rate} s")])
        lines.append(mark + between.join(said))
        case.period = 1 / rate
    if rng.random() < 0.4:
        lines.append("")
    return lines


STEPS = (20, 50, 100, 1000)


def make_labelled(rng: Random) -> Case:
    """A log of named values, with or without time."""
    n, width = rng.randint(30, 120), rng.randint(1, 4)
    style = rng.choice(["colon", "equals", "json"])
    case = Case(names=tuple(rng.sample(NAMES, width)), units=("",) * width)
    texts = [[f"{20 + rng.gauss(0, 4):.2f}" for _ in case.names] for _ in range(n)]
    case.values = np.array([[float(text) for text in row] for row in texts])
    clock = rng.choice(["none", "t", "ms", "date"])
    step = rng.choice(STEPS)
    if clock != "none":
        case.period = step / 1000
        case.stamps = Stamps("even", (), (), np.arange(n) * case.period, case.period)
    between = rng.choice([", ", ",", "\t", " "])
    lines = [line(case, style, clock, between, texts[i], i * step) for i in range(n)]
    finish(rng, case, lines, () if style == "json" else ("comments",))
    return case


def line(case: Case, style: str, clock: str, between: str, texts: list[str], millis: int) -> str:
    """One line; the date of `DATE TIME - name: value` stands before the pairs."""
    date = (datetime(2024, 5, 17, 9, 30) + timedelta(milliseconds=millis)).isoformat(" ", "milliseconds")
    stamp = {"none": [], "t": [("t", f"{millis / 1000:.3f}")], "ms": [("millis", str(millis))], "date": []}[clock]
    pairs = [*stamp, *zip(case.names, texts, strict=True)]
    if style == "json":
        dated = {"timestamp": date.replace(" ", "T")} if clock == "date" else {}
        return json.dumps(dated | {name: float(text) for name, text in pairs})
    mark = "=" if style == "equals" else ":" if between != "\t" else ": "
    body = between.join(f"{name}{mark}{text}" for name, text in pairs)
    return f"{date} - {body}" if clock == "date" else body
