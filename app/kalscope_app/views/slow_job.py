"""Progress and Cancel, on screen only while a job takes longer than a second."""

from __future__ import annotations

import time
from typing import Any

import viser

MIN_SECONDS = 1.0
"""Seconds after which a job shows its progress and can be cancelled."""


class SlowJobProgress:
    """Use it in a `with` statement around the job; pass `report` to the job."""

    def __init__(self, bar: Any, cancel: viser.GuiButtonHandle) -> None:
        self._bar, self._cancel, self._start = bar, cancel, time.monotonic()

    def __enter__(self) -> SlowJobProgress:
        return self

    def __exit__(self, *_error: object) -> None:
        self._bar.visible = self._cancel.visible = False

    def report(self, fraction: float, _text: str) -> None:
        """Show how far it is."""
        if time.monotonic() - self._start > MIN_SECONDS:
            self._bar.value = min(max(100.0 * fraction, 0.0), 100.0)
            self._bar.visible = self._cancel.visible = True
