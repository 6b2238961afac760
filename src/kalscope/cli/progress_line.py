"""How far a long command is: one line on a terminal that disappears when the work is done."""

from __future__ import annotations

import time
from typing import TextIO

from kalscope.common.progress import Progress

PATIENCE_S = 1.0
"""Work that takes longer shows how far it is."""

PAUSE_S = 0.1
"""Least time between two looks of the line."""


class ProgressLine:
    """One line on a terminal, gone at the end of the block; nothing anywhere else."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._wanted = stream.isatty()
        self._due = time.monotonic() + PATIENCE_S
        self._width = 0

    def __enter__(self) -> ProgressLine:
        return self

    def __exit__(self, *_: object) -> None:
        if self._width:
            self._stream.write(f"\r{' ' * self._width}\r")
            self._stream.flush()

    def part(self, name: str, index: int, count: int) -> Progress:
        """The progress of one channel among `count`."""
        whole = Progress(lambda fraction, text: self._show(fraction, f"{name}: {text}"))
        return whole.part(index / count, (index + 1) / count)

    def _show(self, fraction: float, text: str) -> None:
        now = time.monotonic()
        if not self._wanted or now < self._due:
            return
        self._due = now + PAUSE_S
        line = f"{fraction:4.0%} {text}"[:70]
        self._stream.write(f"\r{line:<{self._width}}")
        self._stream.flush()
        self._width = max(self._width, len(line))
