"""Gaps in time as rows of missing samples."""

from __future__ import annotations

import numpy as np

from kalscope.common.array import Array, Indices
from kalscope.errors import BadSetting

_MAX_INSERTED_PER_ROW = 20
_ALWAYS_ALLOWED = 1_000_000


def missing_rows(time: Array, pauses: Indices, period: float) -> Array:
    """Samples that are missing in each pause, a float, shape (k,).

    Args:
        time: Time in s, shape (n,).
        pauses: Samples, from 0 and in rising order, after each of which samples are missing, shape (k,).
        period: Nominal sample period in s.
    """
    if not pauses.size:
        return np.zeros(0)
    # From the latest stamp so far: going forward again after a step back is not a gap.
    latest = np.maximum.accumulate(time)
    return np.maximum(np.rint((time[pauses + 1] - latest[pauses]) / period) - 1, 0.0)


def fill_gaps(time: Array, values: Array, period: float, pauses: Indices) -> tuple[Array, Array, int]:
    """Put rows of NaN into the pauses, evenly spaced in time.

    Args:
        time: Time in s, shape (n,).
        values: Samples, shape (n, channels).
        period: Nominal sample period in s.
        pauses: Samples, from 0 and in rising order, after each of which samples are missing.

    Returns:
        (time, values, rows that were inserted).

    Raises:
        BadSetting: the gaps are so long that nearly all rows would be missing ones.
    """
    more = missing_rows(time, pauses, period)
    total = float(more.sum())
    if total > max(_MAX_INSERTED_PER_ROW * len(time), _ALWAYS_ALLOWED):
        raise BadSetting(
            f'gaps must not be "missing" where that makes {total:.3g} rows of {len(time)} (use "dt", or a longer'
            " sample period)"
        )
    count = np.zeros(len(time), dtype=np.int64)
    count[pauses + 1] = more.astype(np.int64)
    place = np.arange(len(time)) + np.cumsum(count)
    size = len(time) + int(total)
    filled = np.full((size, values.shape[1]), np.nan)
    filled[place] = values
    return np.interp(np.arange(size), place, time), filled, int(total)
