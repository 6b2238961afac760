"""A file that grows, line by line, from any position in it.

This module runs on other machines, too, where `far_side.py` follows a file: it imports nothing of Kalscope and
keeps to Python 3.7.
"""

from __future__ import annotations

import os
import stat

PIECE = 8_192
"""Bytes of one read, unless its first line is longer."""
MAX_PIECE = 65_536
"""Bytes of a line beyond which it comes in pieces."""
MAX_BEFORE = 64
"""Bytes before a position in a file by which the position is recognised."""


class Unusable(Exception):
    """The file cannot be followed; its one argument says why: "missing", "denied", "irregular" or another text."""


class Replaced(Exception):
    """The file was cut short, or another one has its name: it is to be read again, from its beginning."""


class GrowingFile:
    """Reads whole lines. What follows the last line end is left for later: it may be half a line.

    Where another file takes the name, or this one is cut short, that rest is passed on to be rejected: whatever
    writes the file may not have finished it.
    """

    def __init__(self, path: str, position: int = 0, before: bytes = b"") -> None:
        """Open a file.

        Args:
            path: The file.
            position: Where to begin.
            before: The bytes before that position, MAX_BEFORE at most: where others are there now, it
                begins at 0.

        Raises:
            Unusable: there is no such file, it may not be read, or it is not a regular file.
        """
        self._path = path
        self._open_file = -1
        try:
            if not stat.S_ISREG(os.stat(path).st_mode):  # before it is opened: a FIFO would wait for a writer
                raise Unusable("irregular")
            self._open_file = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
            self.position = position if self._matches(before, position) else 0
        except FileNotFoundError:
            raise Unusable("missing") from None
        except PermissionError:
            raise Unusable("denied") from None
        except (OSError, ValueError) as error:
            self.close()
            raise Unusable(str(error)) from None
        self.before = before if self.position else b""
        self._rest = b""
        self._is_over = False

    def _matches(self, before: bytes, position: int) -> bool:
        """Whether these bytes end at `position`."""
        start = position - len(before)
        if not before or start < 0:
            return False
        os.lseek(self._open_file, start, os.SEEK_SET)
        return os.read(self._open_file, len(before)) == before

    def read(self) -> bytes:
        """The next whole lines, PIECE bytes at most, or one longer line; b"" where there are none yet.

        Raises:
            Replaced: what follows is in another file.
            OSError: it cannot be read from the disk.
        """
        if self._is_over:
            raise Replaced
        data = self._at_position(PIECE)
        end = max(data.rfind(b"\n"), data.rfind(b"\r")) + 1
        if not end and len(data) == PIECE:
            data = self._at_position(MAX_PIECE)
            ends = [data.find(mark) + 1 for mark in (b"\n", b"\r") if mark in data]
            end = min(ends, default=len(data) if len(data) == MAX_PIECE else 0)
        lines = data[:end]
        if not lines and self._is_replaced():
            return self._last_line(data)
        self._rest = data[end:]
        self.position += len(lines)
        self.before = (self.before + lines)[-MAX_BEFORE:]
        return lines

    def _at_position(self, size: int) -> bytes:
        os.lseek(self._open_file, self.position, os.SEEK_SET)
        return os.read(self._open_file, size)

    def _is_replaced(self) -> bool:
        here = os.fstat(self._open_file)
        if here.st_size < self.position:
            return True
        try:
            there = os.stat(self._path)
        except OSError:  # renamed: it may still be written until the next one exists
            return False
        return (there.st_dev, there.st_ino) != (here.st_dev, here.st_ino)

    def _last_line(self, data: bytes) -> bytes:
        """What followed the last line end of a file that is gone, once; `data` is what can still be read of it.

        Raises:
            Replaced: nothing followed, or the other file contains it, too.
        """
        self._is_over, torn = True, data or self._rest
        if not torn or self._continues(data):
            raise Replaced
        self.before = b""  # not a position in the other file
        return b"\0" + torn + b"\n"

    def _continues(self, data: bytes) -> bool:
        """Whether the file that has the name now continues after this: a copy of one that is written elsewhere."""
        end = self.position + len(data)
        try:
            other = GrowingFile(self._path, end, self.before + data)
        except Unusable:
            return False
        other.close()
        return other.position == end > 0

    def close(self) -> None:
        """Close the file; may be called twice."""
        if self._open_file >= 0:
            os.close(self._open_file)
            self._open_file = -1
