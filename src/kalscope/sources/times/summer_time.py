"""Steps of a clock of local time that changes to summer time or back."""

from __future__ import annotations

import numpy as np

from kalscope.common.array import Array

_HOUR = 3600.0
_WITHIN = 0.1
"""Share of the sample period by which a step may miss the hour."""
_MONTHS = (3, 4, 9, 10, 11)
"""Months in which clocks change, in the north and in the south."""
_LATEST_HOUR = 4
"""Clocks change on a Sunday, before this hour."""


def about_summer_time(stamps: Array, period: float) -> list[str]:
    """A sentence about steps that are an hour too long or too short, on a Sunday night of spring or autumn.

    Args:
        stamps: Local time in µs since 1970, shape (n,).
        period: Sample period in s.
    """
    off = np.diff(stamps) * 1e-6 - period
    places = np.flatnonzero(np.abs(np.abs(off) - _HOUR) <= _WITHIN * period)
    before = stamps[places].astype("datetime64[us]")
    days = before.astype("datetime64[D]")
    is_sunday = (days.astype(np.int64) + 4) % 7 == 0  # 1970 began on a Thursday
    is_night = (before - days) < np.timedelta64(_LATEST_HOUR, "h")
    in_season = np.isin(before.astype("datetime64[M]").astype(np.int64) % 12 + 1, _MONTHS)
    found = places[is_sunday & is_night & in_season]
    if not found.size:
        return []
    where = ", ".join(str(place + 1) for place in found[:4].tolist()) + (", …" if found.size > 4 else "")
    return [
        f"after sample {where} the clock is set by an hour, as for summer time: stamps in UTC, or with their zone,"
        " show no such step"
    ]
