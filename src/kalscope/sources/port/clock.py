"""The clocks of a live source. Only the monotonic one measures; setting the wall clock changes nothing."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass


def _asleep() -> float:
    """Seconds that the machine has slept since it started, as far as the system reports it.

    Linux and macOS stop `time.monotonic` while the machine sleeps and have a second clock that continues; Windows
    does not stop it. Comparing with the wall clock would take every correction of that clock for a sleep.
    """
    boot = getattr(time, "CLOCK_BOOTTIME", None)  # Linux
    if boot is None and hasattr(time, "CLOCK_UPTIME_RAW"):  # macOS, whose CLOCK_MONOTONIC continues
        boot = time.CLOCK_MONOTONIC
    return 0.0 if boot is None else time.clock_gettime(boot) - time.monotonic()


@dataclass(frozen=True)
class Clock:
    """The clocks of a live source."""

    monotonic: Callable[[], float] = time.monotonic
    """Seconds that never step."""
    wall: Callable[[], float] = time.time
    """Seconds since 1970; read once for each recording, for its first line."""
    asleep: Callable[[], float] = _asleep
    """Seconds that the machine has slept; a rise of more than 1 s is a gap."""


SYSTEM = Clock()
"""The clocks of this machine."""
