"""Zip archives of text tables, as phone apps share them (phyphox, Sensor Logger): one table is read."""

from __future__ import annotations

import io
import zipfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from kalscope.common.progress import Progress
from kalscope.common.text import one_line
from kalscope.errors import BadFile
from kalscope.sources.containers.parts import Part, choose_text_part
from kalscope.sources.containers.table import Text
from kalscope.sources.grammar.cells import is_number, split_fields
from kalscope.sources.grammar.wide_text import wide_encoding

_TEXTS = (".csv", ".tsv", ".txt", ".dat", ".log")
_MAX_FILES = 1000
_PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Other methods unpack a whole piece at once: gigabytes from one kilobyte of bzip2."""
_HEAD_BYTES = 8192
_HEAD_LINES = 100
"""Lines used to count the columns."""
_CHUNK = 1 << 20
_DELIMITERS = "\t;, "


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
    return path.suffix.lower() in _TEXTS and not path.name.startswith(".")


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
    numbers = Counter(count for line in lines if (count := _numbers(line)))
    return Part(one_line(info.filename), rows, numbers.most_common(1)[0][0] if numbers else 0)


def _numbers(line: str) -> int:
    """Cells of a line that are numbers, however it is split."""
    return max(
        sum(is_number(cell, mark) for cell in split_fields(line, delimiter))
        for delimiter in _DELIMITERS
        for mark in ".,"
        if delimiter != mark
    )


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
    with zipfile.ZipFile(path) as archive, archive.open(table) as stream:
        for line in io.TextIOWrapper(stream, encoding, errors="replace"):
            yield line.removesuffix("\n")
