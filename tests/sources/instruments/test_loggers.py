"""What loggers and wearables write above their samples; each text is made up in the form of real files."""

import pytest
from each import each
from prefaces import head, preface

from kalscope.sources.reading.preface import Preface, find_preface


def test_empatica_start_and_rate_are_no_samples():
    found = preface("""
1551453301.000000, 1551453301.000000, 1551453301.000000
32.000000, 32.000000, 32.000000
-1,65,5
-1,65,4
""")
    assert (found.first_row, found.time_column) == (3, -1)
    assert (found.period, found.start) == (1 / 32, 1551453301)
    assert (found.names, found.units) == (("x", "y", "z"), ("1/64 g",) * 3)


@pytest.mark.parametrize("rate", [1, 4, 64])
def test_empatica_one_column(rate):
    found = preface(f"1551453311.00\n{rate}.000000\n88.00\n88.67")
    assert (found.names, found.period, found.start) == (("value",), 1 / rate, 1551453311)


def test_empatica_beats_are_stamped_from_the_start():
    found = preface("1551453301.000000, IBI\n145.631666,0.62509\n146.522332,0.890666")
    assert (found.names, found.units) == (("time", "IBI"), ("s", "s"))
    assert (found.first_row, found.time_column, found.start) == (2, 0, 1551453301)


@each(
    "text",
    [
        "1551453301\n1551453302\n1551453303",  # stamps alone
        "1551453301\n1\n1551453302\n1",
        "1551453301,1551453301\n32,64\n1,2\n3,4",
        "1551453301,20.5\n32,20.6\n64,20.7",
        "1551453301\n33\n1\n2",  # no rate of an E4
        "100.0\n32.0\n1\n2",
        "1551453301,1551453301\n32,32\n1\n2",
    ],
)
def test_numbers_that_begin_like_an_empatica_file_are_no_such_file(text):
    assert find_preface(head(text)) == Preface()


@each(("line", "delimiter"), [("sep=;", ";"), ('"sep=,"', ","), ("sep=\t", "\t"), ("SEP=|", "|")])
def test_a_separator_line_for_a_spreadsheet_names_the_delimiter(line, delimiter):
    assert preface(f"{line}\nt{delimiter}a\n0{delimiter}1").delimiter == delimiter


def test_a_byte_order_mark_hides_no_instrument():
    assert (
        preface("\ufeffX,CH1,Start,Increment,\nSequence,Volt,0,1e-6\n0,1,\n1,2,").instrument == "Rigol oscilloscope"
    )
