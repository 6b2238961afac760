"""Stamps: what is written comes back, no order reads the stamps of another, and a column has one form."""

from datetime import datetime, timedelta
from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.effort import EXAMPLES

from kalscope.errors import BadSetting
from kalscope.sources.grammar.cells import is_number
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.grammar.timestamps import (
    CLOCK_PARSERS,
    TimeName,
    find_stamp_form,
    is_stamp,
    parse_calendar,
    parse_clock,
    stamp_parser,
)

DAY_US = 86400 * 10**6


@pytest.mark.slow
@given(us=st.integers(0, 9999 * 60 * 10**6))
def test_clocks_read_what_was_written_and_cut_beyond_the_microsecond(us):
    seconds, part = divmod(us, 10**6)
    h, m, s = seconds // 3600, seconds // 60 % 60, seconds % 60
    for form, cell, expected in (
        ("h:m:s", f"{h % 24:02}:{m:02}:{s:02},{part:06}478", us % DAY_US),
        ("elapsed", f"{h}:{m:02}:{s:02}.{part:06}", us),
        ("elapsed", f"-{h}:{m:02}:{s:02}.{part:06}", -us),
        ("elapsed", f"{h // 24} days, {h % 24}:{m:02}:{s:02}.{part:06}", us),
        ("elapsed", f"{h // 24}d {h % 24}h {m}m {s}.{part:06}s", us),
        ("elapsed", f"{60 * h + m}:{s:02}.{part:06}", us),
        ("hhmm", f"{h % 24:02}{m:02}", us % DAY_US // (60 * 10**6) * 60 * 10**6),
        ("hhmm", f"{h % 24 * 100 + m}", us % DAY_US // (60 * 10**6) * 60 * 10**6),
        ("hhmmss", f"{h % 24:02}{m:02}{s:02}.25", us % DAY_US // 10**6 * 10**6 + 250_000),
    ):
        assert CLOCK_PARSERS[form](cell) == expected, cell


@pytest.mark.parametrize(("cell", "seconds"), [
    *(("18.00.00", 64800), ("7:03:05 P.M.", 68585), ("18:6:3", 65163), ("9:30 a. m.", 34200)),
    *(("08h30", 30600), ("12:00:00:250", 43200.25), ("12:00:00:5", 43200.005), ("24:00", 86400)),
    *((cell, None) for cell in ("3:4", "1.2.3", "24:01", "1.5", "56:36.147", "12:60", "0:05 AM", "1" * 65)),
    ("12:00:00." + "0" * 60, None),
])  # fmt: skip
def test_clocks_are_microseconds_since_midnight(cell, seconds):
    assert parse_clock(cell) == (None if seconds is None else seconds * 1e6)


def microseconds(instant):
    return (instant - datetime(1970, 1, 1)) // timedelta(microseconds=1)


FORMS = {  # order, what is kept of the instant in µs, how it is written
    "iso": ("ymd", 1, lambda t: t.isoformat(" ")),
    "iso and UTC": ("ymd", 1, lambda t: t.isoformat(" ", "microseconds").replace(".", ",") + " UTC"),
    "iso with a zone": ("ymd", 1, lambda t: (t + timedelta(hours=5.5)).isoformat() + "+05:30"),
    "iso with nanoseconds": ("ymd", 1, lambda t: t.isoformat(" ", "microseconds") + "999"),
    "ms behind a colon": ("ymd", 1000, lambda t: f"{t:%Y-%m-%d %H:%M:%S}:{t.microsecond // 1000}"),
    "slashes, no zeros": ("ymd", 10**6, lambda t: f"{t.year}/{t.month}/{t.day} {t.hour}:{t:%M:%S}"),
    "dots": ("dmy", 1, lambda t: f"{t:%d.%m.%Y %H:%M:%S.%f}"),
    "American": ("mdy", 10**6, lambda t: f"{t.month}/{t.day}/{t.year} {t:%I:%M:%S %p}"),
    "Torque": ("dmy", 1, lambda t: f"{t:%d-%b-%Y %H:%M:%S.%f}"),
    "a month in words": ("dmy", DAY_US, lambda t: f"{t.day}.{t:%B}.{t.year}"),
    "a month first": ("mdy", 10**6, lambda t: f"{t:%B} {t.day}, {t:%Y %H:%M:%S}"),
    "a year and a month": ("ymd", 10**6, lambda t: f"{t:%Y-%b-%d %H:%M:%S}"),
    "RFC 2822": ("dmy", 10**6, lambda t: f"{t:%a, %d %b %Y %H:%M:%S} +0000"),
    "Java": ("mdy", 10**6, lambda t: f"{t + timedelta(hours=8):%a %b %d %H:%M:%S GMT+08:00 %Y}"),
    "C": ("mdy", 10**6, lambda t: f"{t:%a %b} {t.day:2} {t:%H:%M:%S %Y}"),
    "digits": ("ymd", 10**6, lambda t: f"{t:%Y%m%d_%H%M%S}"),
    "digits alone": ("ymd", 1, lambda t: f"{t:%Y%m%d%H%M%S%f}"),
    "the clock first": ("dmy", 1, lambda t: f"{t:%H:%M:%S.%f %d.%m.%Y}"),
    "words": ("dmy", 60 * 10**6, lambda t: f"{t.day}th of {t:%B %Y} at {t:%I:%M %p}"),
    "Apache": ("dmy", 10**6, lambda t: f"{t:%d/%b/%Y:%H:%M:%S} +0000"),
}
INSTANTS = st.datetimes(datetime(1970, 1, 1), datetime(2068, 12, 31, 23, 59, 59, 999999))


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMS)
@settings(max_examples=EXAMPLES // 2)
@given(instant=INSTANTS)
def test_every_form_reads_what_was_written(name, instant):
    order, unit, write = FORMS[name]
    written = write(instant)
    assert parse_calendar(written, order) == microseconds(instant) // unit * unit, written
    if order == "ymd":  # a year of four digits in front has one order
        assert parse_calendar(written, "dmy") is parse_calendar(written, "mdy") is None


@pytest.mark.parametrize(("cell", "order", "iso"), [
    ("1970-01-01T01:00:00+01:00", "ymd", "1970-01-01"),
    *(("1969-12-31 23:59:59", "ymd", "1969-12-31T23:59:59"), ("2022-02-23T24:00", "ymd", "2022-02-24")),
    *(("27. Mai 2021 7:18", "dmy", "2021-05-27T07:18"), ("3 août 2021", "dmy", "2021-08-03")),
    *(("5 juillet 2021", "dmy", "2021-07-05"), ("15-Dez-68", "dmy", "2068-12-15")),
    *(("15-Dec-69", "dmy", "1969-12-15"), ("2022-02-23 07:18:47 CEST", "ymd", "2022-02-23T05:18:47")),
    ("2022-02-23T07:18:47.5+01:00[Europe/Berlin]", "ymd", "2022-02-23T06:18:47.5"),
    ("2022-02-23 07:18:47.375 +0800 CST", "ymd", "2022-02-22T23:18:47.375"),
    ("Wed Feb 23 2022 07:18:47 GMT+0800 (China Standard Time)", "mdy", "2022-02-22T23:18:47"),
    ("Feb 23 2022 07:18:47:123PM", "mdy", "2022-02-23T19:18:47.123"),
    ("2018/8/19 (Sunday) 18:6:3", "ymd", "2018-08-19T18:06:03"),
    *(("2018年8月19日 18时06分", "ymd", "2018-08-19T18:06"), ("2022-02", "ymd", "2022-02-01")),
])  # fmt: skip
def test_a_stamp_is_this_instant(cell, order, iso):
    assert parse_calendar(cell, order) == microseconds(datetime.fromisoformat(iso))


NO_DATES = [
    "1970-02-31", "0000-01-01", "1970-01-01 25:00:00", "hello", "1970", "1.5", "", "192.0.2.7", "2022-W08-3",
    "2022-054", "1970-01-01 12:00 foo", "Station 5 May 2021x", "12:00:00", "٢٠٢٢-٠٢-٢٣", "1/2/3", "1/2/345",
    "2022-02-23 13:00 PM", "2022-02-23 7:61", "20220231", "2022022", "foo 23 Feb 2022", "Feb 23", "-5", "3-4",
    "2022-02-23 07:18:47 XYZ", "2022-02-23 07:18+99:00", "1" * 65, "2022-02-23 " + "0" * 60,
]  # fmt: skip


@pytest.mark.parametrize("order", ["ymd", "dmy", "mdy"])
def test_what_is_no_date_is_none(order):
    assert [cell for cell in NO_DATES if parse_calendar(cell, order) is not None] == []


@pytest.mark.slow
@given(number=st.floats(allow_nan=False, allow_infinity=False), decimals=st.integers(0, 9))
def test_no_number_is_a_stamp(number, decimals):
    for text in (repr(number), f"{number:.{decimals}f}", f"{number:.{decimals}e}", str(int(number))):
        assert is_number(text)
        assert not is_stamp(text)
        assert not is_stamp(text.replace(".", ","))


# Which form a column of stamps is in, decided once for the whole column.

TIME, NAMED, DATE = TimeName(2), TimeName(is_date=True), TimeName(2, is_date=True)


def days(order, count=11, step=1):
    pattern = {"dmy": "%d/%m/%Y", "mdy": "%m/%d/%Y"}[order]
    return [(datetime(2024, 1, 1) + timedelta(days=step * i)).strftime(pattern) for i in range(count)]


@pytest.mark.parametrize(("cells", "unit", "clock"), [
    ([f"{i // 60:02}:{i % 60:02}" for i in range(300)], "", "elapsed"),  # it begins at 00:00
    ([f"{i // 60:02}:{i % 60:02}" for i in range(1440)], "", "h:m:s"),  # the minutes of a day
    ([f"{i // 6}:{i % 6}0" for i in range(200)], "", "h:mm"),  # more than a day
    ([f"{i // 6:02}:{i % 6}0" for i in range(100)], "", "h:m:s"),
    ([f"{i // 60:02}:{i % 60:02}" for i in range(300, 600)], "", "h:m:s"),
    ([f"{i // 60:02}:{i % 60:02}" for i in range(300, 600)], "s", "elapsed"),  # Time (mm:ss)
])  # fmt: skip
def test_two_numbers_are_hours_and_minutes_unless_start_or_name_say_minutes_and_seconds(cells, unit, clock):
    form = find_stamp_form(cells, ".", TimeName(2, unit))
    assert form.clock == clock
    assert ('--time-format "%H:%M"' if clock == "elapsed" else '--time-format "%M:%S"') in form.notes[0]


def test_eight_digits_and_day_numbers_are_dates_only_where_the_name_allows():
    assert [find_stamp_form(["19580329"], ".", name).kind for name in (DATE, TIME)] == ["calendar", "number"]
    assert [find_stamp_form(["45123,5"], ",", name).unit for name in (DATE, TIME)] == ["day", ""]


@pytest.mark.parametrize("order", ["dmy", "mdy"])
def test_even_steps_decide_where_no_day_is_above_twelve_else_the_day_comes_first_and_the_note_names_the_option(
    order,
):
    for step, count in ((1, 12), (2, 6), (3, 4)):
        form = find_stamp_form(days(order, count, step), ".", TIME)
        assert (form.order, form.notes) == (order, ())
    cells = [f"03/04/2024 12:00:{i:02}" for i in range(60)]
    form = find_stamp_form(cells, ".", TIME)
    assert (form.order, "--month-first" in form.notes[0]) == ("dmy", True)
    assert not find_stamp_form([cell.replace("03/04", "04/04") for cell in cells], ".", TIME).notes


def test_a_format_of_the_user_is_the_form_or_is_refused():
    for form, kind, cell, us in (
        ("%H-%M-%S.%f", "clock", "01-00-00.5", 3600.5e6),
        ("%Y|%j", "calendar", "1970|002", 86400e6),
    ):
        column = find_stamp_form([cell], ".", TimeName(), ReadOptions(time_format=form))
        assert (column.kind, stamp_parser(column, ".")(cell)) == (kind, us)
    assert find_stamp_form(["12:00"], ".", TimeName(), ReadOptions(time_format="%d.%m.%Y")) is None
    for form in ("%Q", "abc", "", "%H:%M:%M", "%c %Y"):
        with pytest.raises(BadSetting, match="time_format must"):
            find_stamp_form(["12:00"], ".", TimeName(), ReadOptions(time_format=form))


@pytest.mark.parametrize("pattern", ["%Y%m%d%H", "%Y%m%d%H%M", "%Y%m%d%H%M%S"])
@pytest.mark.parametrize("name", [NAMED, TIME])
@pytest.mark.parametrize(("start", "count"), [(datetime(1893, 1, 1, 20), 60), (datetime(2024, 2, 28, 22), 5)])
def test_digits_of_a_date_and_a_clock(pattern, name, start, count):
    stamps = [start + timedelta(hours=i) for i in range(count)]
    cells = [stamp.strftime(pattern) for stamp in stamps]
    form = find_stamp_form(cells, ".", name)
    assert form.kind == "calendar"
    assert [stamp_parser(form, ".")(cell) for cell in cells] == [microseconds(stamp) for stamp in stamps]


@pytest.mark.parametrize("start", [1_700_000_000, 1_801_010_100, 2_024_010_100, 1_999_123_100])
def test_seconds_since_1970_are_no_date_of_ten_digits(start):
    for name, step in product((NAMED, DATE), (1, 7, 60)):
        assert find_stamp_form([str(start + step * i) for i in range(60)], ".", name).kind == "number"
