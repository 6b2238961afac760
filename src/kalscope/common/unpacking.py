"""How much a packed file may unpack to: a small one can hold terabytes of zeros."""

from __future__ import annotations

import os
from pathlib import Path

from kalscope.errors import BadFile

MAX_UNPACKED = 1 << 27
"""Bytes that any file may unpack to, by default; as text they take some seconds and at most 2 GB of memory."""
MAX_RATIO = 32
"""Bytes that a larger file may unpack to for each of its own: logs are packed by a factor of 3 to 20."""


class Unpacking:
    """Adds up what a file unpacks to, over archives in archives: every reader counts before it keeps anything."""

    def __init__(self, path: Path, gigabytes: float | None) -> None:
        """Args: the file as it is on the disk; what it may unpack to, None = MAX_UNPACKED or MAX_RATIO."""
        self._path, self._gigabytes, self._total = path, gigabytes, 0

    def add(self, size: int) -> None:
        """Take `size` more bytes.

        Raises:
            BadFile: together they are too many.
        """
        self._total += size
        if self._total <= MAX_UNPACKED and self._gigabytes is None:
            return
        most = max(MAX_UNPACKED, MAX_RATIO * os.path.getsize(self._path))
        if self._gigabytes is not None:
            most = int(1e9 * self._gigabytes)
        if self._total > most:
            raise BadFile(
                f"{self._path.name} must unpack to at most {most / 1e9:.3g} GB (got more): --unpack-gb allows more"
            )
