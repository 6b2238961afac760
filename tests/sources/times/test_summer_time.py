"""A clock of local time changes by an hour; no other step is taken for such a change."""

from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np
from each import each

from kalscope.sources.reading.axis import about_summer_time


def local_stamps(zone, start, step, count=300):
    """µs of the clock on the wall, as a logger without a zone writes it."""
    times = [(start + timedelta(seconds=step * i)).astimezone(ZoneInfo(zone)) for i in range(count)]
    return np.array([time.replace(tzinfo=UTC).timestamp() * 1e6 for time in times])


@each("step", [1.0, 60.0, 600.0, 3600.0])
@each(
    ("zone", "change"),
    [
        ("Europe/Berlin", datetime(2024, 3, 31, 1, tzinfo=UTC)),
        ("Europe/Berlin", datetime(2024, 10, 27, 1, tzinfo=UTC)),
        ("America/New_York", datetime(2024, 3, 10, 7, tzinfo=UTC)),
        ("America/New_York", datetime(2024, 11, 3, 6, tzinfo=UTC)),
        ("Australia/Sydney", datetime(2024, 4, 6, 16, tzinfo=UTC)),
        ("Australia/Sydney", datetime(2024, 10, 5, 16, tzinfo=UTC)),
    ],
)
def test_the_change_is_named_where_it_is(zone, change, step):
    stamps = local_stamps(zone, change - timedelta(seconds=50 * step), step)
    (said,) = about_summer_time(stamps, step)
    assert "after sample 50 the clock is set by an hour" in said
    shifted = stamps + 2 * 86400e6  # the same steps on a Tuesday
    assert about_summer_time(shifted, step) == []


def test_a_clock_that_does_not_change_has_no_such_step():
    stamps = local_stamps("UTC", datetime(2024, 3, 30, tzinfo=UTC), 600.0)
    assert about_summer_time(stamps, 600.0) == []
    lost = np.delete(stamps, np.s_[100:104])  # 40 min are missing
    assert about_summer_time(lost, 600.0) == []
