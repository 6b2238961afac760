"""One JSON document that holds the samples: its objects become lines of JSON, read by the ordinary rules.

Known shapes: a list of objects (perhaps in a list of lists, as Home Assistant returns, or under a key, as
ThingSpeak's "feeds"); an object of lists of one length, one per column; an object of lists of {ts, value}, as
ThingsBoard returns, one per name.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

from kalscope.common.memory import require_memory
from kalscope.common.progress import Progress
from kalscope.errors import BadFile
from kalscope.sources.containers.parts import Part, choose_text_part
from kalscope.sources.containers.table import Text
from kalscope.sources.grammar.json_line import load_json

MAX_BYTES = 1 << 28
"""Largest document, bytes: it is held in memory as a whole. A file with one object per line may be of any size."""

_COSTS = {b",": 60, b":": 60, b"[": 64, b"{": 200}
"""Approximate memory for each occurrence of a mark, bytes: of a value, a name, a list, an object."""
_TEXTS = 3
"""Copies of its characters in memory: the bytes of the file, its text, and the values."""
_MAX_DEPTH = 4
_KIND = "a JSON document"
Rows = list[dict[str, Any]]


def read_json_document(path: Path, name: str, part: str | None, progress: Progress) -> Text:
    """Read one table of a JSON document as lines of JSON.

    Raises:
        BadFile: it is too large, or holds no list of samples.
        NoMemory: its values will not fit into the memory that is free.
        BadSetting: there is no such part.
    """
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise BadFile(f"{name} must be at most {MAX_BYTES} bytes, or hold one object per line (got {size} bytes)")
    progress(0.0, "reading")
    data = path.read_bytes()
    _require_room(data, name)
    document = load_json(data.decode(json.detect_encoding(data), "replace"))
    progress(0.5, "reading")
    found = dict(_tables("", document, 0))
    parts = [Part(key, len(rows), len(rows[0])) for key, rows in found.items()]
    chosen, notes, inner = choose_text_part(parts, part, name, "list")
    rows = list(found.values())[chosen]
    return Text(map(_line, rows), (f"{_KIND}; line numbers count its objects", *notes), part=inner)


def _require_room(data: bytes, name: str) -> None:
    """Raise NoMemory if the values of a document will not fit: they take up to 25 times its size."""
    need = _TEXTS * len(data) + sum(cost * data.count(mark) for mark, cost in _COSTS.items())
    require_memory(need, name, "values of a JSON document", "write one object per line")


def _line(row: dict[str, Any]) -> str:
    return json.dumps(row, ensure_ascii=False)


def _tables(key: str, value: Any, depth: int) -> Iterator[tuple[str, Rows]]:
    """(key, objects) of every list of samples."""
    if isinstance(value, list):
        rows = _objects(cast("list[Any]", value))
        if rows:
            yield key or "list", rows
    elif isinstance(value, dict) and depth < _MAX_DEPTH:
        inner = cast("dict[str, Any]", value)
        columns = _columns(inner)
        series = _series(inner)
        if columns or series:
            yield key or "object", columns or series
            return
        for name, part in inner.items():
            yield from _tables(f"{key}.{name}" if key else name, part, depth + 1)


def _objects(value: list[Any]) -> Rows:
    """The objects of a list, and of the lists in it."""
    if value and all(isinstance(item, list) for item in value):
        value = [inner for item in cast("list[list[Any]]", value) for inner in item]
    if not value or not all(isinstance(item, dict) for item in value):
        return []
    return cast("Rows", value)


def _columns(value: dict[str, Any]) -> Rows:
    """`{"time": [0, 1], "x": [5, 6]}` by rows."""
    lists = {key: cast("list[Any]", part) for key, part in value.items() if isinstance(part, list)}
    plain = {key: part for key, part in lists.items() if part and not isinstance(part[0], (dict, list))}
    lengths = {len(part) for part in plain.values()}
    if len(plain) < 2 or len(lengths) != 1 or max(lengths) < 2:
        return []
    return [dict(zip(plain, cells, strict=True)) for cells in zip(*plain.values(), strict=True)]


def _series(value: dict[str, Any]) -> Rows:
    """`{"temp": [{"ts": 1, "value": 5}], …}` as a long table: name, ts, value."""
    if not value or not all(isinstance(part, list) for part in value.values()):
        return []
    rows = {key: _objects(cast("list[Any]", part)) for key, part in value.items()}
    firsts = [part[0] for part in rows.values() if part]
    if len(firsts) < len(rows) or not all(first.keys() == {"ts", "value"} for first in firsts):
        return []
    return [{"name": key, **row} for key, part in rows.items() for row in part]
