"""Containers that hold text: one JSON document, and zip archives of tables."""

from __future__ import annotations

import json
import re
import zipfile
import zlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any, cast

from kalscope.common.files import require_memory
from kalscope.common.progress import Progress
from kalscope.common.text import count, one_line
from kalscope.errors import BadFile
from kalscope.sources.containers.table import Part, Text, choose_text_part
from kalscope.sources.grammar.line_format import SERIES_KEY, load_json

# One JSON document that holds the samples: its objects become lines of JSON, read by the ordinary rules.
#
# Known shapes: a list of objects or of lists (perhaps in a list of lists, as Home Assistant returns, or under a
# key, as ThingSpeak's "feeds"); an object of lists of one length, one per column; an object of lists of
# {ts, value}, as ThingsBoard returns, one per name.


MAX_BYTES = 1 << 28
"""Largest document, bytes: it is held in memory as a whole. A file with one object per line may be of any size."""

_COSTS = {b",": 60, b":": 60, b"[": 64, b"{": 200}
"""Approximate memory for each occurrence of a mark, bytes: of a value, a name, a list, an object."""
_SEVERAL = re.compile(r"^\}\s{0,99}^\{", re.MULTILINE)
"""Between two objects, each on several lines, that follow each other in one file."""
Rows = list[dict[str, Any]] | list[list[Any]]


def read_json_document(path: Path, name: str, part: str | None, progress: Progress) -> Text:
    """Read one table of a JSON document as lines of JSON.

    Raises:
        BadFile: it is too large, or holds no list of samples.
        NoMemory: its values will not fit into the memory that is free: they take up to 25 times its size.
        BadSetting: there is no such part.
    """
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise BadFile(f"{name} must be at most {MAX_BYTES} bytes, or hold one object per line (got {size} bytes)")
    progress(0.0, "reading")
    data = path.read_bytes()
    # Its characters are in memory three times: the bytes of the file, its text, and the values.
    need = 3 * size + sum(cost * data.count(mark) for mark, cost in _COSTS.items())
    require_memory(need, name, "values of a JSON document", "write one object per line")
    text = data.decode(json.detect_encoding(data), "replace").lstrip("\ufeff \t\r\n")
    if text.startswith("{") and _SEVERAL.search(text):
        text = f"[{_SEVERAL.sub('},{', text)}]"
    document = load_json(text)
    progress(0.5, "reading")
    found = dict(_tables("", document, 0))
    parts = [Part(key, len(rows), len(rows[0])) for key, rows in found.items()]
    chosen, notes, inner = choose_text_part(parts, part, name, "list")
    rows = list(found.values())[chosen]
    kind = "a JSON document; line numbers count its objects"
    if isinstance(rows[0], list):
        return Text((",".join(map(str, row)) for row in rows), (kind, *notes), ",", inner)
    return Text((json.dumps(row, ensure_ascii=False) for row in rows), (kind, *notes), part=inner)


def _list(value: Any) -> list[Any]:
    return cast("list[Any]", value) if isinstance(value, list) else []


def _dict(value: Any) -> dict[str, Any]:
    return cast("dict[str, Any]", value) if isinstance(value, dict) else {}


def _tables(key: str, value: Any, depth: int) -> Iterator[tuple[str, Rows]]:
    """(key, rows) of every list of samples; a list of one object may hold one."""
    rows = _rows(_list(value)) or _columns(_dict(value)) or _series(_dict(value))
    within = [(key, rows[0])] if len(rows) == 1 else []
    within = within if rows else [(f"{key}.{name}" if key else name, part) for name, part in _dict(value).items()]
    below = [table for name, part in within if depth < 8 for table in _tables(name, part, depth + 1)]
    yield from below or ([(key or "list", rows)] if rows else [])


def _rows(value: list[Any]) -> Rows:
    """The objects of a list, and of the lists in it; lists of plain values are rows themselves."""
    if value and all(map(_list, value)):
        lists = [_list(item) for item in value]
        if all(isinstance(cell, str) for item in lists for cell in item):
            return lists
        value = [inner for item in lists for inner in item]
    return (_of_pairs(value) or value) if all(map(_dict, value)) else []


