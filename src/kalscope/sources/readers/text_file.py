"""A file as lines of text: where its bytes are, their encoding, and what is no text at all."""

from __future__ import annotations

import codecs
import hashlib
import io
import tempfile
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from kalscope.errors import BadFile
from kalscope.sources.readers.archives import is_packed, unpacked

if TYPE_CHECKING:
    from collections.abc import Iterator

    from kalscope.common.progress import Progress

HEAD_BYTES = 1 << 20
"""How much of a file may be looked at to find how it is written."""

PARQUET = b"PAR1"

_FOREIGN = {
    b"PK\x03\x04": "a zip archive or spreadsheet",
    b"\x89PNG": "a PNG image",
    b"%PDF": "a PDF document",
}
_CHUNK = 1 << 20


@dataclass
class RawFile:
    """The content of one file, unpacked: in memory, or on the disk where it is large."""

    name: str
    """Its name for messages."""
    path: Path
    """Where the unpacked content can be read; the file itself where it is not packed."""
    size: int
    """Bytes of the content."""
    head: bytes
    """The first HEAD_BYTES."""
    content: bytes | None
    """All of it; None while it is only on the disk."""
    sha256: str
    """SHA-256 of the file as it lies on the disk; "" until it is known."""
    at_the_end: ExitStack = field(default_factory=ExitStack)
    """What is to be closed when the Recording is made."""

    def bytes(self, progress: Progress) -> bytes:
        """The whole content in memory."""
        if self.content is None:
            progress(0.0, "reading")
            self.content = self.path.read_bytes()
            self.sha256 = self.sha256 or hashlib.sha256(self.content).hexdigest()
        return self.content


@contextmanager
def open_raw(path: str | Path, progress: Progress, large: float) -> Iterator[RawFile]:
    """Open a file. One of `large` bytes or more, unpacked, is left on the disk while the context lasts.

    Raises:
        BadFile: there is no such file, it cannot be read, it is a folder or a damaged archive.
    """
    path = Path(path)
    with tempfile.TemporaryDirectory(prefix="kalscope-", ignore_cleanup_errors=True) as folder:
        try:
            if path.is_dir():
                raise BadFile(f"source must be a file (got the folder {str(path)!r})")
            if path.exists() and not path.is_file():  # /dev/zero never ends, a pipe never begins
                raise BadFile(f"file must be an ordinary file (got {str(path)!r}, a device or a pipe)")
            with path.open("rb") as file:
                magic = file.read(4)
            target = Path(folder) / "content"
            raw = _unpack(path, target, progress, large) if is_packed(magic) else _plain(path, large)
        except FileNotFoundError:
            raise BadFile(f"file must exist (got {str(path)!r})") from None
        except (OSError, ValueError) as error:  # ValueError: a NUL in the name
            if isinstance(error, BadFile):
                raise
            reason = getattr(error, "strerror", None) or error
            raise BadFile(f"file must be readable (got {str(path)!r}: {reason})") from None
        with raw.at_the_end:
            yield raw


def _plain(path: Path, large: float) -> RawFile:
    size = path.stat().st_size
    if size >= large:
        with path.open("rb") as file:
            return RawFile(path.name, path, size, file.read(HEAD_BYTES), None, "")
    data = path.read_bytes()
    return RawFile(path.name, path, len(data), data[:HEAD_BYTES], data, hashlib.sha256(data).hexdigest())


def _unpack(path: Path, target: Path, progress: Progress, large: float) -> RawFile:
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    data, size, spilled = bytearray(), 0, None
    try:
        for piece in unpacked(path, path.name, progress):
            size += len(piece)
            if spilled is None and size >= large:
                spilled = target.open("wb")
                spilled.write(data)
            if spilled is None:
                data += piece
            else:
                spilled.write(piece)
    finally:
        if spilled is not None:
            spilled.close()
    if spilled is None:
        return RawFile(path.name, path, size, bytes(data[:HEAD_BYTES]), bytes(data), sha256)
    with target.open("rb") as file:
        return RawFile(path.name, target, size, file.read(HEAD_BYTES), None, sha256)


def find_encoding(data: bytes, name: str) -> str:
    """Encoding of the text; BadFile where it is empty or no text."""
    encoding = encoding_of_head(data, name)
    return "latin-1" if encoding == "utf-8" and not is_utf8(data) else encoding


def encoding_of_head(head: bytes, name: str) -> str:
    """As `find_encoding`, from the beginning of a file, UTF-8 where the rest is to decide."""
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
    return "utf-8-sig" if head.startswith(codecs.BOM_UTF8) else "utf-8"


def is_utf8(data: bytes) -> bool:
    """True where the bytes are UTF-8; in pieces, because the decoded text of a large file is another copy."""
    if data.isascii():
        return True
    decoder = codecs.getincrementaldecoder("utf-8")()
    try:
        for start in range(0, len(data), _CHUNK):
            decoder.decode(data[start : start + _CHUNK], final=start + _CHUNK >= len(data))
    except UnicodeDecodeError:
        return False
    return True


def open_text(data: bytes, encoding: str) -> io.TextIOWrapper[io.BytesIO]:
    """Lines of the text, one at a time, each with its newline where it has one."""
    # newline=None turns \r\n and \r into \n and breaks at nothing else, unlike str.splitlines.
    return io.TextIOWrapper(io.BytesIO(data), encoding, errors="replace", newline=None)


def last_lines(data: bytes, encoding: str, count: int) -> list[str]:
    """The lines above the last one, at most `count`."""
    if encoding != "utf-16":
        data, encoding = data[-_CHUNK:], encoding.removesuffix("-sig")
    return list(open_text(data, encoding))[-count - 1 : -1]
