"""The unit of work: the least that a rerun repeats, a file or some row groups of a Parquet data set."""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from kalscope.errors import describe


@dataclass(frozen=True, slots=True)
class Piece:
    """A file, or some of its row groups, as it was when the fleet was scanned."""

    path: str
    """Absolute path."""
    size: int = 0
    """Bytes of the file, or of its row groups."""
    stamp: int = 0
    """When the file was last written, ns since 1970."""
    groups: tuple[int, ...] = ()
    """Row groups, from 0; () = the whole file."""


@dataclass(frozen=True, slots=True)
class Unit:
    """What is read, fitted and kept together."""

    id: str
    """Name in the table: the path below the folder that was given. Series of a Parquet data set have their own."""
    pieces: tuple[Piece, ...]
    """What holds it; one file, or the row groups over which its series run."""
    channel: str | None = None
    """The channel that a list names; None = that of the options."""
    reason: str = ""
    """Why it cannot be read, where that is known without opening it."""
    span: tuple[Any, Any] | None = None
    """Of a data set in the long form: its ids are above the first and up to the second; None = a recording."""
    data_set: str = ""
    """Folder of the data set in the table, with which the ids of its series begin."""

    @property
    def size(self) -> int:
        """Bytes on disk."""
        return sum(piece.size for piece in self.pieces)

    @property
    def source(self) -> str:
        """What `reopen` finds its recordings by: the path, or in JSON the data set and its row groups."""
        if not self.pieces[0].groups:
            return self.pieces[0].path
        data_set = None if self.span is None else self.data_set
        return json.dumps([data_set, [[piece.path, _runs(piece.groups)] for piece in self.pieces]])

    def key(self, options: str) -> str:
        """Hash of all that the result depends on: 32 hexadecimal digits.

        Args:
            options: The fingerprint of the options and of the program.
        """
        pieces = [(piece.path, piece.size, piece.stamp, piece.groups) for piece in self.pieces]
        own = [self.id, self.channel, self.reason, self.span, self.data_set, pieces]
        text = json.dumps([options, *own], default=str)
        return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:32]


def _runs(numbers: Sequence[int]) -> list[list[int]]:
    """Ascending numbers as runs, each with its first and its last."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return runs


def unit_of(path: str, name: str, channel: str | None = None) -> Unit:
    """The unit of one file, whatever it is: what cannot be read becomes a row with the reason.

    Args:
        path: Of the file.
        name: Its name in the table.
        channel: The channel that a list names.
    """
    path = os.path.abspath(path)
    try:
        found = os.stat(path)
    except OSError as error:
        return Unit(name, (Piece(path),), channel, describe(error))
    except ValueError as error:  # a NUL in the name
        return Unit(name, (Piece(path),), channel, str(error))
    regular = stat.S_ISREG(found.st_mode)
    reason = "" if regular else "it must be a file (got a folder, a device or a pipe)"
    return Unit(name, (Piece(path, found.st_size if regular else 0, found.st_mtime_ns),), channel, reason)
