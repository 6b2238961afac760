"""The instruments and loggers whose files are read by their own rules, and rates above any table."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from kalscope.sources.grammar.cells import (
    NUMBER,
    SECONDS_PER_UNIT,
    UNIT_OF_WORD,
    bare_unit,
    is_comment,
    is_number,
    parse_number,
)
from kalscope.sources.instruments.preface import (
    KEPT_COMMA,
    Cells,
    Preface,
    TablePreface,
    cells_of,
    first_stamp,
    in_words,
    index_of,
    plain_head,
    positive,
    table_rows,
)

# Empatica E4 wristbands: the start, then the rate, then the samples, without a header.
#
# Source: Empatica's "Data export and formatting from E4 connect": row 1 is the start in Unix seconds (UTC), row 2
# the rate in Hz, both written once per column; ACC.csv holds x, y, z in 1/64 g; IBI.csv begins with the start and
# "IBI", then holds seconds since the start and the interval between beats in seconds.


_EMPATICA_NAME = "Empatica E4"
_EMPATICA_RATES = (1.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0)
_MIN_START, _MAX_START = 1262304000.0, 2051222400.0  # 2010 to 2035
_MIN_SAMPLES = 2


def recognise_empatica(head: Sequence[str]) -> Preface | None:
    """The preface of an E4's file; None for any other file, above all for a plain table of numbers."""
    if len(head) < 3 or not head[0][:1].isdecimal():
        return None
    first, second = cells_of(head[0]), cells_of(head[1])
    if len(first) == 2 and first[1].upper() == "IBI" and _is_start(first[0]):
        return TablePreface(
            _EMPATICA_NAME,
            first_row=2,
            names=("time", "IBI"),
            units=("s", "s"),
            time_column=0,
            time_unit="s",
            start=float(first[0]),
            notes=(
                f"{_EMPATICA_NAME}: intervals between beats, stamped in seconds since the start in its first row",
            ),
        )
    if not _same(first) or not _same(second) or len(first) != len(second) or not _is_start(first[0]):
        return None
    rate = float(second[0]) if is_number(second[0]) else 0.0
    samples = [cells_of(line) for line in head[2 : 2 + _MIN_SAMPLES]]
    if rate not in _EMPATICA_RATES or any(len(cells) != len(first) or _is_start(cells[0]) for cells in samples):
        return None
    # The file's name says what one column holds; three are the accelerometer.
    three = len(first) == 3
    return TablePreface(
        _EMPATICA_NAME,
        first_row=3,
        names=("x", "y", "z") if three else ("value",) if len(first) == 1 else ("",) * len(first),
        units=("1/64 g",) * 3 if three else ("",) * len(first),
        time_column=-1,
        period=1 / rate,
        start=float(first[0]),
        notes=(f"{_EMPATICA_NAME}: start and rate, {rate:g} Hz, from its first two rows",),
    )


def _same(cells: Cells) -> bool:
    return bool(cells) and len(set(cells)) == 1


def _is_start(cell: str) -> bool:
    return is_number(cell) and _MIN_START <= float(cell) <= _MAX_START


# Source: the programming guide (MSO1000Z/DS1000Z 2.17) and the parser of ElmüSoft's Oscilloscope Waveform Analyzer,
# which describes the two cells that the first lines of a DS1000Z have and its rows lack.


_RIGOL_NAME = "Rigol oscilloscope"


def recognise_rigol(head: Sequence[str]) -> Preface | None:
    """The preface of a file of a DS1000Z or DS2000 to DS6000; None for any other file."""
    start = next((line for line in head[:3] if line.strip()), "").strip().lower()
    if not start.startswith(("x,", "sequence,")):
        return None
    rows = table_rows(head)
    at = index_of(rows[:4], "sequence")
    return _counted(rows, at) if at else None


