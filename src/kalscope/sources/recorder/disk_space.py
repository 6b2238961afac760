"""How long a disk will last at the rate at which a recording grows."""

from __future__ import annotations

import shutil
from collections import deque
from pathlib import Path

MIN_SECONDS_LEFT = 300.0
"""A disk that will be full sooner gets a warning, s."""
_RATE_S = 30.0
"""Seconds over which the rate is measured."""
_CHECK_S = 1.0


class DiskSpaceMonitor:
    """Checks the disk of a folder once a second."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._sizes: deque[tuple[float, int]] = deque()
        self._warning = ""

    def check(self, now: float, size: int) -> str:
        """The warning at the monotonic time `now`, s, with `size` bytes written; "" if there is enough space."""
        if self._sizes and now - self._sizes[-1][0] < _CHECK_S:
            return self._warning
        self._sizes.append((now, size))
        while now - self._sizes[0][0] > _RATE_S:
            self._sizes.popleft()
        self._warning = self._judge(now, size)
        return self._warning

    def _judge(self, now: float, size: int) -> str:
        first, before = self._sizes[0]
        if size <= before or now <= first:
            return ""
        try:
            free = shutil.disk_usage(self._folder).free
        except OSError:  # a folder that was moved away: the next write will report what is wrong
            return ""
        left = free * (now - first) / (size - before)
        if left >= MIN_SECONDS_LEFT:
            return ""
        return f"the disk has space left for {left / 60.0:.1f} min at the current rate"
