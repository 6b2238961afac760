"""The bytes of a file as lines of text: archives, encodings, and what is no text at all."""

from __future__ import annotations

import gzip
import io
import zlib
from pathlib import Path

from kalscope.errors import BadFile

MAX_UNPACKED = 1 << 31
"""Largest size of an unpacked .gz file in bytes: a small archive can hold terabytes of zeros."""

_FOREIGN = {
    b"\x28\xb5\x2f\xfd": "a Zstandard archive",
    b"PK\x03\x04": "a zip archive or spreadsheet",
    b"\x89PNG": "a PNG image",
    b"PAR1": "a Parquet file",
    b"%PDF": "a PDF document",
}


def read_bytes(path: str | Path) -> bytes:
    """The file's bytes; BadFile where there are none to be had."""
    try:
        if Path(path).is_dir():
            raise BadFile(f"source must be a file (got the folder {str(path)!r})")
        return Path(path).read_bytes()
    except FileNotFoundError:
        raise BadFile(f"file must exist (got {str(path)!r})") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or error
        raise BadFile(f"file must be readable (got {str(path)!r}: {reason})") from None


def unpack(packed: bytes, name: str) -> bytes:
    """The bytes themselves, or what a gzip archive holds."""
    if not packed.startswith(b"\x1f\x8b"):
        return packed
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(packed)) as stream:
            data = stream.read(MAX_UNPACKED + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise BadFile(f"{name} must be a whole gzip archive (got: {error})") from None
    if len(data) > MAX_UNPACKED:
        raise BadFile(f"{name} must unpack to at most {MAX_UNPACKED} bytes (got more)")
    return data


def find_encoding(data: bytes, name: str) -> str:
    """Encoding of the text; BadFile where it is empty or no text."""
    if not data:
        raise BadFile(f"{name} must hold lines of numbers (got an empty file)")
    for magic, what in _FOREIGN.items():
        if data.startswith(magic):
            raise BadFile(f"{name} must be a text file (got {what})")
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    head = data[:65536]
    control = sum(byte < 32 and byte not in b"\t\n\r\f" for byte in head)
    if control > 0.1 * len(head):
        raise BadFile(f"{name} must be a text file (got binary data)")
    if data.startswith(b"\xef\xbb\xbf"):
        return "utf-8-sig"
    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def open_text(data: bytes, encoding: str) -> io.TextIOWrapper:
    """Lines of the text, one at a time, each with its newline where it has one."""
    # newline=None turns \r\n and \r into \n and breaks at nothing else, unlike str.splitlines.
    return io.TextIOWrapper(io.BytesIO(data), encoding, errors="replace", newline=None)
