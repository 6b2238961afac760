"""The one patience of all tests: they wait for states, and how long a state takes is never judged."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")

PATIENCE = 120.0
"""Seconds after which something that must happen counts as failed. Far above what a loaded machine needs."""


LONGEST_PAUSE = 0.05
"""Seconds between two looks at a state that takes long: a look into a browser is 10 ms of work."""


def wait_until(condition: Callable[[], T], what: str = "the condition", pause: float = 0.005) -> T:
    """Wait until `condition` returns something true, and return that; `pause` in seconds after the first look."""
    end = time.monotonic() + PATIENCE
    while not (holds := condition()):
        assert time.monotonic() < end, f"{what} must come true within {PATIENCE:g} s"
        time.sleep(pause)
        pause = max(pause, min(1.5 * pause, LONGEST_PAUSE))
    return holds
