"""Gaps in time as rows of missing samples."""

from __future__ import annotations

import numpy as np

from kalscope.common.array import Array
from kalscope.errors import BadSetting
from kalscope.sources.times.time_axis import GAP_PERIODS

_MAX_INSERTED_PER_ROW = 20
_ALWAYS_ALLOWED = 1_000_000


def fill_gaps(time: Array, values: Array, period: float) -> tuple[Array, Array, int]:
    """Put rows of NaN where a step is longer than 1.5 periods, evenly spaced in time.

    Args:
        time: Time in s, shape (n,).
        values: Samples, shape (n, channels).
        period: Nominal sample period in s.

    Returns:
        (time, values, rows that were inserted).

    Raises:
        BadSetting: the gaps are so long that nearly all rows would be missing ones.
    """
    # From the latest stamp so far: going forward again after a step back is no gap.
    steps = (time[1:] - np.maximum.accumulate(time)[:-1]) / period
    more = np.where(steps > GAP_PERIODS, np.rint(steps) - 1, 0.0)
    total = float(more.sum())
    if total > max(_MAX_INSERTED_PER_ROW * len(time), _ALWAYS_ALLOWED):
        raise BadSetting(
            f'gaps must not be "missing" where that makes {total:.3g} rows of {len(time)} (take "dt", or a longer'
            " sample period)"
        )
    count = np.concatenate((more.astype(np.int64), [0]))
    place = np.arange(len(time)) + np.concatenate(([0], np.cumsum(count[:-1])))
    size = len(time) + int(total)
    filled = np.full((size, values.shape[1]), np.nan)
    filled[place] = values
    return np.interp(np.arange(size), place, time), filled, int(total)
