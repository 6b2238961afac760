"""Columns of metadata beside the data, in the first rows only."""

from __future__ import annotations

from collections.abc import Sequence

from kalscope.sources.layout.rows.kinds import CellKinds, Cells

MIN_BESIDE_ROWS = 16
"""Fewest rows to judge that."""
MAX_BESIDE = 64
"""Most rows with metadata beside the data."""


def find_beside(rows: Sequence[tuple[int, Cells]], width: int, kinds: CellKinds) -> frozenset[int]:
    """Columns of labels and values that are in some of the first rows only, and empty ones up to the data."""
    last = [max((place for place, (_, cells) in enumerate(rows) if cells[i]), default=-1) for i in range(width)]
    brief = [0 <= place < min(MAX_BESIDE, len(rows) / 2) for place in last]
    if len(rows) < MIN_BESIDE_ROWS:
        return frozenset()
    beside: set[int] = set()
    for i in range(width - 1):
        if brief[i] and brief[i + 1] and any(kinds[cells[i]] == "text" for _, cells in rows):
            beside |= {i, i + 1}
    if not beside:
        return frozenset()
    end = max(beside) + 1
    while end < width and last[end] < 0:
        end += 1
    return frozenset(beside | {i for i in range(end) if last[i] < 0}) if end < width else frozenset(beside)
