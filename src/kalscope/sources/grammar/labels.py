"""The pairs of a line that names its values: labels, equalities, JSON, and numbers followed by their units.

Pure functions on one line of text.
"""

from __future__ import annotations

import re

from kalscope.sources.grammar.cells import MISSING, is_number, split_measure
from kalscope.sources.grammar.json_line import find_object
from kalscope.sources.grammar.units import is_measure

Pairs = list[tuple[str, str]]

MAX_PAIRS, MAX_LABEL, MAX_PARTS = 64, 60, 2048
"""Pairs with units that a line may hold, length of a label of several words, and commas, semicolons and tabs."""

_BETWEEN_PAIRS, _BUT_COMMAS = re.compile(r"[,;&\t]"), re.compile(r"[;&\t]")
_COMMA_IN_NUMBER = re.compile(r"[0-9],[0-9]")
_TOKEN = re.compile(r'"[^"]*"|[^\s,;&="]+|=')
# A label begins where a word begins and never backtracks, else each position in a long word would be tried.
_LABEL_PAIR = re.compile(r"(?<![^\s:])([^\s:]++)\s*+:\s*(\S+)")
_LEVEL = re.compile(r"\[?(?:TRACE|DEBUG|INFO|NOTICE|WARN|WARNING|ERROR)\]?:?[ \t]+")
"""What a logger writes before its text."""
_PIECE = re.compile(r"[^\s:=,;|]+|[:=]")
_ESPHOME = re.compile(
    r"(?:\[[^\]\s]{0,40}\]){0,3}:?[ ]?'([^']{1,60})'(?:: Sending state| >>) (\S{1,24})(?: ([^\s0-9]{1,8}))?"
    r"(?: with [0-9]{1,2} decimals of accuracy)?"
)
"""`[D][sensor:094]: 'Barn': Sending state 20.5 °C with 1 decimals of accuracy`, `'Barn' >> 20.5 °C`: ESPHome."""
_TOPIC = re.compile(r"([A-Za-z$][^\s,;:=\"{]{0,200}) (\S{1,40})")
"""`home/barn/temperature 21.5`: what mosquitto_sub -v writes."""
_MAX_PREFIX = 240
"""Characters before the object of `tele/barn/SENSOR = {"Temperature": 21.5}`."""


def find_labels(line: str) -> tuple[Pairs, list[str]] | None:
    """(label, value text) pairs of `a:1,b:2`, `a: 1 b: 2`, `Sensor Value: 155, Volts: 0.76`, `a=1 b=2`, `{"a":1}`.

    Returns:
        The pairs, and the bare numbers among them that have no label: `a:1 5`. None if anything else is on the
        line, or a label is a number (`12:30:05`). Between commas a bare number could be the decimals of the value
        before it, so there it is refused as well.
    """
    is_endless = len(line) > MAX_PARTS and sum(map(line.count, ",;\t")) > MAX_PARTS
    if is_endless or not any(mark in line for mark in (":", "=", "/", ">>")):
        return None
    if line[:1].isdecimal() and line.isascii() and line.lower() == line.upper():
        return None  # a number and no letter, as in a table with a clock
    text = _LEVEL.sub("", line.strip().removeprefix(">"), count=1)
    ignored: list[str] = []
    if text.startswith("{"):
        found = find_object(text)
        return None if found is None else (found, ignored)
    found = _logged(text)
    if found is not None:
        return found, ignored
    equal = _equalities(text) if "=" in text else None
    if equal is not None:
        pairs, complete = equal, True
    elif any(mark in text for mark in ",;\t"):
        parts = _parts(text)
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
        measured = _measures(text)
        return None if measured is None else (measured, [])
    return [(label, _unstarred(value)) for label, value in _with_axes(pairs)], ignored


