"""Calendar stamps: what is written comes back, and no order reads the stamps of another."""

from datetime import datetime, timedelta

import pytest
from each import each
from effort import EXAMPLES
from hypothesis import given, settings
from hypothesis import strategies as st

from kalscope.sources.grammar.stamps import parse_calendar

INSTANTS = st.datetimes(datetime(1970, 1, 1), datetime(2068, 12, 31, 23, 59, 59, 999999))
MONTH = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"]
WEEKDAY = ["Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun"]


def microseconds(instant):
    return (instant - datetime(1970, 1, 1)) // timedelta(microseconds=1)


def java(t):
    return f"{WEEKDAY[t.weekday()]} {MONTH[t.month - 1]} {t.day:02} {t:%H:%M:%S} GMT+08:00 {t.year}"


FORMS = {
    "iso": ("ymd", 1, lambda t: t.isoformat(" ")),
    "iso with T and Z": ("ymd", 1, lambda t: t.isoformat() + "Z"),
    "iso with a decimal comma": ("ymd", 1, lambda t: t.isoformat(" ", "microseconds").replace(".", ",")),
    "iso and UTC": ("ymd", 1, lambda t: t.isoformat(" ") + " UTC"),
    "iso with a zone": ("ymd", 1, lambda t: (t + timedelta(hours=5.5)).isoformat() + "+05:30"),
    "iso with nanoseconds": ("ymd", 1, lambda t: t.isoformat(" ", "microseconds") + "999"),
    "slashes, year first": ("ymd", 1, lambda t: f"{t:%Y/%m/%d %H:%M:%S.%f}"),
    "slashes, no zeros": ("ymd", 10**6, lambda t: f"{t.year}/{t.month}/{t.day} {t.hour}:{t:%M:%S}"),
    "minutes": ("ymd", 60 * 10**6, lambda t: f"{t:%Y-%m-%d %H:%M}"),
    "dots": ("dmy", 1, lambda t: f"{t:%d.%m.%Y %H:%M:%S.%f}"),
    "dots, two digits": ("dmy", 10**6, lambda t: f"{t:%d.%m.%y %H:%M:%S}"),
    "dots in the clock too": ("dmy", 10**6, lambda t: f"{t:%d.%m.%Y %H.%M.%S}"),
    "British": ("dmy", 10**6, lambda t: f"{t:%d/%m/%Y %H:%M:%S}"),
    "American": (
        "mdy",
        10**6,
        lambda t: f"{t.month}/{t.day}/{t.year} {t.hour % 12 or 12}:{t:%M:%S} {'AP'[t.hour > 11]}M",
    ),
    "American, two digits": ("mdy", 1, lambda t: f"{t:%m/%d/%y %H:%M:%S.%f}"),
    "Torque": (
        "dmy",
        1000,
        lambda t: f"{t.day:02}-{MONTH[t.month - 1]}-{t.year} {t:%H:%M:%S}.{t.microsecond // 1000:03}",
    ),
    "a month in words": ("dmy", 86400 * 10**6, lambda t: f"{t.day}.{MONTH[t.month - 1]}.{t.year}"),
    "a month first": ("mdy", 10**6, lambda t: f"{MONTH[t.month - 1]} {t.day}, {t.year} {t:%H:%M:%S}"),
    "a year and a month": ("ymd", 10**6, lambda t: f"{t.year}-{MONTH[t.month - 1]}-{t.day:02} {t:%H:%M:%S}"),
    "RFC 2822": (
        "dmy",
        10**6,
        lambda t: f"{WEEKDAY[t.weekday()]}, {t.day} {MONTH[t.month - 1]} {t.year} {t:%H:%M:%S} +0000",
    ),
    "Java": ("mdy", 10**6, lambda t: java(t + timedelta(hours=8))),
    "C": ("mdy", 10**6, lambda t: f"{WEEKDAY[t.weekday()]} {MONTH[t.month - 1]} {t.day:2} {t:%H:%M:%S} {t.year}"),
    "digits": ("ymd", 10**6, lambda t: f"{t:%Y%m%d_%H%M%S}"),
    "digits and T": ("ymd", 1, lambda t: f"{t:%Y%m%dT%H%M%S.%f}Z"),
    "digits alone": ("ymd", 10**6, lambda t: f"{t:%Y%m%d%H%M%S}"),
    "the clock first": ("dmy", 1, lambda t: f"{t:%H:%M:%S.%f %d.%m.%Y}"),
    "words": ("dmy", 60 * 10**6, lambda t: f"{t.day}th of {t:%B %Y} at {t:%I:%M %p}"),
    "Apache": ("dmy", 10**6, lambda t: f"{t.day:02}/{MONTH[t.month - 1]}/{t.year}:{t:%H:%M:%S} +0000"),
    "milliseconds behind a colon": (
        "ymd",
        1000,
        lambda t: f"{t:%Y-%m-%d %H:%M:%S}:{t.microsecond // 1000}",
    ),
}


