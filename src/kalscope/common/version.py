"""The version of this program."""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, version


@cache  # half a millisecond, and each task of a fleet asks three times
def program() -> str:
    """Name and version; the name alone in a checkout that is not installed."""
    try:
        return f"kalscope {version('kalscope')}"
    except PackageNotFoundError:
        return "kalscope"
