"""Logs written in random dialects, their right reading, and what became of them.

Asked is what a note answers: it names the options with which the log is read exactly.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from kalscope.errors import KalscopeError
from kalscope.recording import Recording
from kalscope.sources.grammar.read_options import ReadOptions, options_from_text
from kalscope.sources.reading.recording_file import read_recording

MONTHS = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"]
DAYS = ["Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun"]


Columns = tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]
"""(names, cells) of time columns."""


@dataclass(frozen=True)
class Stamps:
    """The time columns of one log."""

    shape: str
    """"even", "jitter", "pause", "burst" or "coarse"."""
    names: tuple[str, ...]
    """Names of the columns."""
    cells: tuple[tuple[str, ...], ...]
    """One row of cells a sample."""
    seconds: np.ndarray
    """s from the first sample, as the stamps say."""
    period: float
    """s between samples, pauses left aside."""

    @property
    def only_rate(self) -> bool:
        """Whether the stamps are too coarse to place a sample."""
        return self.shape in ("burst", "coarse")


FORMS = {
    "seconds": 1000, "millis": 1000, "micros": 1, "epoch s": 1000, "epoch ms": 1000, "epoch us": 1, "iso": 1000,
    "iso whole": 1_000_000, "day first": 1_000_000, "month first": 1_000_000, "am pm": 1_000_000,
    "month name": 1000, "ctime": 1_000_000, "compact": 1_000_000, "clock": 1000, "two columns": 1_000_000,
    "six columns": 1_000_000, "minutes": 1000,
}  # fmt: skip
WITHOUT_BLANKS = {"seconds", "millis", "micros", "epoch s", "epoch ms", "epoch us"}
WITHOUT_BLANKS |= {"clock", "two columns", "compact", "six columns"}
WITHOUT_NAME = set(FORMS) - {"millis", "micros", "six columns", "minutes"}
"""What a human knows as a time without a name above it."""
MIN_COARSE_ROWS = 70
WHOLE = {form for form, resolution in FORMS.items() if resolution == 1_000_000}


def make_stamps(rng: Random, n: int, delimiter: str, decimal: str, *, named: bool) -> Stamps:
    """Time columns of n samples that suit a table with this delimiter."""
    forms = set(FORMS) if named else WITHOUT_NAME
    form = rng.choice(sorted(forms & WITHOUT_BLANKS if delimiter == " " else forms))
    resolution = FORMS[form]
    shapes = ["even"] * 4 + ["jitter", "pause"]
    # A clock of whole seconds needs many of them to say its rate; numbers that repeat need a name to be a time.
    if n >= MIN_COARSE_ROWS and (named or form != "seconds"):
        shapes.append("coarse" if form in WHOLE else "burst")
    shape = rng.choice(shapes)
    micros, period = sample_times(rng, n, resolution, shape, daily=form != "minutes")
    start = datetime(rng.randint(2015, 2025), rng.randint(1, 12), rng.randint(13, 27), rng.randint(0, 20), 3, 7)
    if form == "minutes":
        start = start.replace(minute=0)
    names, cells = written(rng, form, start, micros, decimal, delimiter)
    return Stamps(shape, names, cells, (micros - micros[0]) / 1e6, period)


def sample_times(rng: Random, n: int, resolution: int, shape: str, *, daily: bool) -> tuple[np.ndarray, float]:
    """(µs of each stamp, nominal period in s)."""
    if shape == "coarse":
        rate = rng.uniform(2.5, max(3.0, n / 25))
        return (np.arange(n) / rate).astype(np.int64) * 1_000_000, 1 / rate
    is_whole = resolution == 1_000_000
    steps = (4, 5, 10, 20, 40, 50, 100) if not is_whole else (1, 2, 5, 10, 30, 60, 300, 600) if daily else (1,)
    step = rng.choice(steps) * (1_000_000 if is_whole else 1000)
    micros = np.arange(n) * step
    if shape == "burst":
        size = rng.randint(3, 8)
        return micros // (size * step) * (size * step), step / 1e6
    if shape == "jitter" and resolution < 1_000_000:
        noise = np.array([rng.uniform(-0.1, 0.1) * step for _ in range(n)])
        micros = np.sort(((micros + noise) // resolution * resolution).astype(np.int64))
    if shape == "pause":
        micros = micros + (np.arange(n) >= rng.randint(n // 3, 2 * n // 3)) * step * rng.randint(20, 90)
    return micros - micros[0], step / 1e6


def written(rng: Random, form: str, start: datetime, micros: np.ndarray, decimal: str, delimiter: str) -> Columns:
    """(names, cells) of a form."""
    when = [start + timedelta(microseconds=int(at)) for at in micros]
    if form in _NUMBERS:
        return _numbers(rng, form, start, micros, decimal, delimiter)
    if form == "two columns":
        date = rng.choice(["%Y-%m-%d", "%d.%m.%Y", "%d/%m/%Y", "%m/%d/%Y"])
        names = rng.choice([("Date", "Time"), ("date", "time"), ("DATE", "CLOCK")])
        return names, tuple((at.strftime(date), at.strftime("%H:%M:%S")) for at in when)
    if form == "six columns":
        names = ("Year", "Month", "Day", "Hour", "Minute", "Second")
        return names, tuple(tuple(map(str, at.timetuple()[:6])) for at in when)
    name = rng.choice(["Time", "timestamp", "Timestamp", "datetime", "Date/Time", "time"])
    return (name,), tuple((text,) for text in _texts(rng, form, when))


def _texts(rng: Random, form: str, when: list[datetime]) -> list[str]:
    if form == "iso":
        between, zone = rng.choice("T "), rng.choice(["", "", "Z", "+02:00", " UTC"])
        return [at.isoformat(between, "milliseconds") + zone for at in when]
    if form == "month name":
        pattern = rng.choice(["%d-{}-%Y %H:%M:%S", "%d.{}.%Y %H:%M:%S", "%d {} %Y %H:%M:%S"])
        return [at.strftime(pattern.format(MONTHS[at.month - 1])) + f".{at.microsecond // 1000:03}" for at in when]
    if form == "ctime":
        zone = rng.choice(["", " GMT+08:00", " UTC"])
        return [f"{DAYS[at.weekday()]} {MONTHS[at.month - 1]} {at:%d %H:%M:%S}{zone} {at:%Y}" for at in when]
    if form in ("minutes", "clock"):
        return [f"{at:{'%M:%S' if form == 'minutes' else '%H:%M:%S'}}.{at.microsecond // 1000:03}" for at in when]
    pattern = rng.choice(_PATTERNS[form])
    return [at.strftime(pattern) for at in when]


_PATTERNS = {
    "iso whole": ("%Y-%m-%d %H:%M:%S", "%Y-%m-%dT%H:%M:%SZ", "%Y/%m/%d %H:%M:%S"),
    "day first": ("%d.%m.%Y %H:%M:%S", "%d/%m/%Y %H:%M:%S", "%d-%m-%Y %H:%M:%S"),
    "month first": ("%m/%d/%Y %H:%M:%S",),
    "am pm": ("%m/%d/%Y %I:%M:%S %p", "%d.%m.%Y %I:%M:%S %p"),
    "compact": ("%Y%m%d_%H%M%S",),
}
_NUMBERS = {  # µs in one unit, names
    "seconds": (1e6, ("t", "time", "Time (s)", "time [s]", "t_s", "seconds", "elapsed [s]")),
    "millis": (1e3, ("millis", "time_ms", "t [ms]", "Time (ms)", "timestamp_ms")),
    "micros": (1, ("micros", "time_us", "t [us]", "Time (µs)")),
    "epoch s": (1e6, ("timestamp", "time", "epoch", "unix_time")),
    "epoch ms": (1e3, ("timestamp", "time", "epoch_ms", "Timestamp")),
    "epoch us": (1, ("timestamp", "time", "epoch")),
}


def _numbers(rng: Random, form: str, start: datetime, micros: np.ndarray, decimal: str, delimiter: str) -> Columns:
    unit, names = _NUMBERS[form]
    epoch = (start - datetime(1970, 1, 1)) // timedelta(microseconds=1) if form.startswith("epoch") else 0
    counts = [int(at) + epoch for at in micros]
    if unit == 1e6:
        cells = [f"{count // 1_000_000}{decimal}{count % 1_000_000 // 1000:03}" for count in counts]
    else:
        cells = [str(count // int(unit)) for count in counts]
    names = tuple(name for name in names if delimiter != " " or " " not in name)
    return (rng.choice(names),), tuple((cell,) for cell in cells)


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


def finish(rng: Random, case: Case, lines: list[str]) -> None:
    """Preface, lines in between, line ends and encoding."""
    headed = bool(case.names)
    lines = preface(rng, case, rng.choice(PREFACES)) + lines if rng.random() < 0.35 else lines
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


OPTION = re.compile(r'--([a-z-]+)(?:[ =](?:"([^"]*)"|([^\s";)]+)))?')
"""An option with its value, as a note names it."""
RATE_TOLERANCE = {"burst": 0.1, "coarse": 0.04, "pause": 0.01, "jitter": 0.04, "even": 1e-3}
"""Of the period, relative; a burst's last samples may be missing from its stretch."""


