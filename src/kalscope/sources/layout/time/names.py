"""What the name of a column says about time: whether it is one, and in which unit."""

from __future__ import annotations

import re
from dataclasses import dataclass

from kalscope.sources.grammar.time_units import UNIT_OF_WORD
from kalscope.sources.grammar.units import words
from kalscope.sources.layout.columns import Column

_TIME_WORDS = words(
    """
    time times timestamp timestamps stamp tstamp ts datetime date dates elapsed uptime epoch unixtime clock timer
    zeit uhrzeit zeitstempel datum tiempo fecha hora heure horodatage tempo
    """
)
_SPREADSHEET_WORDS = words("date dates datetime datum fecha")
_DATE_WORDS = _SPREADSHEET_WORDS | words("day timestamp")
_DECIMAL_WORDS = words("decimal dec fractional")
"""Beside a word of time they mean years such as 1958.2027."""
_DAY_COUNTS = words("jd hjd bjd")
"""Julian dates: of the Earth, the sun and the solar system."""
# Beside these a word of time stays one: "Device Time", "time since start", "Timestamp (Formatted)".
_FILLERS = words(
    """
    in of the since from start and utc gmt local host device gps unix system relative rel absolute abs sensor sample
    sampling record recorded recording measurement logger log formatted total boot iso iso8601
    """
)
# Other words for a unit are also quantities or counts: h, d, min, hour.
_LONE_UNITS = words(
    """
    s sec secs second seconds ms msec millis millisecond milliseconds us µs μs usec micros microsecond microseconds
    ns nsec nanos nanosecond nanoseconds
    """
)
_RISING_UNITS = words("day days year years yr hours minutes mins")
_WORD = re.compile(r"[^\W_]+")
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")


@dataclass(frozen=True)
class TimeName:
    """What a name says; a hint, which the cells must confirm."""

    strength: int
    """2: the name of a time and nothing else; 1: a word of it is, or it may be one if it rises; 0: none."""
    unit: str = ""
    """Unit of time, a key of SECONDS_PER_UNIT; "" where none is given."""
    is_date: bool = False
    """True where 19580329 may be a date."""
    may_be_spreadsheet: bool = False
    """True where 45123.5 may be a date."""


def time_name(column: Column) -> TimeName:
    """What the name and the unit of a column say: `time_ms`, `t` in us, `micros`, `Time (UTC)`, `Time in seconds`.

    A lone capital is a quantity, T a temperature, unless its unit is one of time.
    """
    unit = UNIT_OF_WORD.get(column.unit.strip().lower(), "")
    name = column.name.strip()[:100]
    if len(name) == 1 and name.isupper() and not unit:
        return TimeName(0)
    said = [word.lower() for word in _WORD.findall(_CAMEL.sub(" ", name))]
    unit = unit or _unit_of(said)
    rest = [word for word in said if word not in _FILLERS]
    core = [word for word in rest if word not in UNIT_OF_WORD]
    is_time = any(word in _TIME_WORDS for word in said)
    if is_time and not _DECIMAL_WORDS.isdisjoint(said):
        unit, core = "year", [word for word in core if word not in _DECIMAL_WORDS]
    if not _DAY_COUNTS.isdisjoint(said):
        unit, is_time, core = unit or "day", True, [word for word in core if word not in _DAY_COUNTS] or ["t"]
    is_alone = not core and len(rest) == 1
    strength = 0
    if (core and all(word in _TIME_WORDS or word == "t" for word in core)) or (is_alone and rest[0] in _LONE_UNITS):
        strength = 2
    elif is_time or (is_alone and rest[0] in _RISING_UNITS):
        strength = 1
    return TimeName(
        strength,
        unit if strength else "",
        any(word in _DATE_WORDS for word in said),
        any(word in _SPREADSHEET_WORDS for word in said),
    )


def _unit_of(said: list[str]) -> str:
    """The unit among the words of a name: the last of them that is one; single letters only at the end."""
    for i in range(len(said) - 1, -1, -1):
        word = said[i]
        if word in UNIT_OF_WORD and (len(word) > 1 or i == len(said) - 1):
            return UNIT_OF_WORD[word]
    return ""
