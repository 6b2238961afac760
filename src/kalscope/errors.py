"""The error family: each class says whose fault it is; each message says what must hold and what came."""

from __future__ import annotations


class KalscopeError(Exception):
    """Anything that Kalscope refuses. `str(error)` is one line for the person who can mend it."""


class BadSetting(KalscopeError, ValueError):
    """A number or a choice that the caller gave cannot be used: q = -1, an unknown shape of signal."""


class BadFile(KalscopeError, ValueError):
    """A file cannot be read as what it should be: missing, empty, text only, binary, of another format."""


class BadDevice(KalscopeError, OSError):
    """A port or a network address cannot be used: busy, unknown, unplugged."""


class Cancelled(KalscopeError):
    """A long task was told to stop before it had an answer."""