def make_case(seed: int) -> Case:
    """The log of a seed."""
    rng = Random(f"kalscope dialect {seed}")
    rng.random()  # so that a seed stays the log that it was
    return make_table(rng)


def judge(case: Case, path: Path) -> tuple[str, str]:
    """(exact, refused, asked or wrong; why it is not exact)."""
    path.write_bytes(case.data)
    try:
        recording = read_recording(path)
    except KalscopeError as error:
        return "refused", str(error)
    if not (why := difference(case, recording)):
        return "exact", ""
    for note in recording.report.notes:
        with suppress(KalscopeError):
            if (options := named_options(note)) and not difference(case, read_recording(path, options)):
                return "asked", f"{why}; {note}"
    return "wrong", why


def named_options(note: str) -> ReadOptions | None:
    """The options that a note names; None where it names none, or none with a value."""
    given: dict[str, Any] = {}
    for name, quoted, bare in OPTION.findall(note):
        if name in ("day-first", "month-first"):
            given["day_first"] = name == "day-first"
        else:
            given[name.replace("-", "_")] = quoted or bare
    try:
        return options_from_text(**given) if given else None
    except (KalscopeError, TypeError):  # `--time-unit changes it`
        return None


def difference(case: Case, recording: Recording) -> str:
    """What differs from the right reading; "" where nothing does."""
    if len(recording) != len(case.values):
        return f"{len(recording)} rows for {len(case.values)}"
    for j in range(case.values.shape[1]):
        if why := channel_difference(case, recording, j):
            return why
    spare = len(recording.names) - case.values.shape[1] - case.counter
    if spare > 0:
        return f"channels {recording.names} for {case.names}"
    return time_difference(case, recording)


