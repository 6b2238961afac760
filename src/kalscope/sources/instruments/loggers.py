"""Loggers that write a rate or an interval above their table."""

from __future__ import annotations

import re
from collections.abc import Sequence

from kalscope.sources.grammar.cells import NUMBER, SECONDS_PER_UNIT, UNIT_OF_WORD, is_comment
from kalscope.sources.instruments.preface import KEPT_COMMA, Preface, in_words

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
