"""Containers that hold text: one JSON document, and zip archives of tables."""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any, cast

from kalscope.common.files import require_memory
from kalscope.common.progress import Progress
from kalscope.common.text import one_line
from kalscope.errors import BadFile
from kalscope.sources.containers.table import Part, Text, choose_text_part
from kalscope.sources.grammar.cells import wide_encoding
from kalscope.sources.grammar.line_format import load_json

# One JSON document that holds the samples: its objects become lines of JSON, read by the ordinary rules.
#
# Known shapes: a list of objects (perhaps in a list of lists, as Home Assistant returns, or under a key, as
# ThingSpeak's "feeds"); an object of lists of one length, one per column; an object of lists of {ts, value}, as
# ThingsBoard returns, one per name.


MAX_BYTES = 1 << 28
"""Largest document, bytes: it is held in memory as a whole. A file with one object per line may be of any size."""

_COSTS = {b",": 60, b":": 60, b"[": 64, b"{": 200}
"""Approximate memory for each occurrence of a mark, bytes: of a value, a name, a list, an object."""
_TEXTS = 3
"""Copies of its characters in memory: the bytes of the file, its text, and the values."""
_MAX_DEPTH = 4
_SEVERAL = re.compile(r"^\}\s{0,99}^\{", re.MULTILINE)
"""Between two objects, each on several lines, that follow each other in one file."""
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
    text = data.decode(json.detect_encoding(data), "replace")
    if _SEVERAL.search(text) and text.lstrip("\ufeff \t\r\n").startswith("{"):
        text = f"[{_SEVERAL.sub('},{', text)}]"
    document = load_json(text)
    progress(0.5, "reading")
    found = dict(_tables("", document, 0))
    parts = [Part(key, len(rows), len(rows[0])) for key, rows in found.items()]
    chosen, notes, inner = choose_text_part(parts, part, name, "list")
    rows = list(found.values())[chosen]
    delimiter = "," if isinstance(rows[0], list) else None
    return Text(map(_line, rows), (f"{_KIND}; line numbers count its objects", *notes), delimiter, inner)


def _require_room(data: bytes, name: str) -> None:
    """Raise NoMemory if the values of a document will not fit: they take up to 25 times its size."""
    need = _TEXTS * len(data) + sum(cost * data.count(mark) for mark, cost in _COSTS.items())
    require_memory(need, name, "values of a JSON document", "write one object per line")


def _line(row: Any) -> str:
    return (
        ",".join(map(str, cast("list[Any]", row))) if isinstance(row, list) else json.dumps(row, ensure_ascii=False)
    )


def _tables(key: str, value: Any, depth: int) -> Iterator[tuple[str, Rows]]:
    """(key, objects) of every list of samples."""
    if isinstance(value, list):
        items = cast("list[Any]", value)
        rows = _objects(items)
        inner = list(_tables(key, rows[0], depth)) if len(rows) == 1 else []
        if inner or rows:
            yield from inner or [(key or "list", rows)]
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
    """The objects of a list, and of the lists in it; lists of plain values are rows themselves."""
    if value and all(isinstance(item, list) for item in value):
        if all(isinstance(cell, str) for item in value for cell in item):
            return value
        value = [inner for item in cast("list[list[Any]]", value) for inner in item]
    if not value or not all(isinstance(item, dict) for item in value):
        return []
    return _of_pairs(cast("Rows", value)) or cast("Rows", value)


def _of_pairs(series: Rows) -> Rows:
    """`[{"metric": {"name": "temp"}, "values": [[0, "5"], …]}, …]`, as Prometheus returns, as a long table."""
    rows: Rows = []
    for one in series:
        lists = (cast("list[Any]", part) for part in one.values() if isinstance(part, list))
        pairs = next((part for part in lists if all(map(_is_pair, part))), None)
        if not pairs:
            return []
        metric = one.get("metric")
        name = " ".join(map(str, cast("dict[str, Any]", metric).values() if isinstance(metric, dict) else ()))
        rows += [{"name": name, "time": time, "value": value} for time, value in cast("list[list[Any]]", pairs)]
    return rows


def _is_pair(value: Any) -> bool:
    parts = cast("list[Any]", value) if isinstance(value, list) else []
    return len(parts) == 2 and all(isinstance(part, (int, float, str)) for part in parts)


def _columns(value: dict[str, Any]) -> Rows:
    """`{"time": [0, 1], "x": [5, 6]}`, `{"x": {"data": [5]}}` and `{"columns": ["x"], "data": [[5]]}` by rows."""
    names, parts = value.get("columns"), [part for part in value.values() if isinstance(part, list)]
    table = next((part for part in parts if isinstance(names, list) and _is_grid(part, len(names))), None)
    if table:
        return [dict(zip(map(str, names), row, strict=True)) for row in table]
    lists = {
        key: part["data"] if isinstance(part, dict) and "data" in part else part for key, part in value.items()
    }
    lists = {key: cast("list[Any]", part) for key, part in lists.items() if isinstance(part, list)}
    plain = {key: part for key, part in lists.items() if part and not isinstance(part[0], (dict, list))}
    lengths = {len(part) for part in plain.values()}
    if len(plain) < 2 or len(lengths) != 1 or max(lengths) < 2:
        return []
    return [dict(zip(plain, cells, strict=True)) for cells in zip(*plain.values(), strict=True)]


