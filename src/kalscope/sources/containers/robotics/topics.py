"""Turn the messages of a topic into a table: every numeric field is a channel with its full name."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, is_dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from kalscope.common.array import Array
from kalscope.common.memory import require_memory
from kalscope.common.progress import Progress
from kalscope.errors import BadFile, KalscopeError
from kalscope.sources.containers.parts import Part, choose_part
from kalscope.sources.containers.table import MAX_COLUMNS, MAX_NUMBERS, Table

_MAX_ELEMENTS = 64
"""Elements of an array that are channels; a longer one is an image or a scan."""
_MAX_DEPTH = 12
_STAMP_PARTS = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"))
"""Fields of a stamp: of ROS 2, of rosbags for ROS 1, and of ROS 1 itself, whose messages JSON may hold."""
_STAMP_FIELDS = {"header.seq"} | {f"header.stamp.{field}" for parts in _STAMP_PARTS for field in parts}
_MESSAGES_PER_REPORT = 1024
_ROW_BYTES, _NUMBER_BYTES = 160, 48
"""Memory that a message and each of its numbers take, bytes."""

Messages = Iterable[tuple[int, Any]]
"""(time at which it was logged in ns since 1970, decoded message)."""


@dataclass(frozen=True)
class Topic:
    """One topic of a log."""

    name: str
    """Its full name."""
    count: int
    """Messages that it holds."""
    messages: Callable[[], Messages]
    """Decodes them, in the order of the log; raises where it cannot."""


def read_topics(topics: Sequence[Topic], wanted: str | None, name: str, note: str, progress: Progress) -> Table:
    """The requested topic.

    Args:
        topics: The topics of the log.
        wanted: `ReadOptions.part`.
        name: The file.
        note: What it is: "a ROS 1 bag".
        progress: Reports the messages as they are decoded.

    Raises:
        BadFile: there is no topic with numbers, or it holds too many.
        BadSetting: there is no such topic.
    """
    fields: dict[str, list[str]] = {}
    without: list[str] = []
    for topic in topics:
        progress(0.0, "reading")
        found = _fields(topic)
        if found and topic.count:
            fields[topic.name] = found
        elif topic.count:
            without.append(topic.name)
    holding = [topic for topic in topics if topic.name in fields]
    parts = [Part(topic.name, topic.count, len(fields[topic.name])) for topic in holding]
    chosen, notes = choose_part(parts, wanted, name, "topic")
    if without:
        more = f" and {len(without) - 8} more" if len(without) > 8 else ""
        notes = (*notes, f"topics without numbers that can be read: {', '.join(without[:8])}{more}")
    topic, names = holding[chosen], fields[holding[chosen].name]
    if topic.count * len(names) > MAX_NUMBERS or len(names) > MAX_COLUMNS:
        raise BadFile(f"{name} must hold at most {MAX_COLUMNS} fields a message (got {len(names)} in {topic.name})")
    # As objects of Python, before they become an array.
    require_memory(topic.count * (_ROW_BYTES + _NUMBER_BYTES * len(names)), name, f"{topic.count} messages")
    time, values, clock = _read(topic, names, progress)
    return Table(
        names=tuple(f"{topic.name}/{field}" for field in names),
        units=("",) * len(names),
        columns=tuple(np.ascontiguousarray(values[:, j]) for j in range(len(names))),
        time=(time - time[0]).astype(np.float64) / 1e9,
        start=float(time[0]) / 1e9,
        clock=clock,
        notes=(note, *notes),
    )


def _fields(topic: Topic) -> list[str]:
    """Names of the numeric fields of the first message; none where it cannot be decoded."""
    try:
        first = next(iter(topic.messages()), None)
    except KalscopeError:
        raise
    except Exception:
        return []
    return [] if first is None else [field for field in leaves(first[1]) if field not in _STAMP_FIELDS]


def _read(topic: Topic, names: list[str], progress: Progress) -> tuple[NDArray[np.int64], Array, str]:
    """(ns since 1970, values, which clock it is): of the header's stamps where all messages have one."""
    logged: list[int] = []
    stamped: list[int] = []
    rows: list[list[float]] = []
    for i, (time, message) in enumerate(topic.messages()):
        if i % _MESSAGES_PER_REPORT == 0:
            progress(i / max(topic.count, 1), "reading")
        found = leaves(message)
        rows.append([found.get(field, np.nan) for field in names])
        logged.append(time)
        stamped.append(_stamp(found))
    by_header = bool(stamped) and all(stamped)
    clock = "time is that of the messages' headers" if by_header else "time is that of the log"
    return np.array(stamped if by_header else logged, dtype=np.int64), np.array(rows, dtype=np.float64), clock


def _stamp(found: dict[str, float]) -> int:
    """Time of the header of a message in ns since 1970; 0 unless both parts are present."""
    for parts in _STAMP_PARTS:
        seconds, rest = (found.get(f"header.stamp.{field}") for field in parts)
        if seconds is not None and rest is not None:
            return int(seconds) * 1_000_000_000 + int(rest)
    return 0


def leaves(message: Any) -> dict[str, float]:
    """The numbers of a message by their full names: `linear_acceleration.x`, `position[0]`."""
    found: dict[str, float] = {}
    _collect(message, "", found, 0)
    return found


def _collect(value: Any, name: str, found: dict[str, float], depth: int) -> None:
    if isinstance(value, (bool, int, float, np.number, np.bool_)):
        found[name] = float(cast("float", value))
    elif depth >= _MAX_DEPTH:
        return
    elif isinstance(value, dict) or is_dataclass(value):
        fields = cast("dict[str, Any]", value if isinstance(value, dict) else vars(value))
        for key, part in fields.items():
            _collect(part, f"{name}.{key}" if name else str(key), found, depth + 1)
    elif isinstance(value, (list, np.ndarray)) and 0 < len(cast("list[Any]", value)) <= _MAX_ELEMENTS:
        for i, part in enumerate(cast("list[Any]", value)):
            _collect(part, f"{name}[{i}]", found, depth + 1)
