"""What a machine lacks for a test: a skip with its reason, or a failure where `KALSCOPE_REQUIRE=all`."""

from __future__ import annotations

import os
from typing import NoReturn

import pytest

REQUIRE_ALL = os.environ.get("KALSCOPE_REQUIRE") == "all"


def not_here(reason: str) -> NoReturn:
    """Skip the test, or its whole module while it is imported; fail where every tool must be there."""
    if REQUIRE_ALL:
        pytest.fail(f"{reason}, and KALSCOPE_REQUIRE=all")
    pytest.skip(reason, allow_module_level=True)