def _counted(rows: list[Cells], at: int) -> Preface | None:
    """`X,CH1,Start,Increment` above `Sequence,Volt,-6e-3,1e-6`: numbered samples, the time in the second line."""
    names, says = rows[at - 1], rows[at]
    first = first_stamp(rows, at + 1)
    bases = [name.lower() for name in names]
    if first is None or "start" not in bases or "increment" not in bases:
        return None
    width = bases.index("start")
    start_at, step_at = width, bases.index("increment")
    offset = parse_number(says[start_at]) if len(says) > start_at else None
    period = positive(says[step_at]) if len(says) > step_at else None
    units = tuple(bare_unit(cell) for cell in says[:width])
    # Pods of eight digital lines, written 0x00, are not samples.
    pods = {i for i, name in enumerate(names[:width]) if name.upper().startswith("D") and "-" in name}
    interval = f"sample interval {in_words(period)} from its header" if period else "it gives no sample interval"
    return TablePreface(
        _RIGOL_NAME,
        header_row=at,
        unit_row=at + 1,
        first_row=first + 1,
        names=("sequence", *(name.removeprefix("X(").removesuffix(")") for name in names[1:width])),
        units=("", *units[1:]),
        left_out=frozenset({0, *pods}),
        time_column=-1,
        period=period,
        offset=offset if period and offset is not None else None,
        notes=(f"{_RIGOL_NAME}: {width - 1 - len(pods)} channels, {interval}",),
    )


# A rate or an interval that a logger writes above its table: `# Sampling Rate: 250 Hz`, `Sample Interval,1E-6`.
#
# Source: the lines above the tables of PicoQuake, GENEActiv ("Measurement Frequency"), MetaWear, and many scripts.


_MAX_LINES = 120
_MAX_LENGTH = 400
_MAX_PARTS = 12
"""A line of more cells is a header, or holds samples."""
_RATES = frozenset(
    """
    rate|sample rate|sampling rate|samplerate|samplingrate|sample frequency|sampling frequency|samplingfrequency
    |sampling freq|sample freq|data rate|output data rate|measurement frequency|logging rate|acquisition rate
    |fs|odr|store rate|sfreq|sample rate (hz)|abtastrate|abtastfrequenz|samplefrequenz|messrate
    |fréquence d'échantillonnage|frecuencia de muestreo|taxa de amostragem|frequenza di campionamento
    """.replace("\n", "")
    .replace("    ", "")
    .split("|")
)
_INTERVALS = frozenset(
    """
    sample interval|sampling interval|sample period|sampling period|sampleinterval|samplinginterval|samplingperiod
    |time step|timestep|dt|delta t|delta_t|delta-t|increment|time increment|x increment|xincrement|logging interval
    |interval|intervall|xinc|x inc|tinc
    |log interval|recording interval|measurement interval|epoch length|epoch period|abtastintervall|messintervall
    |période d'échantillonnage|intervalo de muestreo
    """.replace("\n", "")
    .replace("    ", "")
    .split("|")
)
_HERTZ = {
    **dict.fromkeys(("", "hz", "hertz", "1/s", "sps", "s/s", "sa/s", "samples/s", "samples/sec"), 1.0),
    **dict.fromkeys(("samples/second", "samples per second"), 1.0),
    **dict.fromkeys(("khz", "ks/s", "ksa/s", "ksps"), 1e3),
    **dict.fromkeys(("mhz", "ms/s", "msa/s", "msps"), 1e6),
    **dict.fromkeys(("ghz", "gs/s", "gsa/s"), 1e9),
}
_SECONDS = {"": 1.0} | {word: SECONDS_PER_UNIT[unit] for word, unit in UNIT_OF_WORD.items()}
_SEPARATORS = str.maketrans(";\t|", ",,,")
# After ":" or "=" a comma between digits is part of the number; elsewhere it separates cells.
_NUMBER_WITH_COMMA = re.compile(r"[:=][ \t]*[\"']?[-+]?[0-9]+(?:,[0-9]+)+")
_DECIMAL_COMMA = re.compile(rf"([-+]?[0-9]+){KEPT_COMMA}([0-9]+)(?![0-9.{KEPT_COMMA}])")
_MIN_PERIOD, _MAX_PERIOD = 1e-13, 1e8


def recognise_sample_rate(head: Sequence[str]) -> Preface | None:
    """The sample period that the lines above a table give; None where they give none, or more than one."""
    found: dict[float, str] = {}
    lines = 0
    for line in head[:_MAX_LINES]:
        text = line[:_MAX_LENGTH].strip(" \t\r\"',;")
        if not is_comment(line) and _begins_with_number(text):
            break
        for key, value in _settings(text):
            period = _period(key, value)
            if period is not None:
                found.setdefault(period, key)
                lines += 1
    # A key that repeats on each line is a value of each row, such as `dt: 12` from a board.
    if len(found) != 1 or lines > 2:
        return None
    period, key = next(iter(found.items()))
    return Preface(
        "",
        period=period,
        notes=(f'"{key}" above the table gives a sample interval of {in_words(period)}',),
    )