def _is_grid(value: list[Any], width: int) -> bool:
    return all(isinstance(row, list) and len(cast("list[Any]", row)) == width for row in value)


def _series(value: dict[str, Any]) -> Rows:
    """`{"temp": [{"ts": 1, "value": 5}], …}` as a long table: name, ts, value."""
    if not value or not all(isinstance(part, list) for part in value.values()):
        return []
    rows = {key: _objects(cast("list[Any]", part)) for key, part in value.items()}
    firsts = [part[0] for part in rows.values() if part]
    if len(firsts) < len(rows) or not all(first.keys() == {"ts", "value"} for first in firsts):
        return []
    return [{"name": key, **row} for key, part in rows.items() for row in part]


# Zip archives of text tables, as phone apps share them (phyphox, Sensor Logger): one table is read.


_ZIP_ARCHIVE_TEXTS = (".csv", ".tsv", ".txt", ".dat", ".log")
_MAX_FILES = 1000
_PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Other methods unpack a whole piece at once: gigabytes from one kilobyte of bzip2."""
_HEAD_BYTES = 8192
_HEAD_LINES = 100
"""Lines used to count the columns."""
_CHUNK = 1 << 20
_NUMBER = re.compile(r"(?<![^\s,;])[-+]?[0-9][0-9.]{0,30}(?:[eE][-+]?[0-9]{1,3})?(?![^\s,;])")


def read_zip(path: Path, name: str, part: str | None, progress: Progress) -> Text:
    """Read one table of an archive as text.

    Raises:
        BadFile: there is no table of text, there are too many, they are too large, or packed in another way.
        BadSetting: there is no such table.
    """
    with zipfile.ZipFile(path) as archive:
        files = [info for info in archive.infolist() if not info.is_dir()]
        tables = [info for info in files if _may_be_table(info.filename)]
        if len(tables) > _MAX_FILES:
            raise BadFile(f"{name} must hold at most {_MAX_FILES} tables (got {len(tables)})")
        progress.unpack(sum(info.file_size for info in tables))  # more than that is never unpacked
        _require_unpackable(tables, name)
        measured = [(info, _measured(archive, info, progress)) for info in tables]
    measured = [(info, part) for info, part in measured if part.channels and part.rows]
    if not measured:
        held = ", ".join(one_line(info.filename) for info in files[:8]) or "nothing"
        raise BadFile(f"{name} must hold a table of numbers, such as a .csv file (got a zip archive of {held})")
    parts = [one for _, one in measured]
    chosen, notes, inner = choose_text_part(parts, part, name, "table")
    said = f'a zip archive; line numbers count in "{parts[chosen].name}"'
    return Text(_lines(path, measured[chosen][0]), (said, *notes), part=inner)


def _require_unpackable(tables: list[zipfile.ZipInfo], name: str) -> None:
    for info in tables:
        if info.flag_bits & 1 or info.compress_type not in _PACKINGS:
            how = "an encrypted" if info.flag_bits & 1 else "another"
            raise BadFile(
                f"{name} must hold tables that are packed by Deflate, without a password (got {how} one:"
                f" {one_line(info.filename)}); unpack it first"
            )


def _may_be_table(name: str) -> bool:
    """False for other files, and for the dot files in which macOS keeps metadata."""
    path = PurePosixPath(name)
    return path.suffix.lower() in _ZIP_ARCHIVE_TEXTS and not path.name.startswith(".")


def _measured(archive: zipfile.ZipFile, info: zipfile.ZipInfo, progress: Progress) -> Part:
    """The rows of a table, and the numbers that most of its first lines hold."""
    progress(0.5, "unpacking")
    with archive.open(info) as stream:
        head = stream.read(_HEAD_BYTES)
        rows = head.count(b"\n")
        while piece := stream.read(_CHUNK):
            progress(0.5, "unpacking")
            rows += piece.count(b"\n")
    lines = head.decode(_encoding(head), "replace").splitlines()[:_HEAD_LINES]
    lines = [line.replace(",", ".") if ";" in line else line for line in lines]
    numbers = Counter(count for line in lines if (count := len(_NUMBER.findall(line))))
    return Part(one_line(info.filename), rows, numbers.most_common(1)[0][0] if numbers else 0)


def _encoding(head: bytes) -> str:
    if (wide := wide_encoding(head)) is not None:
        return wide
    try:
        head[:-4].decode("utf-8-sig")  # the last character may be cut
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


def _lines(path: Path, table: zipfile.ZipInfo) -> Iterator[str]:
    with zipfile.ZipFile(path) as archive, archive.open(table) as stream:
        encoding = _encoding(stream.read(_HEAD_BYTES))
        stream.seek(0)
        for line in io.TextIOWrapper(stream, encoding, errors="replace"):
            yield line.removesuffix("\n")
