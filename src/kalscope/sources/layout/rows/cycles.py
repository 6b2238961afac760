"""Labels that come in turn, one or a few per line: `Temp: 21.5`, then `Hum: 40`, then the next `Temp`."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from kalscope.common.array import Array
from kalscope.sources.layout.rows.kinds import Cells

MIN_CYCLES = 4
"""How often all labels must come in turn."""
_MIN_COMPLETE = 0.9
"""Share of the turns that must hold every label."""
_MAX_INSIDE = 0.25
"""Largest share of the time between two turns that may pass between the first and the last line of one."""


def leading_label(rows: Sequence[Cells], labels: Sequence[int], stamps: Array | None) -> int | None:
    """The label that begins each turn, an index into the cells; None where each line is a row of its own.

    Args:
        rows: Cells of the lines, "" where a line lacks the label.
        labels: Which of the cells hold values.
        stamps: Of the lines, shape (n,), NaN where unreadable; None where they have none.
    """
    held = [{i for i in labels if row[i]} for row in rows]
    first = next((i for i in labels if held and i in held[0]), None)
    begins = [k for k, here in enumerate(held) if first in here]
    if first is None or len(begins) < MIN_CYCLES or len(begins) > 0.75 * len(held):
        return None
    turns = [held[a:b] for a, b in pairwise(begins)]
    complete = sum(sorted(i for here in turn for i in here) == sorted(labels) for turn in turns)
    if complete < _MIN_COMPLETE * len(turns):
        return None
    return first if stamps is None or _are_together(begins, stamps) else None


def _are_together(begins: list[int], stamps: Array) -> bool:
    """True where little time passes between the first line of a turn, at `begins`, and the last."""
    inside = np.array([stamps[b - 1] - stamps[a] for a, b in pairwise(begins)])
    between = np.diff(stamps[begins])
    known = np.isfinite(inside) & np.isfinite(between)
    return bool(known.any()) and float(np.median(inside[known])) <= _MAX_INSIDE * float(np.median(between[known]))
