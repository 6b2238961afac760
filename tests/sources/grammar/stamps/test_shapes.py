"""Whether a cell is a stamp at all."""

from each import each
from hypothesis import given
from hypothesis import strategies as st

from kalscope.sources.grammar.cells import is_number
from kalscope.sources.grammar.timestamps import is_stamp


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
