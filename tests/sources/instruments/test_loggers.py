"""What loggers and wearables write above their samples; each text is made up in the form of real files."""

from each import each
from prefaces import head, preface

from kalscope.sources.reading.preface import Preface, find_preface


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
