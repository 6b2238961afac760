"""The libraries that read containers: optional, imported where a file needs one."""

from __future__ import annotations

import importlib
from typing import Any

from kalscope.errors import BadFile


def load_library(module: str, package: str, name: str, kind: str) -> Any:
    """The module of a library.

    Args:
        module: Its name for import.
        package: Its name for pip.
        name: The file to be read.
        kind: What the file is: "an HDF5 file".

    Raises:
        BadFile: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise BadFile(
            f'{name} needs {package} to be read: pip install "kalscope[formats]" or pip install {package}'
            f" (got {kind})"
        ) from None
