"""The columns that a container holds."""

from __future__ import annotations

from dataclasses import dataclass

from kalscope.common.array import Array


@dataclass(frozen=True)
class Table:
    """Columns of one length, before the time axis is judged."""

    names: tuple[str, ...]
    """Full name of each channel: the topic or group, and the field."""
    units: tuple[str, ...]
    """Unit of each channel; "" where none is given."""
    columns: tuple[Array, ...]
    """Samples of each channel, shape (n,), NaN where missing."""
    time: Array | None = None
    """Stamps in s, shape (n,); None where samples are counted."""
    start: float | None = None
    """Time of the first sample in s since 1970, where the stamps count from it."""
    period: float | None = None
    """Sample period in s that the file gives; None where it gives none."""
    notes: tuple[str, ...] = ()
    """What was decided, each a sentence: the format, the part that was chosen, the others."""
