"""Stamps of other forms: nothing but a whole date is read, whatever the text."""

from datetime import datetime, timedelta

from hypothesis import given
from hypothesis import strategies as st

from kalscope.sources.grammar.stamps import parse_with_format

INSTANTS = st.datetimes(datetime(1970, 1, 1), datetime(2068, 12, 31, 23, 59, 59))


def microseconds(instant):
    return (instant - datetime(1970, 1, 1)) // timedelta(microseconds=1)


@given(instant=INSTANTS)
def test_a_format_reads_what_it_wrote(instant):
    form = "%S;%M;%H|%d %b %Y~%f"
    assert parse_with_format(instant.strftime(form), form) == microseconds(instant)
