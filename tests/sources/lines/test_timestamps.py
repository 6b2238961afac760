import numpy as np
import pytest

from kalscope.sources.lines.timestamps import (
    TimeColumn,
    nominal_period,
    parse_calendar,
    parse_clock,
    time_kind,
    to_seconds,
    unit_by_magnitude,
)


@pytest.mark.parametrize(
    ("cell", "seconds"),
    [
        ("1970-01-01 00:00:01", 1.0),
        ("1970-01-01T00:00:00.25Z", 0.25),
        ("1970-01-01T01:00:00+01:00", 0.0),
        ("1970-01-02", 86400.0),
        ("1969-12-31 23:59:59", -1.0),
    ],
)
def test_iso_stamps_are_microseconds_since_1970(cell, seconds):
    assert parse_calendar(cell) == seconds * 1e6


@pytest.mark.parametrize("cell", ["1970-02-31", "0000-01-01", "1970-01-01 25:00:00", "hello", "1970", "1.5", ""])
def test_what_is_no_date_is_none(cell):
    assert parse_calendar(cell) is None


def test_a_day_above_twelve_decides_the_order_and_day_first_is_assumed():
    assert time_kind(["10/14/2018 00:01"], ".", may_be_date=False) == ("calendar", "mdy")
    assert time_kind(["14/10/2018"], ".", may_be_date=False) == ("calendar", "dmy")
    assert time_kind(["03/04/2018"], ".", may_be_date=False) == ("calendar", "dmy")


def test_eight_digits_are_a_date_only_where_the_name_allows():
    assert time_kind(["19580329"], ".", may_be_date=True) == ("yyyymmdd", "ymd")
    assert time_kind(["19580329"], ".", may_be_date=False) == ("number", "ymd")


@pytest.mark.parametrize(
    ("cell", "seconds"),
    [("12:00", 43200), ("00:00:01.5", 1.5), ("18.00.00", 64800), ("24:00", None), ("1.5", None)],
)
def test_clocks_are_microseconds_since_midnight(cell, seconds):
    assert parse_clock(cell) == (None if seconds is None else seconds * 1e6)


def test_a_clock_goes_on_over_midnight():
    stamps = np.array([parse_clock("23:59:59"), parse_clock("00:00:00"), parse_clock("00:00:01")])
    assert to_seconds(stamps, TimeColumn(0, "clock"))[0].tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("stamps", "unit"),
    [
        ([0, 1, 2], "s"),
        ([0.0, 8.5, 17.1], "s"),
        ([0, 60, 120], "s"),
        ([0, 10, 20], "ms"),
        ([0, 10000, 20011], "us"),
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


def test_the_period_is_the_median_positive_step():
    assert nominal_period(np.array([0.0, 0.01, 0.02, 0.05, 0.03, 0.04])) == 0.01
    assert nominal_period(np.array([5.0])) is None
    assert nominal_period(np.array([3.0, 2.0, 1.0])) is None


def test_stamps_coarser_than_the_sampling_have_the_mean_step():
    assert nominal_period(np.repeat([0.0, 1.0, 2.0], 10)) == pytest.approx(2 / 29)
