"""A file as lines of text: where its bytes are, their encoding, and what is no text at all."""

from __future__ import annotations

import codecs
import hashlib
import io
import tempfile
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

from kalscope.common.progress import Progress
from kalscope.errors import BadFile
from kalscope.sources.readers.archives import is_packed, unpacked

HEAD_BYTES = 1 << 20
"""Bytes from which the form of a file is detected."""

_FOREIGN = {
    b"PK\x03\x04": "a zip archive or spreadsheet",
    b"\x89PNG": "a PNG image",
    b"%PDF": "a PDF document",
    b"version https://git-lfs": "a Git LFS pointer, which `git lfs pull` replaces by the file itself",
}
_CHUNK = 1 << 20


@dataclass(frozen=True)
class RawFile:
    """The content of one file, unpacked."""

    name: str
    """Its name for messages."""
    path: Path
    """Where the unpacked content can be read; the file itself where it is not packed."""
    size: int
    """Bytes of the content."""
    head: bytes
    """The first HEAD_BYTES."""
    sha256: str
    """SHA-256 of the file as it lies on the disk."""


@contextmanager
def open_raw(path: str | Path, progress: Progress) -> Generator[RawFile]:
    """Open a file; what an archive holds lies in a temporary file while the context lasts.

    Raises:
        BadFile: there is no such file, it cannot be read, it is a folder or a damaged archive.
    """
    path = Path(path)
    with tempfile.TemporaryDirectory(prefix="kalscope-", ignore_cleanup_errors=True) as folder:
        try:
            raw = _open_raw(path, Path(folder) / "content", progress)
        except FileNotFoundError:
            raise BadFile(f"file must exist (got {str(path)!r})") from None
        except (OSError, ValueError) as error:  # ValueError: a NUL in the name
            if isinstance(error, BadFile):
                raise
            reason = getattr(error, "strerror", None) or error
            raise BadFile(f"file must be readable (got {str(path)!r}: {reason})") from None
        yield raw


def _open_raw(path: Path, target: Path, progress: Progress) -> RawFile:
    if path.is_dir():
        raise BadFile(f"source must be a file (got the folder {str(path)!r})")
    if path.exists() and not path.is_file():  # /dev/zero never ends, a pipe never begins
        raise BadFile(f"file must be an ordinary file (got {str(path)!r}, a device or a pipe)")
    with path.open("rb") as file:
        magic = file.read(4)
        file.seek(0)
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    content = path
    if is_packed(magic):
        content = target
        with target.open("wb") as out:
            out.writelines(unpacked(path, path.name, progress))
    with content.open("rb") as file:
        return RawFile(path.name, content, content.stat().st_size, file.read(HEAD_BYTES), sha256)


@contextmanager
def text_as_file(lines: Iterable[str], origin: RawFile, progress: Progress) -> Generator[RawFile]:
    """Lines that a container holds as a text file, which lasts as long as the context."""
    with tempfile.TemporaryDirectory(prefix="kalscope-", ignore_cleanup_errors=True) as folder:
        target = Path(folder) / "text"
        with target.open("w", encoding="utf-8", errors="replace", newline="\n") as out:
            for number, line in enumerate(lines):
                if number % 4096 == 0:
                    progress(0.5, "reading")
                out.write(line + "\n")
        with target.open("rb") as file:
            head = file.read(HEAD_BYTES)
        yield replace(origin, path=target, size=target.stat().st_size, head=head)


def find_encoding(raw: RawFile, progress: Progress) -> str:
    """Encoding of the text; BadFile where it is empty or no text."""
    head, name = raw.head, raw.name
    if not head:
        raise BadFile(f"{name} must hold lines of numbers (got an empty file)")
    for magic, what in _FOREIGN.items():
        if head.startswith(magic):
            raise BadFile(f"{name} must be a text file (got {what})")
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    control = sum(byte < 32 and byte not in b"\t\n\r\f" for byte in head[:65536])
    if control > 0.1 * len(head[:65536]):
        raise BadFile(f"{name} must be a text file (got binary data)")
    if head.startswith(codecs.BOM_UTF8):
        return "utf-8-sig"
    return "utf-8" if _is_utf8(raw.path, progress) else "latin-1"


def _is_utf8(path: Path, progress: Progress) -> bool:
    """True where all bytes are UTF-8; in pieces, because a file may be larger than the memory."""
    decoder = codecs.getincrementaldecoder("utf-8")()
    try:
        with path.open("rb") as file:
            while piece := file.read(_CHUNK):
                progress(0.0, "reading")
                decoder.decode(piece)
        decoder.decode(b"", final=True)
    except UnicodeDecodeError:
        return False
    return True


def open_text(file: BinaryIO, encoding: str) -> io.TextIOWrapper:
    """Lines of the text, one at a time, each with its newline where it has one."""
    # newline=None turns \r\n and \r into \n and breaks at nothing else, unlike str.splitlines.
    return io.TextIOWrapper(file, encoding, errors="replace", newline=None)