def _of_pairs(series: list[dict[str, Any]]) -> Rows:
    """`[{"metric": {"name": "temp"}, "values": [[0, "5"], …]}, …]` of Prometheus or InfluxDB, as a long table."""
    rows: list[dict[str, Any]] = []
    for one in series:
        names = [str(name) for name in _list(one.get("columns"))] or ["time", "value"]
        grid = next((part for part in map(_list, one.values()) if part and _is_grid(part, len(names))), None)
        if not grid:
            return []
        key = " ".join(map(str, _dict(one.get("metric") or one.get("tags")).values()))
        rows += [{SERIES_KEY: key, **dict(zip(names, row, strict=True))} for row in grid]
    return rows


def _is_grid(value: list[Any], width: int) -> bool:
    return all(len(_list(row)) == width and not any(map(_list, _list(row))) for row in value)


def _columns(value: dict[str, Any]) -> Rows:
    """`{"time": [0, 1], "x": [5, 6]}`, `{"x": {"data": [5]}}` and `{"columns": ["x"], "data": [[5]]}` by rows."""
    if "columns" in value:
        return _of_pairs([value])
    lists = {key: _list(part) or _list(_dict(part).get("data")) for key, part in value.items()}
    plain = {key: part for key, part in lists.items() if part and not isinstance(part[0], (dict, list))}
    lengths = {len(part) for part in plain.values()}
    if len(plain) < 2 or len(lengths) != 1 or max(lengths) < 2:
        return []
    return [dict(zip(plain, cells, strict=True)) for cells in zip(*plain.values(), strict=True)]


def _series(value: dict[str, Any]) -> Rows:
    """`{"temp": [{"ts": 1, "value": 5}], …}` as a long table: name, ts, value."""
    rows = [{"name": key, **_dict(row)} for key, part in value.items() for row in _list(part) or [part]]
    return rows if all(row.keys() == {"name", "ts", "value"} for row in rows) else []


# Zip archives of text tables, as phone apps share them (phyphox, Sensor Logger): one table is read.


_MAX_FILES = 1000
_PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Other methods unpack a whole piece at once: gigabytes from one kilobyte of bzip2."""


def read_zip(path: Path, name: str, part: str | None, progress: Progress) -> Text:
    """Read one table of an archive as text: the requested one, else that with most digits.

    Raises:
        BadFile: there is no table of text, there are too many, it is too large, or packed in another way.
        BadSetting: there is no such table.
    """
    with zipfile.ZipFile(path) as archive:
        files = [info for info in archive.infolist() if not info.is_dir()]
    tables = [info for info in files if _may_be_table(PurePosixPath(info.filename))]
    if len(tables) > _MAX_FILES:
        raise BadFile(f"{name} must hold at most {_MAX_FILES} tables (got {len(tables)})")
    for info in tables:
        if info.flag_bits & 1 or info.compress_type not in _PACKINGS:
            table = one_line(info.filename)
            raise BadFile(f"{name} must be packed by Deflate, without a password (got {table}): unpack it first")
    with zipfile.ZipFile(path) as archive:
        digits = [_share_of_digits(archive, info) for info in tables]
    progress(0.5, "unpacking")
    parts = [
        Part(one_line(info.filename), int(share * info.file_size), 1, f"{count(info.file_size)} bytes")
        for info, share in zip(tables, digits, strict=True)
    ]
    if not any(part.rows for part in parts):
        held = ", ".join(one_line(info.filename) for info in files[:8]) or "nothing"
        raise BadFile(f"{name} must hold a table of numbers, such as a .csv file (got a zip archive of {held})")
    chosen, notes, inner = choose_text_part(parts, part, name, "table")
    progress.unpack(tables[chosen].file_size)  # more than that is never unpacked
    said = f'a zip archive; line numbers count in "{parts[chosen].name}"'
    return Text(_pieces(path, tables[chosen], name), (said, *notes), part=inner)


def _may_be_table(path: PurePosixPath) -> bool:
    """False for other files, and for the dot files in which macOS keeps metadata."""
    return path.suffix.lower() in (".csv", ".tsv", ".txt", ".dat", ".log") and not path.name.startswith(".")


def _share_of_digits(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> float:
    """By it a table of numbers is told from one of text, such as the properties of a phone."""
    with archive.open(info) as stream:
        head = stream.read(8192)
    return sum(head.count(digit) for digit in b"0123456789") / max(1, len(head))


def _pieces(path: Path, table: zipfile.ZipInfo, name: str) -> Iterator[bytes]:
    try:
        with zipfile.ZipFile(path) as archive, archive.open(table) as stream:
            yield from iter(partial(stream.read, 1 << 20), b"")
    except (zipfile.BadZipFile, zlib.error, EOFError) as damage:
        raise BadFile(f"{name} cannot be read as a zip archive: {one_line(str(damage))}") from None
