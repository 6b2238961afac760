"""One run in a folder at a time: a lock that the system releases when its process dies."""

from __future__ import annotations

import os
import socket
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from kalscope.common.files import make_folder
from kalscope.errors import BadSetting

NAME = ".lock"
"""Name of the file in the folder of a fleet; it stays there, and only the lock on it counts."""


@contextmanager
def locked(folder: Path) -> Generator[None]:
    """Hold the folder while the block runs.

    Args:
        folder: Of the results; it is made where it does not exist.

    Raises:
        BadSetting: Another process holds it, it is a file, or its lock is a file that no fleet wrote.
        OSError: It cannot be written.
    """
    make_folder(folder)
    with open(folder / NAME, "a+", encoding="utf-8", errors="replace") as file:
        is_free = _take(file)
        file.seek(0)
        holder = file.read(200).strip()
        if not is_free:
            other = holder or "another process"
            raise BadSetting(
                f"-o must name a folder that no other run writes (got {str(folder)!r}, held by {other})"
            )
        if holder and not holder.startswith("process "):  # it would be overwritten
            raise BadSetting(f"-o must name a folder whose {NAME} is that of a fleet (got {str(folder)!r})")
        with suppress(OSError):  # a full disk is reported for the results, by their name
            os.truncate(file.fileno(), 0)
            os.write(file.fileno(), f"process {os.getpid()} on {socket.gethostname()}".encode())
        yield


def _take(file: IO[str]) -> bool:
    """Lock the open file; False where another process has. Closing it, or the end of the process, releases it."""
    try:
        if os.name == "nt":
            import msvcrt

            lock = getattr(msvcrt, "locking")  # noqa: B009 (unknown to a type checker elsewhere)
            file.seek(1 << 30)  # beyond the text, which stays readable
            lock(file.fileno(), getattr(msvcrt, "LK_NBLCK"), 1)  # noqa: B009
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
