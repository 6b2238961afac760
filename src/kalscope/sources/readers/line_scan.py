"""A large file looked through in blocks: how many lines, which of them are odd, and where they lie.

A line is odd where it holds a byte that no plain row of numbers needs: those are for the own parser.
"""

from __future__ import annotations

import codecs
import hashlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray

BLOCK = 1 << 20
"""Bytes looked at together."""

MOST_ODD = 50_000
"""Odd lines, beyond which the own parser had better read the whole file."""

_NEWLINE, _RETURN = 10, 13


class NotPlain(Exception):
    """The file is not plain enough for the bulk path; the own parser must read it."""


@dataclass
class LineScan:
    """What the look found; line numbers count from 1."""

    lines: int = 0
    """All lines, a last one without newline included."""
    odd: list[int] = field(default_factory=list)
    """Lines with a byte that no plain row needs, a last line without newline among them."""
    sha256: str = ""
    """SHA-256 of the bytes."""
    encoding: str = "utf-8"
    """The encoding of the text: "utf-8", or "latin-1" where it is not that."""
    torn: bool = False
    """True where the last line has no newline."""
    starts: list[tuple[int, int]] = field(default_factory=list)
    """(number of its first line, offset in bytes) of each block."""


def scan_lines(path: Path, plain: bytes, begin: int, look: Callable[[int], None]) -> LineScan:
    """Look through a file.

    Args:
        path: The file.
        plain: Bytes that plain rows are made of, line ends included.
        begin: The first line that matters; those above are not odd.
        look: Called with the number of bytes done, after each block.

    Raises:
        NotPlain: too many odd lines, or line ends of several kinds.
    """
    scan, sha256 = LineScan(), hashlib.sha256()
    decoder = codecs.getincrementaldecoder("utf-8")()
    odd_byte = np.ones(256, dtype=bool)
    odd_byte[list(plain)] = False
    ascii_so_far, offset, returns = True, 0, -1
    for block in _blocks(path):
        sha256.update(block)
        if not (ascii_so_far and block.isascii()) and scan.encoding == "utf-8":
            ascii_so_far = False
            try:
                decoder.decode(block)
            except UnicodeDecodeError:
                scan.encoding = "latin-1"
        # Three times as fast as bytes.count, where every 20th byte is one.
        newlines = int(np.count_nonzero(np.frombuffer(block, dtype=np.uint8) == _NEWLINE))
        returns = _same_line_ends(block, newlines, returns)
        scan.starts.append((scan.lines + 1, offset))
        _look_at(block, newlines, scan, plain, odd_byte, begin)
        offset += len(block)
        look(offset)
    scan.sha256 = sha256.hexdigest()
    if scan.torn and scan.odd[-1:] != [scan.lines]:
        scan.odd.append(scan.lines)
    return scan


def _blocks(path: Path) -> Iterator[bytes]:
    """The file in pieces of whole lines; the last may lack its newline."""
    with path.open("rb") as file:
        rest = b""
        while piece := file.read(BLOCK):
            end = piece.rfind(b"\n") + 1
            if not end:
                rest += piece
                if len(rest) > 4 * BLOCK:
                    raise NotPlain("a line of megabytes")
                continue
            yield rest + piece[:end] if rest else piece[:end]
            rest = piece[end:]
        if rest:
            yield rest


def _same_line_ends(block: bytes, newlines: int, before: int) -> int:
    r"""1 for \r\n, 0 for \n; NotPlain where they are mixed or a \r stands alone."""
    count = block.count(b"\r") if b"\r" in block else 0
    if count == 0:
        here = 0 if newlines else before
    elif count == newlines == block.count(b"\r\n"):
        here = 1
    else:
        raise NotPlain("mixed line ends")
    if before not in (-1, here):
        raise NotPlain("mixed line ends")
    return here


def _look_at(
    block: bytes, newlines: int, scan: LineScan, plain: bytes, odd_byte: NDArray[np.bool_], begin: int
) -> None:
    first = scan.lines + 1
    scan.torn = not block.endswith(b"\n")
    scan.lines += newlines + scan.torn
    if scan.lines < begin or not block.translate(None, plain):
        return
    data = np.frombuffer(block, dtype=np.uint8)
    ends = np.flatnonzero(data == _NEWLINE)
    odd = np.unique(np.searchsorted(ends, np.flatnonzero(odd_byte[data]))) + first
    scan.odd += odd[odd >= begin].tolist()
    if len(scan.odd) > MOST_ODD:
        raise NotPlain("too many lines that are no plain rows")


def blank_lines(path: Path, begin: int) -> list[int]:
    """Numbers of the lines from `begin` on with no byte on them."""
    found: list[int] = []
    first = 1
    for block in _blocks(path):
        data = np.frombuffer(block, dtype=np.uint8)
        ends = np.flatnonzero(data == _NEWLINE)
        sizes = np.diff(ends, prepend=-1)
        returns = (sizes == 2) & (data[ends - 1] == _RETURN)
        numbers = np.flatnonzero((sizes == 1) | returns) + first
        found += numbers[numbers >= begin].tolist()
        first += len(ends)
    return found


def fetch_lines(path: Path, scan: LineScan, numbers: list[int]) -> dict[int, bytes]:
    """The bytes of some lines, newline included, by number; `numbers` rise."""
    found: dict[int, bytes] = {}
    with path.open("rb") as file:
        ends = [*scan.starts[1:], (scan.lines + 1, path.stat().st_size)]
        wanted = iter(numbers)
        number = next(wanted, None)
        for (first, start), (after, stop) in zip(scan.starts, ends, strict=True):
            if number is None or number >= after:
                continue
            file.seek(start)
            lines = _split(file.read(stop - start))
            while number is not None and number < after:
                found[number] = lines[number - first]
                number = next(wanted, None)
    return found


def _split(block: bytes) -> list[bytes]:
    lines = block.split(b"\n")
    return [line + b"\n" for line in lines[:-1]] + ([lines[-1]] if lines[-1] else [])
