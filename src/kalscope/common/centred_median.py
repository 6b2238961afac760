"""The median of a short window around each value; the median of a chain, which sees only the past, is a filter.

scipy.ndimage has one as fast, but takes 0.1 s to import, which `kalscope tune` on a small file would wait for.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from kalscope.common.array import Array

_ROWS = 1 << 16
"""Windows that are sorted at once: a few MB."""


def centred_median(values: Array, window: int) -> Array:
    """The median of the `window` values around each, shape (n,); the ends are continued with their last value.

    Args:
        values: finite, shape (n,).
        window: an odd number of values.
    """
    half, medians = window // 2, np.empty(len(values))
    if not len(values):
        return medians
    windows = sliding_window_view(np.pad(values, half, mode="edge"), window)
    for first in range(0, len(values), _ROWS):
        rows = slice(first, first + _ROWS)
        medians[rows] = np.partition(windows[rows], half, axis=1)[:, half]
    return medians
