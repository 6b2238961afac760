import pytest
from each import each
from hypothesis import given
from hypothesis import strategies as st

from kalscope.sources.grammar.cells import parse_number, split_fields
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.reading import line_parser


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_printed_float_is_read_back_exactly(value):
    assert parse_number(repr(value)) == value
    assert parse_number(repr(value).replace(".", ","), ",") == value


@each(
    "cell",
    [
        "1 2",
        *[
            "12abc",
            "0x1F",
            "Infinity",
            "inf",
            "-inf",
            "1e999",
            "ERR",
            "1_000",
            "1,5",
            "--1",
            ".",
            "٣",
            "1.2.3",
            "e5",
        ],
    ],
)
def test_what_is_no_finite_decimal_number_is_none(cell):
    assert parse_number(cell) is None


@each(
    ("line", "delimiter", "cells"),
    [
        ("1, 2 ,3\n", ",", ["1", "2", "3"]),
        ("1,,3", ",", ["1", "", "3"]),
        ("  1   2\t3 \n", " ", ["1", "2", "3"]),
        ("1\t\t3", "\t", ["1", "", "3"]),
        ('"a, b",2', ",", ["a, b", "2"]),
        ('1 "a b" 3', " ", ["1", "a b", "3"]),
        ('0.09,"20.1,5.0', ",", ["0.09", '"20.1', "5.0"]),
        ('" 3"25,1', ",", ['" 3"25', "1"]),
        ('" 3"25 1', " ", ['"', '3"25', "1"]),
        ("\n", " ", []),
    ],
)
def test_fields_are_split_at_the_delimiter_and_never_beyond_the_line(line, delimiter, cells):
    assert split_fields(line, delimiter) == cells


@pytest.mark.slow
def test_text_without_data_costs_each_line_only_a_few_looks(monkeypatch):
    looked = []

    def sniff(head, options):
        looked.append(len(head))
        return real(head, options)

    real = line_parser.sniff
    monkeypatch.setattr(line_parser, "sniff", sniff)
    parser = line_parser.LineParser()
    parser.feed(b"".join(b"state s%d\n" % i for i in range(3000)))
    assert {event.kind for event in parser} == {"text"}
    assert sum(looked) < 10 * 3000


@pytest.mark.parametrize("options", [ReadOptions(header_row=2), ReadOptions(header_row=2, unit_row=3)])
def test_a_stream_waits_for_the_rows_that_were_chosen(options):
    parser = line_parser.LineParser(options)
    parser.feed(b"Logger v1.2\na,b\n1,2\n3,4\n5,6\n")
    kinds = [event.kind for event in parser]
    assert parser.layout is not None
    assert [column.name for column in parser.layout.columns] == ["a", "b"]
    assert kinds[-2:] == ["row", "row"]
    assert parser.adopt_layout(["Logger v1.2"]) is None


def test_colours_of_a_terminal_are_no_damage():
    parser = line_parser.LineParser()
    parser.feed(b"".join(b"\x1b[0;32mI (%d) app: temp=%d.5\x1b[0m\n" % (1000 + 10 * i, 20 + i) for i in range(9)))
    rows = [event.rows[0] for event in parser if event.kind == "row"]
    assert rows == [(1000 + 10 * i, 20.5 + i) for i in range(9)]
