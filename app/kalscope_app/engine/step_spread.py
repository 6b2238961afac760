"""How unevenly the samples of a recording follow each other, and what that does to a delay. Pure."""

from __future__ import annotations

import math

import numpy as np

from kalscope.common.array import Array

LOOKS = 2000
"""Spans of a recording that are measured, at most: enough for percentiles, and quick whatever its length."""

TAIL = 5.0
"""Per cent left out at each end: nine of ten lie between, and no pause distorts the result."""


def spread_of_span(time: Array, samples: float) -> tuple[float, float] | None:
    """How long `samples` steps last: nine of ten spans lie between the two durations.

    Args:
        time: times of the samples, s, shape (n,).
        samples: how many steps, > 0, whole or not.

    Returns:
        The shortest and the longest usual span in s; None where the recording is too short to tell.
    """
    last = len(time) - 1 - math.ceil(samples) if math.isfinite(samples) else 0
    if last < 9 or samples <= 0.0:
        return None
    start = np.unique(np.linspace(0, last, LOOKS).astype(np.intp))
    whole, part = int(samples), samples - int(samples)
    first, end = time[start], time[start + whole]
    if part:
        end = end + part * (time[start + whole + 1] - end)
    low, high = np.percentile(end - first, (TAIL, 100.0 - TAIL))
    return float(low), float(high)
