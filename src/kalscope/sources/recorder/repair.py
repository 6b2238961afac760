"""A recording whose last line was cut short: whole lines stay, the rest is moved aside.

A program that is killed may leave half a line; a power cut may leave zeros after it, or zeros with old bytes of
the disk after them. So the file ends with the last newline before the first zero byte. What follows is appended
to NAME.torn and is on the disk before the file is cut.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import BinaryIO

from kalscope.errors import BadFile
from kalscope.sources.grammar.cells import is_comment
from kalscope.sources.recorder.format import MAGIC, REJECTS_MAGIC, STARTED
from kalscope.sources.recorder.paths import torn_path

_BLOCK = 1 << 20
_HEAD_BYTES = 65_536


@dataclass(frozen=True)
class RepairReport:
    """What a repair did."""

    kept: int
    """Bytes of whole lines that stay in the file."""
    torn: int
    """Bytes after them, moved aside; 0 where the file was whole."""
    torn_path: Path | None
    """Where they went; None where the file was whole."""


@dataclass(frozen=True)
class RecordingEnds:
    """The times and the header in the first and last lines of a recording."""

    wall: float | None
    """Unix time at host time 0, s; None where the file ends before that line."""
    header: str
    """The CSV header with its newline; "" where the file ends before it."""
    host: float
    """Host time of the last row, s; 0 where there is none."""


def repair(path: Path) -> RepairReport:
    """Cut a recording, or its file of rejected lines, at its last whole line.

    Args:
        path: NAME.csv or NAME.rejects. No program may be writing to it.

    Returns:
        What was kept and what was moved to NAME.torn (NAME.rejects.torn for the rejected lines).

    Raises:
        BadFile: The file is not a Kalscope recording, or there is no space to move the torn tail to; the recording
            is then unchanged.
    """
    path = Path(path)
    try:
        with path.open("rb+") as file:
            _check_ours(file, path)
            size, kept = file.seek(0, os.SEEK_END), _end_of_whole_lines(file)
            if kept == size:
                return RepairReport(kept, 0, None)
            torn = torn_path(path)
            _move_aside(file, kept, torn)
            file.truncate(kept)
            file.flush()
            os.fsync(file.fileno())
            return RepairReport(kept, size - kept, torn)
    except OSError as error:
        raise BadFile(f"cannot repair the recording {path.name}: {error.strerror}") from None


def read_ends(path: Path) -> RecordingEnds:
    """The times and the header of a repaired recording.

    Raises:
        BadFile: Its comments or its last row cannot be understood.
        OSError: It cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES).decode("utf-8", "replace").splitlines(keepends=True)
        size = file.seek(0, os.SEEK_END)
        start = max(0, size - _HEAD_BYTES)
        file.seek(start)
        tail = file.read().decode("utf-8", "replace").splitlines()[1 if start else 0 :]
    started = next((line for line in head if line.startswith(STARTED)), None)
    header = next((line for line in head if not is_comment(line)), "")
    rows = [line for line in tail if not is_comment(line) and line + "\n" != header]
    try:
        wall = None if started is None else datetime.fromisoformat(started[len(STARTED) :].split()[0]).timestamp()
        host = float(rows[-1].partition(",")[0]) if rows else 0.0
    except (ValueError, IndexError):
        raise BadFile(f"{path.name} must be a recording as it was written (got one that was edited)") from None
    return RecordingEnds(wall, header, host)


def _check_ours(file: BinaryIO, path: Path) -> None:
    head = file.read(_HEAD_BYTES)
    for magic in (MAGIC.encode(), REJECTS_MAGIC.encode()):
        if head.startswith(magic) or magic.startswith(head.partition(b"\0")[0]):
            return
    raise BadFile(f"{path.name} must begin with {MAGIC!r}, as a recording does (got {head[:40]!r})")


def _end_of_whole_lines(file: BinaryIO) -> int:
    """Offset after the last newline before the first zero byte."""
    file.seek(0)
    end, offset = 0, 0
    while block := file.read(_BLOCK):
        zero = block.find(b"\0")
        newline = block.rfind(b"\n", 0, zero if zero >= 0 else len(block))
        end = offset + newline + 1 if newline >= 0 else end
        if zero >= 0:
            break
        offset += len(block)
    return end


def _move_aside(file: BinaryIO, start: int, torn: Path) -> None:
    """Append what follows `start` to `torn`, and sync it to the disk."""
    with torn.open("ab") as out:
        before = out.tell()
        try:
            file.seek(start)
            while block := file.read(_BLOCK):
                out.write(block)
            out.write(b"\n")  # tails of several crashes stay apart
            out.flush()
            os.fsync(out.fileno())
        except OSError:
            os.ftruncate(out.fileno(), before)
            raise
