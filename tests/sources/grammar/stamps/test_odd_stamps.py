"""Stamps of other forms: nothing but a whole date is read, whatever the text."""

from datetime import datetime, timedelta

import pytest
from each import each
from hypothesis import given
from hypothesis import strategies as st

from kalscope.sources.grammar.stamps import parse_excel, parse_with_dateutil, parse_with_format

INSTANTS = st.datetimes(datetime(1970, 1, 1), datetime(2068, 12, 31, 23, 59, 59))
WORDS = "Feb 23rd 2022 7 pm at of . , : - / + GMT CEST Z 07:18:47 T 99 1e9 99999999999 noon W08 h m"


def microseconds(instant):
    return (instant - datetime(1970, 1, 1)) // timedelta(microseconds=1)


@given(st.one_of(st.text(max_size=70), st.lists(st.sampled_from(WORDS.split()), max_size=12).map(" ".join)))
def test_any_text_is_a_number_or_none(text):
    for order in ("ymd", "dmy", "mdy"):
        stamp = parse_with_dateutil(text, order)
        assert stamp is None or abs(stamp) < 1e18


@given(instant=INSTANTS)
def test_words_are_read(instant):
    written = f"{instant:%d} of {instant:%B} {instant:%Y} at {instant:%I:%M:%S %p}"
    assert parse_with_dateutil(written, "dmy") == microseconds(instant.replace(microsecond=0))


@each("cell", ["10:15", "Feb 5", "7pm", "hello 5", "12:00:00 PM", "1.5e3abc", "May 2022", "Monday 10:00"])
def test_a_date_that_lacks_a_part_is_none(cell):
    assert parse_with_dateutil(cell, "dmy") is None


def test_a_sign_behind_a_name_of_a_zone_counts_from_it():
    assert parse_with_dateutil("Feb 23rd 2022 7:00 GMT+08:00", "mdy") == microseconds(datetime(2022, 2, 22, 23))


@given(instant=INSTANTS)
def test_a_format_reads_what_it_wrote(instant):
    form = "%S;%M;%H|%d %b %Y~%f"
    assert parse_with_format(instant.strftime(form), form) == microseconds(instant)


@given(instant=st.datetimes(datetime(1970, 1, 1), datetime(2068, 12, 31)))
def test_day_numbers_of_a_spreadsheet_keep_the_second(instant):
    days = (instant - datetime(1899, 12, 30)).total_seconds() / 86400
    assert parse_excel(f"{days:.9f}", ".") == pytest.approx(microseconds(instant), abs=1e3)
    assert parse_excel("19999", ".") is None
    assert parse_excel("x", ".") is None
