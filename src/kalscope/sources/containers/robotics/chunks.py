"""How much the packed chunks of a log unpack to, counted up to a limit before a library unpacks them."""

from __future__ import annotations

import bz2
from collections.abc import Callable
from typing import Any

from kalscope.errors import BadFile
from kalscope.sources.containers.library import load_library

MAX_CHUNK = 1 << 28
"""Bytes of one unpacked chunk; rosbag writes chunks below 1 MB."""

_BZIP2, _LZ4 = b"BZh", b"\x04\x22\x4d\x18"


def check_chunk(data: bytes, name: str, kind: str) -> int:
    """What a chunk unpacks to, bytes; refuse one of bzip2 or LZ4 that would fill the memory.

    Args:
        data: The chunk as it is stored.
        name: The file.
        kind: What it is.

    Raises:
        BadFile: the chunk unpacks to more than MAX_CHUNK bytes.
    """
    size = len(data)
    if data.startswith(_BZIP2):
        size = unpacked_size(data, bz2.BZ2Decompressor, OSError)
    elif data.startswith(_LZ4):
        lz4 = load_library("lz4.frame", "lz4", name, kind)
        size = unpacked_size(data, lz4.LZ4FrameDecompressor, RuntimeError)
    check_size(size, name)
    return size


def check_size(size: int, name: str) -> None:
    """Refuse a chunk that unpacks to `size` bytes, where that is more than MAX_CHUNK."""
    if size > MAX_CHUNK:
        raise BadFile(f"{name} must hold chunks of at most {MAX_CHUNK} bytes (got more)")


def unpacked_size(data: bytes, unpacker: Callable[[], Any], damage: type[Exception]) -> int:
    """Bytes to which all streams in `data` unpack, counted up to one more than MAX_CHUNK.

    Args:
        data: Streams or frames, one after the other.
        unpacker: Makes the decompressor of one of them, such as `bz2.BZ2Decompressor`.
        damage: What it raises where no stream begins.
    """
    size = 0
    while data and size <= MAX_CHUNK:
        stream = unpacker()
        try:
            size += len(stream.decompress(data, MAX_CHUNK + 1 - size))
        except damage:
            if not size:
                raise
            break  # bytes after the last stream are ignored
        data = stream.unused_data or b""
    return size