def channel_difference(case: Case, recording: Recording, j: int) -> str:
    """What differs in one channel."""
    if case.names:
        if case.names[j] not in recording.names:
            return f"no channel {case.names[j]!r} among {recording.names}"
        index = recording.names.index(case.names[j])
    elif len(recording.names) < case.values.shape[1]:
        return f"{len(recording.names)} channels for {case.values.shape[1]}"
    else:
        index = j
    if not np.array_equal(recording.values[:, index], case.values[:, j], equal_nan=True):
        i = int(np.flatnonzero(~(recording.values[:, index] == case.values[:, j]))[0])
        return f"channel {j}, sample {i}: {recording.values[i, index]} for {case.values[i, j]}"
    if case.units and recording.units[index] != case.units[j]:
        return f"unit {recording.units[index]!r} for {case.units[j]!r}"
    return ""


def time_difference(case: Case, recording: Recording) -> str:
    """What differs in time and rate."""
    stamps = case.stamps
    if case.period is None:
        return "" if recording.sample_period is None else f"a period of {recording.sample_period} s for none"
    if recording.sample_period is None:
        return f"no period for {case.period} s"
    tolerance = RATE_TOLERANCE[stamps.shape] if stamps else 1e-3
    if abs(recording.sample_period / case.period - 1) > tolerance:
        return f"a period of {recording.sample_period} s for {case.period} s"
    if stamps is not None and not stamps.only_rate:
        off = np.abs(recording.time - recording.time[0] - stamps.seconds)
        # A stamp of a pause or a jitter is as it stands; a file's own rate may smooth what is below a period.
        if float(off.max()) > max(1e-6, 0.02 * case.period if stamps.shape == "jitter" else 0.0):
            return f"a time that is {off.max()} s off at sample {int(off.argmax())}"
    return ""