def _logged(text: str) -> Pairs | None:
    """The pairs of a line of ESPHome or MQTT: a quoted name and its state, a topic and its value or object."""
    if "'" in text and (match := _ESPHOME.fullmatch(text)):
        return [(match[1], f"{match[2]} {match[3]}" if match[3] else match[2])]
    start = text.find("{", 0, _MAX_PREFIX)
    if start > 0 and text.endswith("}"):
        before = text[:start]
        found = find_object(text[start:]) if not any(mark in before for mark in ',;"') else None
        words = before.rstrip(" =:\t").split()
        topic = words[-1] + "." if words and "/" in words[-1] else ""
        return found and [(topic + name, value) for name, value in found]
    match = _TOPIC.fullmatch(text) if "/" in text else None
    is_topic = (
        match is not None and "/" in match[1] and match[1].lower() not in MISSING and not is_measure(match[1])
    )
    return [(match[1], match[2])] if match is not None and is_topic and _is_value(match[2]) else None


def _with_axes(pairs: Pairs) -> Pairs:
    """`Rotation X: 1, Y: 2, Z: 3` names Rotation Y and Rotation Z."""
    words, _, axis = pairs[0][0].rpartition(" ")
    rest = "".join(label for label, _ in pairs[1:])
    if not words or axis + rest not in ("XY", "XYZ", "xy", "xyz"):
        return pairs
    return [pairs[0], *((f"{words} {label}", value) for label, value in pairs[1:])]


def _unstarred(value: str) -> str:
    """`21.5 *C` as `21.5 C`: boards write the asterisk where they lack a degree sign."""
    return f"{value[:-2].rstrip()} {value[-1]}" if value[-2:] in ("*C", "*F") else value


def _measures(text: str) -> Pairs | None:
    """The pairs of `Temp: 21.5 C Rel Hum: 40 %`, `T = 21.5 *C`: separated by blanks, units after numbers."""
    names: list[list[str]] = [[]]
    for word in _PIECE.findall(text)[: 6 * MAX_PAIRS]:
        if word in (":", "="):
            names.append([])
        else:
            names[-1].append(word)
    label, pairs = " ".join(names[0]), list[tuple[str, str]]()
    for k, words in enumerate(names[1:], 2):
        values, after = _leading_values(words)
        # A label before each value, and none after the last.
        if not 0 < len(label) <= MAX_LABEL or is_number(label) or not values or (k == len(names)) == bool(after):
            return None
        pairs += [(label if n == 1 else f"{label} {n}", value) for n, value in enumerate(values, 1)]
        label = " ".join(after)
    return pairs or None


def _leading_values(words: list[str]) -> tuple[list[str], list[str]]:
    """The values that words begin with, and the rest: `21.0°C 70°F Heat index` holds two, both with units."""
    values: list[str] = []
    while words and _is_value(words[0]):
        unit = next((n for n in (2, 1) if is_measure("".join(words[1 : 1 + n]).lstrip("*"))), 0)
        if values and not unit and split_measure(words[0]) is None:
            break
        values.append(" ".join((words[0], "".join(words[1 : 1 + unit]).lstrip("*"))).strip())
        words = words[1 + unit :]
    return values, words


def _is_value(word: str) -> bool:
    return is_number(word) or word.lower() in MISSING or split_measure(word) is not None


def _parts(text: str) -> list[str]:
    """The texts between commas, semicolons or tabs; the commas of `T=20,5;H=40,1` are decimal ones."""
    commas = text.count(",")
    is_decimal = commas and _BUT_COMMAS.search(text) and len(_COMMA_IN_NUMBER.findall(text)) == commas
    return [part for part in (_BUT_COMMAS if is_decimal else _BETWEEN_PAIRS).split(text) if part.strip()]


def _equalities(text: str) -> Pairs | None:
    """The pairs of `t=1 ax=0.5`, `temp = 21.5 C, rel hum = 40 %`, `msg="two words"`; None for any other text."""
    parts = _parts(text) if '"' not in text else []
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
    """True for `a:1 5`: a value that is a number, and numbers after it."""
    words = text.partition(":")[2].split()
    return len(words) > 1 and all(map(is_number, words))
