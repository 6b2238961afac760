"""Whether a cell is a stamp at all."""

from datetime import datetime

import pytest
from each import each
from hypothesis import given
from hypothesis import strategies as st

from kalscope.sources.grammar.cells import is_number
from kalscope.sources.grammar.stamps import is_stamp

INSTANTS = st.datetimes(datetime(1970, 1, 1), datetime(2068, 12, 31))
PATTERNS = [
    "%Y-%m-%d", "%Y-%m-%dT%H:%M:%S.%fZ", "%d.%m.%Y %H:%M", "%m/%d/%y %I:%M:%S %p", "%d-%b-%Y %H:%M:%S", "%H:%M",
    "%a %b %d %H:%M:%S GMT+08:00 %Y", "%Y%m%d_%H%M%S", "%H:%M:%S.%f %d.%m.%Y", "%b %d, %Y", "%H:%M:%S", "%M:%S.%f",
    "%H.%M.%S", "%I:%M %p", "1%H:%M:%S", "1 day, %H:%M:%S", "%d/%b/%Y:%H:%M:%S +0000",
]  # fmt: skip


@pytest.mark.slow
@each("pattern", PATTERNS)
@given(instant=INSTANTS)
def test_a_stamp_of_any_form_is_one(pattern, instant):
    assert is_stamp(instant.strftime(pattern))


@given(number=st.floats(allow_nan=False, allow_infinity=False), decimals=st.integers(0, 9))
def test_no_number_is_a_stamp(number, decimals):
    for text in (repr(number), f"{number:.{decimals}f}", f"{number:.{decimals}e}", str(int(number))):
        assert is_number(text)
        assert not is_stamp(text)
        assert not is_stamp(text.replace(".", ","))


@each(
    "cell",
    [
        "", "abc", "hello 123", "20.5 C", "1.013,25", "192.0.2.7", "v1.2.3", "boot:0x13", "0-100kph Time(s)", "3:4",
        "1/4 mile time(s)", "T1", "May", "Mar 5", "acc_2", "KAMW 080500Z AUTO 16009KT 10SM", "25:61:00",
        "12:00 foo", "2024-13-01", "1" * 65, ":" * 64, "9:" * 32, "2024-03-13 " + "0" * 50,
    ],
)  # fmt: skip
def test_other_texts_are_none(cell):
    assert not is_stamp(cell)
