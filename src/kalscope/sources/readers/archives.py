"""What a packed file holds: gzip and Zstandard, bounded, with progress, and refused when cut short."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from kalscope.common.progress import Progress
from kalscope.errors import BadFile

GZIP = b"\x1f\x8b"
ZSTANDARD = b"\x28\xb5\x2f\xfd"

_CHUNKS = {"gzip": 1 << 12, "Zstandard": 1 << 10}
"""Packed bytes that are unpacked at once: 1 KiB of Zstandard holds 32 MiB of zeros, 4 KiB of gzip 4 MiB."""


def is_packed(magic: bytes) -> bool:
    """True where a file with these first bytes is an archive that `unpacked` reads."""
    return magic.startswith((GZIP, ZSTANDARD))


def unpacked(path: Path, name: str, progress: Progress) -> Iterator[bytes]:
    """The content of an archive in pieces.

    Raises:
        BadFile: it is cut short or damaged, unpacks to too much, or zstandard is not installed.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        kind = "gzip" if file.read(2) == GZIP else "Zstandard"
        file.seek(0)
        for piece in _unpacked(file, name, kind):
            progress(0.5 * file.tell() / max(size, 1), "unpacking")
            progress.unpack(len(piece))
            yield piece


def _unpacked(file: BinaryIO, name: str, kind: str) -> Iterator[bytes]:
    """The content of all archives that are joined in a file; zeros after each are skipped."""
    unpacker, error = _library(name, kind)
    stream = unpacker()
    try:
        while packed := file.read(_CHUNKS[kind]):
            while packed := packed.lstrip(b"\0") if stream.eof else packed:  # a tape fills its blocks with zeros
                stream = unpacker() if stream.eof else stream
                yield stream.decompress(packed)
                packed = stream.unused_data
    except error as damage:
        raise BadFile(f"{name} cannot be read as a {kind} archive: {damage}") from None
    if not stream.eof:
        raise BadFile(f"{name} cannot be read as a {kind} archive: it is cut short")


def _library(name: str, kind: str) -> tuple[Callable[[], Any], type[Exception]]:
    """The function that makes the decompressor of one archive, and the error of a damaged archive."""
    if kind == "gzip":
        return partial(zlib.decompressobj, 16 + zlib.MAX_WBITS), zlib.error
    try:
        import zstandard
    except ImportError:
        raise BadFile(
            f'{name} must be unpacked first, or "pip install zstandard" (got a Zstandard archive)'
        ) from None
    return lambda: zstandard.ZstdDecompressor().decompressobj(), zstandard.ZstdError
