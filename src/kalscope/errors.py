"""The errors: each class names the cause; each message says what must hold and what was given."""

from __future__ import annotations

import os


class KalscopeError(Exception):
    """Any error of Kalscope. `str(error)` is one line for the user who can correct the cause."""


def describe(error: Exception) -> str:
    """One line for the user: the message of a KalscopeError, or the reason and the file of an OSError."""
    if isinstance(error, OSError) and not isinstance(error, KalscopeError):
        reason = error.strerror or str(error)
        if error.filename is None or isinstance(error.filename, int):  # the number of an open file
            return reason
        return f"{os.fspath(error.filename)!r}: {reason}"
    return str(error)


class BadSetting(KalscopeError, ValueError):
    """A number or a choice that the caller gave cannot be used: q = -1, an unknown shape of signal."""


class BadFile(KalscopeError, ValueError):
    """A file cannot be read as what it should be: missing, empty, text only, binary, of another format."""


class NoMemory(KalscopeError, MemoryError):
    """A recording does not fit into the memory that is free."""


class BadDevice(KalscopeError, OSError):
    """A port or a network address cannot be used: busy, unknown, unplugged."""


class Cancelled(KalscopeError):
    """A long task was cancelled before it was finished."""
