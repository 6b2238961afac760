import numpy as np
import pytest
from each import each

from kalscope.sources.grammar.timestamps import CLOCK_PARSERS, TimeColumn, parse_clock
from kalscope.sources.reading.axis import to_seconds, unit_by_magnitude


def test_a_clock_goes_on_over_midnight():
    stamps = np.array([parse_clock("23:59:59"), parse_clock("00:00:00"), parse_clock("00:00:01")])
    assert to_seconds(stamps, TimeColumn(0, "clock"))[0].tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("clock", "cells", "seconds"),
    [
        ("min:s", ["59:59.5", "00:00.5"], [0, 1]),
        ("elapsed", ["99:59:59", "100:00:00", "0:00:00"], [0, 1, -359999]),
    ],
)
def test_minutes_begin_again_at_the_hour_and_elapsed_time_never_does(clock, cells, seconds):
    stamps = np.array([CLOCK_PARSERS[clock](cell) for cell in cells])
    assert to_seconds(stamps, TimeColumn(0, "clock", clock=clock))[0].tolist() == seconds


@each(
    ("stamps", "unit"),
    [
        ([0, 1, 2], "s"),
        ([0.0, 8.5, 17.1], "s"),
        ([0, 60, 120], "s"),
        ([0, 3600, 7200], "s"),
        (45123.5 + np.arange(50) / 144, "day"),
        (np.round(45123.5 + np.arange(50) / 1440, 9), "day"),
        (739000.5 + np.arange(50) / 86400, "day"),
        (2460000.5 + np.arange(50) / 24, "day"),
        (45123.5 + np.arange(50) / 100, "s"),
        (45123.5 + np.arange(50) / 3, "s"),
        (45123.5 + np.cumsum(np.random.default_rng(1).uniform(0, 0.1, 50)), "s"),
        (39000.5 + np.arange(50) / 144, "s"),
        ([0, 300, 600], "s"),
        ([0, 5, 10], "s"),
        ([7, 17, 27], "ms"),
        ([0, 1000, 2000], "ms"),
        ([3, 1004, 2006], "ms"),
        ([0, 60000, 120000], "ms"),
        ([0, 10000, 20011], "ms"),
        ([5012, 7015, 9018, 11022], "ms"),
        ([71, 250_071, 500_079], "us"),
        ([7e8, 7e8 + 2500, 7e8 + 5004], "us"),
        ([584065454762638, 584065474483599], "ns"),
        ([1.7e9, 1.7e9 + 1], "s"),
        ([1.7e12, 1.7e12 + 10], "ms"),
        ([1.7e15, 1.7e15 + 10000], "us"),
        ([1.7e18, 1.7e18 + 1e7], "ns"),
        ([1.2e9, 1.2e9 + 4000], "us"),
    ],
)
def test_the_unit_follows_from_the_size_of_stamp_and_step(stamps, unit):
    assert unit_by_magnitude(np.array(stamps, dtype=float)) == unit


@pytest.mark.parametrize(
    ("first", "date"),
    [(45123.5, "2023-07-16T12:00:00"), (739000.5, "2023-04-24T12:00:00"), (2460000.5, "2023-02-25T00:00:00")],
)
def test_numbers_of_days_count_from_their_date(first, date):
    seconds, said = to_seconds(first + np.arange(50) / 144, TimeColumn(0, "number"))
    assert seconds.tolist() == [600.0 * i for i in range(50)]
    assert f"time counts from {date}+00:00" in said
