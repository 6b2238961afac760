"""JSON as pairs of a name and a text: one object per line, as boards and MQTT loggers write it."""

from __future__ import annotations

import json
from typing import Any, cast

MAX_VALUES = 256
"""Values of one object; one with more is not a row of samples."""


def load_json(text: str) -> Any:
    """The value that a JSON text holds, its numbers left as they are written.

    Raises:
        ValueError: it is not JSON, or nested too deep.
    """
    try:
        return json.loads(text, parse_float=str, parse_int=str, parse_constant=str)
    except RecursionError:
        raise ValueError("JSON nested too deep") from None


def find_object(line: str) -> list[tuple[str, str]] | None:
    """The values of an object with their full names; None for any other line.

    `{"t": 1, "imu": {"acc": [0.1, 9.8]}}` holds t, imu.acc[0] and imu.acc[1].
    """
    try:
        value = load_json(line)
    except ValueError:
        return None
    return flattened(value) if isinstance(value, dict) else None


def flattened(value: Any) -> list[tuple[str, str]] | None:
    """(full name, text) of each value of an object; None where it holds none, or more than MAX_VALUES."""
    pairs: list[tuple[str, str]] = []
    waiting: list[tuple[str, Any]] = [("", value)]  # a stack, not a recursion: outside text may nest deep
    while waiting:
        name, item = waiting.pop()
        inner: list[tuple[str, Any]] = []
        if isinstance(item, dict):
            parts = cast("dict[str, Any]", item)
            inner = [(f"{name}.{key}" if name else key, part) for key, part in parts.items()]
        elif isinstance(item, list):
            inner = [(f"{name}[{i}]", part) for i, part in enumerate(cast("list[Any]", item)[: MAX_VALUES + 1])]
        else:
            pairs.append((name, _text(item)))
        if len(pairs) + len(waiting) + len(inner) > MAX_VALUES:
            return None
        waiting += reversed(inner)
    return pairs or None


def _text(value: Any) -> str:
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else " ".join(str(value).split())
