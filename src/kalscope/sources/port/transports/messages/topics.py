"""Messages of MQTT as lines: the topic names the channel, the payload holds its value. Opens nothing.

One topic alone sends lines as any board does, and a bare number takes the name of its last level. Of several
topics each value becomes a line of Teleplot, `>barn/temperature:21.5`, so that topics may come and go.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from kalscope.errors import BadSetting
from kalscope.sources.grammar.cells import MISSING, is_number, split_measure
from kalscope.sources.grammar.json_line import flattened, load_json
from kalscope.sources.grammar.labels import find_labels
from kalscope.sources.port.transports.messages.text import decoded, is_binary, lines_of, one_line

MAX_PAYLOAD = 65_536
"""Bytes of one payload, as of one line: a larger one is a picture or a file."""
MAX_TOPIC = 200
"""Characters of the name that a topic gives to its channels; the rest is cut off."""

_CELLS = re.compile(r"[,;\s]+")
_NO_NAME = re.compile(r"[:;]")
_NO_MARK = re.compile(r"[>|§\x00-\x1f\x7f]")
_WILD = ("+", "#")


def check_topic(topic: str) -> None:
    """Raise BadSetting where a topic cannot be subscribed to."""
    levels = topic.split("/")
    wild = any(("+" in level and level != "+") or ("#" in level and level != "#") for level in levels)
    if not topic or wild or "#" in levels[:-1] or not topic.isprintable() or len(topic.encode()) > 65_535:
        raise BadSetting(
            f"a topic must have levels between /, + for a whole level, # for all that follow (got {topic!r:.100})"
        )


class Topics:
    """The topics of one subscription."""

    def __init__(self, subscribed: str) -> None:
        """Args: what is subscribed to, checked by `check_topic`."""
        levels = subscribed.split("/")
        wild = [i for i, level in enumerate(levels) if level in _WILD]
        self._skip = wild[0] if wild else len(levels) - 1
        self._is_one = not wild

    def lines(self, topic: str, payload: bytes, *, retained: bool = False) -> bytes:
        r"""The lines of one message, each with its \n.

        Args:
            topic: Its topic.
            payload: What it holds.
            retained: Whether the broker had kept it: a value of unknown age, of which only the names are used.
        """
        name = self._name(topic)
        if len(payload) > MAX_PAYLOAD:
            return _line(name, f"({len(payload)} bytes: a payload must have at most {MAX_PAYLOAD})")
        if is_binary(payload):
            return one_line(payload)
        text = decoded(payload).strip()
        values = list(_values(text))
        if self._is_one and [of for of, _, _ in values] != [""]:
            return f"# retained: {' '.join(text.split())}\n".encode() if retained else lines_of(payload)
        if not values:
            return _line(name, f"{' '.join(text.split())}|t")
        if retained:
            return b"".join(_line(name + of, "") for of, _, _ in values)
        return b"".join(_line(name + of, value + (f"§{unit}" if unit else "")) for of, value, unit in values)

    def _name(self, topic: str) -> str:
        levels = topic.split("/")
        name = "/".join(levels[self._skip :] or levels[-1:])
        return _printable(name).strip() or "topic"


def _printable(name: str) -> str:
    """A name without the marks of a line of Teleplot: a MAC address is AA-BB, not AA:BB."""
    return _NO_MARK.sub("_", _NO_NAME.sub("-", name))[:MAX_TOPIC]


def _line(name: str, value: str) -> bytes:
    return f">{name}:{value}\n".encode()


def _values(text: str) -> Iterable[tuple[str, str, str]]:
    """(end of the name, number, unit) of each value of a payload; nothing where it holds none."""
    if is_number(text) or text.lower() in MISSING - {""}:
        return [("", text, "")]
    if measure := split_measure(text):
        return [("", measure[0], measure[1])]
    if text.startswith(("{", "[")):
        return _of_json(text)
    found = find_labels(text)
    if found is not None:
        return _of_pairs((f".{label}", value) for label, value in found[0])
    cells = _CELLS.split(text)
    return [(f"[{i}]", cell, "") for i, cell in enumerate(cells)] if all(map(is_number, cells)) else []


def _of_json(text: str) -> Iterable[tuple[str, str, str]]:
    try:
        pairs = flattened(load_json(text))
    except ValueError:
        return []
    return _of_pairs((of if of.startswith("[") else f".{of}", value) for of, value in pairs or [])


def _of_pairs(pairs: Iterable[tuple[str, str]]) -> list[tuple[str, str, str]]:
    """Those of the values that are numbers, with their units."""
    values: list[tuple[str, str, str]] = []
    for of, value in pairs:
        name = _printable(of)
        if is_number(value):
            values.append((name, value, ""))
        elif measure := split_measure(value):
            values.append((name, measure[0], measure[1]))
    return values
