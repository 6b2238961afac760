"""The errors: each class names the cause; each message says what must hold and what was given."""

from __future__ import annotations

import errno
import os


class KalscopeError(Exception):
    """Any error of Kalscope. `str(error)` is one line for the user who can correct the cause."""


_REASONS = {
    errno.EACCES: "you have no permission for it",
    errno.EEXIST: "it exists already",
    errno.EISDIR: "it is a folder",
    errno.ELOOP: "its symbolic links form a loop",
    errno.EMFILE: "too many files are open",
    errno.ENAMETOOLONG: "its name is too long",
    errno.ENOENT: "it or its folder does not exist",
    errno.ENOSPC: "the disk is full",
    errno.ENOTDIR: "a file takes the place of its folder",
    errno.EPERM: "the system does not allow it",
    errno.EROFS: "the disk is read-only",
}
"""What the errors of the C library mean for a file."""


def reason_of(error: BaseException) -> str:
    """The reason alone, without the file: in the words of _REASONS, or else in those of the system."""
    if not isinstance(error, OSError) or not error.strerror:
        return str(error)
    is_bare = error.errno is not None and error.strerror == os.strerror(error.errno)
    return _REASONS.get(error.errno or 0, error.strerror) if is_bare else error.strerror


def describe(error: Exception) -> str:
    """One line for the user: the message of a KalscopeError, or the reason and the file of an OSError."""
    if isinstance(error, KalscopeError) or not isinstance(error, OSError):
        return str(error)
    if error.filename is None or isinstance(error.filename, int):  # the number of an open file
        return reason_of(error)
    return f"{os.fspath(error.filename)!r} cannot be used: {reason_of(error)}"


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
