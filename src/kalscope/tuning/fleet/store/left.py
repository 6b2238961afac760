"""What a fit stores to compute what its device loses by a filter for all, as the bytes of a cell and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from kalscope.common.array import Array
from kalscope.estimation.fleet.losses import LOG_OWN, OWN_MOMENTUM, WIDTH
from kalscope.filtering.params import MAX_MOMENTUM

BYTES = 4 * WIDTH
"""Of a cell."""
MAX_LOG = 690.0
"""|ln λ| of a filter, at most: λ fits a double."""


def packed(left: Array) -> list[bytes | None]:
    """The cells of `left_by`; None for a device that could not be judged at all."""
    rows = np.ascontiguousarray(left, dtype="<f4")
    return [row.tobytes() if known else None for row, known in zip(rows, np.isfinite(rows[:, 0]), strict=True)]


def unpacked(cells: list[Any]) -> Array:
    """The numbers in cells that may have been written by anything, shape (cells, WIDTH); NaN for an empty one."""
    nothing = np.full(WIDTH, np.nan, dtype="<f4").tobytes()
    content = b"".join(cell if isinstance(cell, bytes) and len(cell) == BYTES else nothing for cell in cells)
    numbers = np.frombuffer(content, dtype="<f4").reshape(len(cells), WIDTH).astype(np.float64)
    own, tau = numbers[:, LOG_OWN], numbers[:, OWN_MOMENTUM]
    good = (np.abs(own) < MAX_LOG) & (tau >= 0.0) & (tau <= MAX_MOMENTUM)
    return np.where(good[:, None] & np.isfinite(numbers), numbers, np.nan)
