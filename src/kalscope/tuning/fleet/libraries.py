"""The libraries of a fleet: optional, imported where they are needed."""

from __future__ import annotations

import importlib
from typing import Any

from kalscope.errors import BadSetting

NEEDED = ("dask", "distributed", "pyarrow")
"""What `kalscope[fleet]` installs."""


def library(module: str) -> Any:
    """A module of one of them.

    Raises:
        BadSetting: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise BadSetting(
            f'a fleet needs {", ".join(NEEDED[:-1])} and {NEEDED[-1]}: pip install "kalscope[fleet]" '
            f"(got no {module.partition('.')[0]})"
        ) from None


def check_libraries() -> None:
    """BadSetting where one of them is missing, before any work."""
    for module in NEEDED:
        library(module)
