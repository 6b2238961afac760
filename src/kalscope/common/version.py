"""The version of this program."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version


def program() -> str:
    """Name and version; the name alone in a checkout that is not installed."""
    try:
        return f"kalscope {version('kalscope')}"
    except PackageNotFoundError:
        return "kalscope"
