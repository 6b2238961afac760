"""What a packed file holds: gzip and Zstandard, bounded, with progress, and never taken when cut short."""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from kalscope.common.progress import Progress
from kalscope.errors import BadFile

MAX_UNPACKED = 1 << 31
"""Largest size of an unpacked file in bytes: a small archive can hold terabytes of zeros."""

GZIP = b"\x1f\x8b"
ZSTANDARD = b"\x28\xb5\x2f\xfd"

_CHUNK = 1 << 20
_ZSTANDARD_CHUNK = 1 << 10
"""Packed bytes at a time: zstandard unpacks all of them at once, at most 32 MiB from 1 KiB of zeros."""


def is_packed(magic: bytes) -> bool:
    """True where a file that begins so is an archive that `unpacked` reads."""
    return magic.startswith((GZIP, ZSTANDARD))


def unpacked(path: Path, name: str, progress: Progress) -> Iterator[bytes]:
    """The content of an archive in pieces.

    Raises:
        BadFile: it is cut short or damaged, holds more than MAX_UNPACKED, or zstandard is not installed.
    """
    size, total = path.stat().st_size, 0
    with path.open("rb") as file:
        packed_by_gzip = file.read(2) == GZIP
        file.seek(0)
        for piece in _gunzip(file, name) if packed_by_gzip else _unzstandard(file, name):
            progress(0.5 * file.tell() / max(size, 1), "unpacking")
            total += len(piece)
            if total > MAX_UNPACKED:
                raise BadFile(f"{name} must unpack to at most {MAX_UNPACKED} bytes (got more)")
            yield piece


def _gunzip(file: BinaryIO, name: str) -> Iterator[bytes]:
    try:
        with gzip.GzipFile(fileobj=file) as stream:
            while piece := stream.read(_CHUNK):
                yield piece
    except (OSError, EOFError, zlib.error) as error:
        raise BadFile(f"{name} cannot be read as a gzip archive: {error}") from None


def _unzstandard(file: BinaryIO, name: str) -> Iterator[bytes]:
    try:
        import zstandard
    except ImportError:
        raise BadFile(
            f'{name} must be unpacked first, or "pip install zstandard" (got a Zstandard archive)'
        ) from None
    frame: Any = zstandard.ZstdDecompressor().decompressobj()
    try:
        while packed := file.read(_ZSTANDARD_CHUNK):
            while packed:
                yield frame.decompress(packed)
                packed = frame.unused_data if frame.eof else b""
                if packed:  # archives may be joined
                    frame = zstandard.ZstdDecompressor().decompressobj()
    except zstandard.ZstdError as error:
        raise BadFile(f"{name} cannot be read as a Zstandard archive: {error}") from None
    if not frame.eof:
        raise BadFile(f"{name} cannot be read as a Zstandard archive: it is cut short")
