import pytest

from kalscope.sources.grammar.timestamps import parse_calendar, parse_clock, time_kind


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