def _begins_with_number(text: str) -> bool:
    return text[:1].isdecimal() or (text[:1] in ("-", "+", ".") and text[1:2].isdecimal())


def _settings(text: str) -> list[tuple[str, str]]:
    """(key, value) of `# rate: 250 Hz`, `a = 1, fs = 100 Hz`, `Sample Interval,1.0E-6,s`, `Sample Rate 100 Hz`."""
    text = text.lstrip("#%/; \t").lower().replace(":=", "=")
    text = _NUMBER_WITH_COMMA.sub(lambda match: match[0].replace(",", KEPT_COMMA), text)
    pairs: list[tuple[str, str]] = []
    parts = [part.strip(" \t\"'") for part in text.translate(_SEPARATORS).split(",")]
    for i, part in enumerate(parts if len(parts) <= _MAX_PARTS else ()):
        key, mark, value = part.rpartition("=") if "=" in part else part.partition(":")
        if not mark or not value.strip():
            # The value, and perhaps its unit, in cells of their own.
            key, value = key if mark else part, " ".join(parts[i + 1 : i + 3])
            if not mark and not value:
                key, value = _spoken(part)
        pairs.append((key.rpartition(":")[2].strip(" \"'_").replace("_", " "), value.strip(" \"'")))
    return pairs


def _spoken(part: str) -> tuple[str, str]:
    """`sample rate 250 hz` as (`sample rate`, `250 hz`)."""
    words = part.split()
    at = next((i for i, word in enumerate(words) if _begins_with_number(word)), len(words))
    return " ".join(words[:at]), " ".join(words[at:])


def _period(key: str, value: str) -> float | None:
    """Seconds of a key and its value; None where they are neither a rate nor an interval."""
    bare, _, unit = key.partition("(") if "(" in key else key.partition("[")
    bare, unit = bare.strip(), unit.rstrip(")] ")
    if bare not in _RATES and bare not in _INTERVALS:
        return None
    if bare in _INTERVALS and value.count(":") == 2:
        return _clock(value)
    number, written = _number(value)
    unit = written or unit
    if number is None or number <= 0:
        return None
    if bare in _RATES:
        size = _HERTZ.get(unit)
        period = None if size is None else 1 / (number * size)
    else:
        size = _SECONDS.get(unit)
        period = None if size is None else number * size
    return period if period is not None and _MIN_PERIOD < period < _MAX_PERIOD else None


def _number(value: str) -> tuple[float | None, str]:
    """(250.0, "hz") of `250 hz` and `250hz`; the unit is the rest of the text.

    `12,5` is 12.5; `1,000` is not read, because it may be one or a thousand, whereas `0,001` cannot be a thousand.
    """
    if KEPT_COMMA in value:
        comma = _DECIMAL_COMMA.match(value)
        if comma is None or (len(comma[2]) == 3 and comma[1].strip("+-0")):
            return None, ""
        value = value.replace(KEPT_COMMA, ".", 1)
    match = NUMBER["."].match(value[:60])
    if match is None:
        return None, ""
    return float(match[0]), value[match.end() :].strip(" .,;)")


def _clock(value: str) -> float | None:
    """Seconds of `00:10:00`."""
    parts = value.strip().split(":")
    if len(parts) != 3 or not all(part.isdecimal() and len(part) < 4 for part in parts):
        return None
    return float(int(parts[0]) * 3600 + int(parts[1]) * 60 + int(parts[2])) or None


_INSTRUMENTS: tuple[Callable[[Sequence[str]], Preface | None], ...] = (
    recognise_rigol,
    recognise_empatica,
    recognise_sample_rate,
)


def find_preface(head: Sequence[str]) -> Preface | None:
    """What the first lines of a file say by the rules of the instrument that wrote it; None where none is known.

    Args:
        head: The first lines of the file, without their newlines.
    """
    plain = plain_head(head)
    found = (recognise(plain.lines) for recognise in _INSTRUMENTS)
    preface = next((preface for preface in found if preface is not None), None)
    if preface is not None:
        return plain.restored(preface)
    return Preface("", delimiter=plain.told, notes=("line 1 names the delimiter",)) if plain.told else None
