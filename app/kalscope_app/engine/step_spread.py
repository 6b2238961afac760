"""How unevenly the samples of a recording follow each other, and what that does to a delay. Pure."""

from __future__ import annotations

import math

import numpy as np

from kalscope.common.array import Array

LOOKS = 2000
"""Places of a recording that are looked at, at most: enough for percentiles, and quick whatever its length."""

TAIL = 5.0
"""Per cent left out at each end: nine of ten lie between, and no pause decides."""


def spread_of_span(time: Array, samples: float) -> tuple[float, float]:
    """How much shorter and longer than on average `samples` steps last, as factors; nine of ten lie between.

    Args:
        time: moments of the samples, s, shape (n,).
        samples: how many steps, > 0, whole or not.

    Returns:
        Two factors, such as (0.8, 1.3); (1, 1) where the recording is too short to tell, or its clock stands still.
    """
    last = len(time) - 1 - math.ceil(samples) if math.isfinite(samples) else 0
    if last < 9 or samples <= 0.0:
        return 1.0, 1.0
    start = np.unique(np.linspace(0, last, LOOKS).astype(np.intp))
    whole, part = int(samples), samples - int(samples)
    first, end = time[start], time[start + whole]
    if part:
        end = end + part * (time[start + whole + 1] - end)
    spans = end - first
    low, high = np.percentile(spans, (TAIL, 100.0 - TAIL))
    usual = spans[(spans >= low) & (spans <= high)]
    mean = float(usual.mean())
    return (float(low) / mean, float(high) / mean) if mean > 0.0 else (1.0, 1.0)
