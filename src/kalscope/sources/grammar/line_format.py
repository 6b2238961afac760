"""How one line of a source may be written, and how it is split: tables, labels, Teleplot, stamps, checksums.

Pure functions on one line of text. `columns` and `timestamps` decide what the cells mean.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import reduce
from string import hexdigits
from typing import Literal

from kalscope.sources.grammar.cells import is_number

ESCAPE = "\x1b["
_ESCAPES = re.compile(r"\x1b\[[0-?]{0,24}[ -/]{0,4}[@-~]")
_MAX_SAMPLES = 1024
"""Samples that one line of Teleplot may hold."""
_STAMP_REACH = 24  # the first colon of a clock after a date
_STAMP = r"((?:[0-9]{1,4}[-/.][0-9]{1,2}[-/.][0-9]{1,4}[T ])?[0-9]{1,2}:[0-9]{2}:[0-9]{2}(?:[.,][0-9]{1,9})?)"
# The Arduino IDE writes "->", PlatformIO's monitor ">", screen and grabserial " - ", others brackets or ": ".
_AFTER_STAMP = r"(?:[ \t]{0,4}-?>|:(?=[ \t])|[ \t]-(?=[ \t]|$))"
_AFTER_BRACKET = r"[ \t]?(?:->|[>:]|-(?=[ \t]))?"
_LINE_STAMP = re.compile(
    rf"[ \t]{{0,8}}(?:{_STAMP}{_AFTER_STAMP}|\[{_STAMP}\]{_AFTER_BRACKET})[ \t]?(.*)", re.DOTALL
)
_ZONE = r"(?:Z|[+-][0-9]{2}:?[0-9]{2})?"
_BARE_STAMP = re.compile(
    rf"[ \t]{{0,8}}({_STAMP[1:-1]}{_ZONE}|[0-9]{{1,14}}(?:\.[0-9]{{1,9}})?)[ \t]+([A-Za-z].*)", re.DOTALL
)
"""A stamp followed by nothing but blanks, before a label."""
_COUNTED = re.compile(
    r"(?:\[[ ]{0,12}([0-9]{1,14}(?:\.[0-9]{1,9})?)\]|[EWIDV] \(([0-9]{1,14})\) [^\s:]{1,40}:)[ \t](.*)", re.DOTALL
)
"""What a kernel and an ESP32 write before a line: `[   12.345]`, `I (12345) sensor:`."""
_SYSLOG = re.compile(
    r"[A-Z][a-z]{2} [ 0-9]?[0-9] ([0-9]{2}:[0-9]{2}:[0-9]{2}(?:\.[0-9]{1,9})?) \S{1,64} [^\s:]{1,64}: (.*)",
    re.DOTALL,
)
"""What syslog and journalctl write before a line: `May 17 09:30:00 host sensor[612]: `; the date has no year."""
_TOPIC = re.compile(r"[^\s/]{1,99}/[^\s/]{3,99}(?:/\S{1,99})? \S{1,40}")
"""`barn/temperature 21.5`: a topic of MQTT and its value; `m/s 3` is a unit."""
_HEXADECIMAL = frozenset(hexdigits)
_DIGITS_OR_BLANKS = frozenset("0123456789 \t")
_TELEPLOT = re.compile(r"\s*>([^:>|§]{1,200}):([^|§]*)(?:§([^|]*))?(?:\|(.*))?\s*", re.DOTALL)
_NO_SAMPLES = frozenset({"t", "xy"})
"""Flags of Teleplot: a text; points of a plane."""


@dataclass(frozen=True)
class LineFormat:
    """How the data lines of one source are written."""

    kind: Literal["table", "labels", "teleplot"] = "table"
    """"table": values in fixed places; "labels": pairs of a name and a value; "teleplot": `>name:ms:value§unit`.
    A new kind needs a split in `layout/rows/tables.py` for the head, in `lines/line_reader.py` for each line."""
    delimiter: str = ","
    """Delimiter of the cells of a table: one of `, ; TAB |`, or a space for any run of blanks."""
    decimal: str = "."
    """Decimal mark, "." or ","; equal to the delimiter only where numbers are quoted."""
    labels: tuple[str, ...] = ()
    """Labels in column order; () for a table."""
    complete: bool = False
    """True where nearly every line holds all the labels: one that lacks some was damaged."""
    stamped: bool = False
    """True where each line begins with the `12:00:00.023 -> ` of a serial monitor; that stamp is cell 0."""
    checksum: bool = False
    """True where each line ends with a checksum: one without it was cut."""


@dataclass(frozen=True)
class Teleplot:
    """One line of Teleplot: a variable and its samples."""

    name: str
    """Name of the variable."""
    samples: tuple[tuple[str, str], ...]
    """(stamp in ms or "", value) of each sample, as text."""
    unit: str = ""
    """What follows the §; "" where nothing does."""

    @property
    def only_names(self) -> bool:
        """True for `>name:`, which declares a variable and holds no sample."""
        return self.samples == (("", ""),)


def without_escapes(line: str) -> str:
    """A line without the escape sequences that colour it on a terminal or move the cursor: `ESC[0;32m`."""
    return _ESCAPES.sub("", line) if ESCAPE in line else line


def split_teleplot(line: str) -> Teleplot | None:
    """The parts of `>name:value`, `>name:ms:value§unit`, `>name:1000:1;2000:2`; None for any other line.

    Texts (`|t`), points of a plane (`|xy`) and shapes (`>3D|…`) are not samples.
    """
    match = _TELEPLOT.fullmatch(line)
    if match is None or not _NO_SAMPLES.isdisjoint(_flags(match)) or match[2].count(";") > _MAX_SAMPLES:
        return None
    samples: list[tuple[str, str]] = []
    for part in match[2].split(";"):
        stamp, colon, value = part.rpartition(":")
        if ":" in stamp or (colon and not is_number(stamp.strip())):
            return None
        samples.append((stamp.strip(), value.strip()))
    return Teleplot(match[1].strip(), tuple(samples), (match[3] or "").strip())


def teleplot_flags(line: str) -> list[str]:
    """The flags of a line of Teleplot, `g` and `np` of `>name:value|g,np`; [] where there are none."""
    match = _TELEPLOT.fullmatch(line)
    return [] if match is None else _flags(match)


def _flags(match: re.Match[str]) -> list[str]:
    return [flag.strip() for flag in (match[4] or "").split(",")]


def split_stamp(line: str) -> tuple[str, str] | None:
    """(`12:00:00.023`, rest) of a line before which a serial monitor wrote its stamp; None for any other line."""
    if line.startswith(("[", "I (", "D (", "W (", "E (", "V (")) and (match := _COUNTED.fullmatch(line)):
        return match[1] or match[2], match[3]
    if ":" in line[:_STAMP_REACH] and (match := _LINE_STAMP.fullmatch(line)):
        return match[1] or match[2], match[3]
    if line[3:4] == " " and (match := _SYSLOG.fullmatch(line)):
        return match[1], match[2]
    match = _BARE_STAMP.fullmatch(line) if line[:1] in _DIGITS_OR_BLANKS else None
    if match is None:
        return None
    if not (":" in match[2] or "=" in match[2]):
        return (match[1], match[2]) if _TOPIC.fullmatch(match[2]) else None
    # The 24 of `24 Apr 2016 17:03:07` is not a stamp before the label 17.
    label = match[2].replace("=", ":").partition(":")[0].split()
    return None if not label or is_number(label[-1]) else (match[1], match[2])


def split_checksum(line: str) -> tuple[str, int, int] | None:
    """(payload, checksum written, checksum of the payload) of `1,2,3*02`; None where none is written.

    As in NMEA 0183: two hexadecimal digits, the XOR of all bytes between a leading `$`, if any, and the `*`.
    """
    text = line.strip()
    mark, digits = text[-3:-2], text[-2:]
    if mark != "*" or not set(digits) <= _HEXADECIMAL:
        return None
    payload = text[:-3].removeprefix("$")
    return payload, int(digits, 16), reduce(int.__xor__, payload.encode(), 0)