@pytest.mark.slow
@each("name", FORMS)
@settings(max_examples=EXAMPLES // 2)
@given(instant=INSTANTS)
def test_every_form_reads_what_was_written(name, instant):
    order, unit, write = FORMS[name]
    written = write(instant)
    assert parse_calendar(written, order) == microseconds(instant) // unit * unit, written


@given(instant=INSTANTS)
def test_a_year_of_four_digits_in_front_has_one_order(instant):
    for write in (
        FORMS["iso"][2],
        FORMS["slashes, year first"][2],
        FORMS["digits"][2],
        FORMS["a year and a month"][2],
    ):
        assert parse_calendar(write(instant), "dmy") is None
        assert parse_calendar(write(instant), "mdy") is None


@each(
    ("cell", "order", "iso"),
    [
        ("1970-01-01T01:00:00+01:00", "ymd", "1970-01-01"),
        ("1969-12-31 23:59:59", "ymd", "1969-12-31T23:59:59"),
        ("2022-02-23T24:00", "ymd", "2022-02-24"),
        ("27. Mai 2021 7:18", "dmy", "2021-05-27T07:18"),
        ("3 août 2021", "dmy", "2021-08-03"),
        ("15-Dez-68", "dmy", "2068-12-15"),
        ("15-Dec-69", "dmy", "1969-12-15"),
        ("2022-02-23 07:18:47 CEST", "ymd", "2022-02-23T05:18:47"),
        ("2022-02-23T07:18:47.5+01:00[Europe/Berlin]", "ymd", "2022-02-23T06:18:47.5"),
        ("11/25/2015 12:03:05 am", "mdy", "2015-11-25T00:03:05"),
        ("2018/8/19 18:6:3", "ymd", "2018-08-19T18:06:03"),
        ("2018/8/19 (Sunday) 18:6:3", "ymd", "2018-08-19T18:06:03"),
        ("2018年8月19日 18:06:03", "ymd", "2018-08-19T18:06:03"),
        ("2022-02-23 07:18:47.375 +0800 CST", "ymd", "2022-02-22T23:18:47.375"),
        ("2022-02-23 07:18:47+00", "ymd", "2022-02-23T07:18:47"),
        ("Wed Feb 23 2022 07:18:47 GMT+0800 (China Standard Time)", "mdy", "2022-02-22T23:18:47"),
        ("Feb 23 2022 07:18:47:123PM", "mdy", "2022-02-23T19:18:47.123"),
    ],
)
def test_a_stamp_is_this_instant(cell, order, iso):
    assert parse_calendar(cell, order) == microseconds(datetime.fromisoformat(iso))


@each("order", ["ymd", "dmy", "mdy"])
@each(
    "cell",
    [
        "1970-02-31", "0000-01-01", "1970-01-01 25:00:00", "hello", "1970", "1.5", "", "192.0.2.7", "2022-W08-3",
        "2022-054", "1970-01-01 12:00 foo", "Station 5 May 2021x", "12:00:00", "٢٠٢٢-٠٢-٢٣", "1/2/3", "1/2/345",
        "2022-02-23 13:00 PM", "2022-02-23 7:61", "20220231", "2022022", "foo 23 Feb 2022", "Feb 23", "-5", "3-4",
        "2022-02-23 07:18:47 XYZ", "2022-02-23 07:18+99:00", "1" * 65, "2022-02-23 " + "0" * 60,
    ],
)  # fmt: skip
def test_what_is_no_date_is_none(cell, order):
    assert parse_calendar(cell, order) is None
