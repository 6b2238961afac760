"""How one line of a source may be written, and how it comes apart: tables, labels, Teleplot, stamps, checksums.

Pure functions on one line of text. What the cells mean is for `columns` and `timestamps`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import reduce
from string import hexdigits
from typing import Literal

from kalscope.sources.grammar.cells import is_number
from kalscope.sources.grammar.json_line import find_object

Pairs = list[tuple[str, str]]

_BETWEEN_PAIRS = re.compile(r"[,;&\t]")
_TOKEN = re.compile(r'"[^"]*"|[^\s,;&="]+|=')
# A label begins at a word's beginning and is never given back, else each place of a long word would be tried.
_LABEL_PAIR = re.compile(r"(?<![^\s:])([^\s:]++)\s*+:\s*(\S+)")
_STAMP_REACH = 24  # the first colon of a clock behind a date
_STAMP = r"((?:[0-9]{1,4}[-/.][0-9]{1,2}[-/.][0-9]{1,4}[T ])?[0-9]{1,2}:[0-9]{2}:[0-9]{2}(?:[.,][0-9]{1,9})?)"
# The Arduino IDE writes "->", PlatformIO's monitor ">", screen and grabserial " - ", others brackets or ": ".
_AFTER_STAMP = r"(?:[ \t]{0,4}-?>|:(?=[ \t])|[ \t]-(?=[ \t]|$))"
_AFTER_BRACKET = r"[ \t]?(?:->|[>:]|-(?=[ \t]))?"
_LINE_STAMP = re.compile(
    rf"[ \t]{{0,8}}(?:{_STAMP}{_AFTER_STAMP}|\[{_STAMP}\]{_AFTER_BRACKET})[ \t]?(.*)", re.DOTALL
)
_HEXADECIMAL = frozenset(hexdigits)
_TELEPLOT = re.compile(r"\s*>([^:>|§]+):([^|§]*)(?:§([^|]*))?(?:\|(.*))?\s*", re.DOTALL)


@dataclass(frozen=True)
class LineFormat:
    """How the data lines of one source are written."""

    kind: Literal["table", "labels", "teleplot"] = "table"
    """"table": values in fixed places; "labels": pairs of a name and a value; "teleplot": `>name:ms:value§unit`."""
    delimiter: str = ","
    """Between the cells of a table: one of `, ; TAB |`, or a space for any run of blanks."""
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


def find_labels(line: str) -> tuple[Pairs, list[str]] | None:
    """(label, value text) pairs of `a:1,b:2`, `a: 1 b: 2`, `Sensor Value: 155, Volts: 0.76`, `a=1 b=2`, `{"a":1}`.

    Returns:
        The pairs, and the bare numbers among them that no label claims: `a:1 5`. None if anything else is on the
        line, or a label is a number (`12:30:05`). Between commas a bare number could be the decimals of the value
        before it, so there it is refused as well.
    """
    if ":" not in line and "=" not in line:
        return None
    text = line.strip().removeprefix(">")
    ignored: list[str] = []
    if text.startswith("{"):
        found = find_object(text)
        return None if found is None else (found, ignored)
    equal = _equalities(text) if "=" in text else None
    if equal is not None:
        pairs, complete = equal, True
    elif any(mark in text for mark in ",;\t"):
        parts = [part for part in re.split(r"[,;\t]", text) if part.strip()]
        pairs = [(label.strip(), value.strip()) for label, _, value in (part.partition(":") for part in parts)]
        complete = all(":" in part for part in parts)
    elif text.count(":") == 1 and not _trailing_numbers(text):
        label, _, value = text.partition(":")
        pairs, complete = [(label.strip(), value.strip())], True
    else:
        pairs = _LABEL_PAIR.findall(text)
        ignored = _LABEL_PAIR.sub(" ", text).split()
        complete = all(is_number(token) for token in ignored)
    if not pairs or not complete or any(not label or is_number(label) for label, _ in pairs):
        return None
    return pairs, ignored


def _equalities(text: str) -> Pairs | None:
    """The pairs of `t=1 ax=0.5`, `temp = 21.5 C, rel hum = 40 %`, `msg="two words"`; None for any other text."""
    parts = [part for part in _BETWEEN_PAIRS.split(text) if part.strip()] if '"' not in text else []
    if len(parts) > 1 and all(part.count("=") == 1 for part in parts):
        return [(label.strip(), value.strip()) for label, _, value in (part.partition("=") for part in parts)]
    tokens = _TOKEN.findall(text) if text.count('"') % 2 == 0 else []
    pairs: Pairs = []
    i = 0
    while i + 1 < len(tokens):
        if tokens[i] == "=" or tokens[i + 1] != "=":
            return None
        has_value = i + 2 < len(tokens) and tokens[i + 2] != "=" and tokens[i + 3 : i + 4] != ["="]
        pairs.append((tokens[i], tokens[i + 2].strip('"') if has_value else ""))
        i += 3 if has_value else 2
    return pairs if i == len(tokens) and pairs else None


def _trailing_numbers(text: str) -> bool:
    """True for `a:1 5`: a value that is a number, and numbers behind it."""
    words = text.partition(":")[2].split()
    return len(words) > 1 and all(map(is_number, words))


def split_teleplot(line: str) -> Teleplot | None:
    """The parts of `>name:value`, `>name:ms:value§unit`, `>name:1000:1;2000:2`; None for any other line.

    Texts (`|t`) and shapes (`>3D|…`) are no samples.
    """
    match = _TELEPLOT.fullmatch(line)
    if match is None or "t" in (match[4] or "").split(","):
        return None
    samples: list[tuple[str, str]] = []
    for part in match[2].split(";"):
        stamp, colon, value = part.rpartition(":")
        if ":" in stamp or (colon and not is_number(stamp.strip())):
            return None
        samples.append((stamp.strip(), value.strip()))
    return Teleplot(match[1].strip(), tuple(samples), (match[3] or "").strip())


def split_stamp(line: str) -> tuple[str, str] | None:
    """(`12:00:00.023`, rest) of a line before which a serial monitor wrote its stamp; None for any other line."""
    if ":" not in line[:_STAMP_REACH]:
        return None
    match = _LINE_STAMP.fullmatch(line)
    return (match[1] or match[2], match[3]) if match else None


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
