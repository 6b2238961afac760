"""Clocks and elapsed times: what is written comes back."""

from each import each
from hypothesis import given
from hypothesis import strategies as st

from kalscope.sources.grammar.stamps import parse_clock, parse_elapsed, parse_hhmm, parse_hhmmss, parse_minutes

DAY_US = 86400 * 10**6
OF_DAY = st.integers(0, DAY_US - 1)


def parts(us):
    seconds, us = divmod(us, 10**6)
    return seconds // 3600, seconds // 60 % 60, seconds % 60, us


@given(us=OF_DAY, digits=st.integers(0, 9), mark=st.sampled_from(".,"))
def test_a_clock_reads_what_was_written_and_cuts_beyond_the_microsecond(us, digits, mark):
    h, m, s, us = parts(us)
    fraction = f"{us:06}478"[:digits]
    written = f"{h:02}:{m:02}:{s:02}" + (mark + fraction if digits else "")
    assert parse_clock(written) == (h * 3600 + m * 60 + s) * 10**6 + int(fraction[:6].ljust(6, "0"))


@given(us=st.integers(0, 9999 * 3600 * 10**6))
def test_elapsed_hours_go_on_above_24(us):
    h, m, s, us = parts(us)
    true = (h * 3600 + m * 60 + s) * 10**6 + us
    assert parse_elapsed(f"{h}:{m:02}:{s:02}.{us:06}") == true
    assert parse_elapsed(f"-{h}:{m:02}:{s:02}.{us:06}") == -true
    assert parse_elapsed(f"{h // 24} days, {h % 24}:{m:02}:{s:02}.{us:06}") == true
    assert parse_elapsed(f"{h // 24}.{h % 24:02}:{m:02}:{s:02}.{us:06}") == true


@given(us=st.integers(0, 9999 * 60 * 10**6))
def test_minutes_and_seconds_read_what_was_written(us):
    minutes, us = divmod(us, 60 * 10**6)
    assert parse_minutes(f"{minutes}:{us // 10**6:02}.{us % 10**6:06}") == minutes * 60 * 10**6 + us


@given(us=OF_DAY)
def test_digits_read_what_was_written(us):
    h, m, s, _ = parts(us)
    assert parse_hhmm(f"{h:02}{m:02}") == parse_hhmm(str(100 * h + m)) == (h * 60 + m) * 60 * 10**6
    assert parse_hhmmss(f"{h:02}{m:02}{s:02}.25") == (h * 3600 + m * 60 + s) * 10**6 + 250_000


@each(
    ("cell", "seconds"),
    [
        ("12:00", 43200),
        ("18.00.00", 64800),
        ("7:03:05 P.M.", 68585),
        ("18:6:3", 65163),
        ("08h30", 30600),
        ("3:4", None),
        ("1.2.3", None),
        ("12:00:00:250", 43200.25),
        ("12:00:00:5", 43200.005),
        ("24:00", None),
        ("1.5", None),
        ("56:36.147", None),
        ("12:60", None),
        ("0:05 AM", None),
        ("1" * 65, None),
        ("12:00:00." + "0" * 60, None),
    ],
)
def test_clocks_are_microseconds_since_midnight(cell, seconds):
    assert parse_clock(cell) == (None if seconds is None else seconds * 1e6)
