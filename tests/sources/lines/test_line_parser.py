import math

import numpy as np
import pytest
from each import each
from hypothesis import given
from hypothesis import strategies as st

from kalscope.sources.grammar.cells import is_blank, is_comment, parse_number, split_fields
from kalscope.sources.grammar.line_format import find_labels, split_stamp
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.reading import line_parser
from kalscope.sources.reading.line_reader import LineReader
from kalscope.sources.reading.sniffer import sniff


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_printed_float_is_read_back_exactly(value):
    assert parse_number(repr(value)) == value
    assert parse_number(repr(value).replace(".", ","), ",") == value


@each("cell", ["", "nan", "NaN", "-nan", "nil", "NULL", "N/A", "None"])
def test_missing_words_are_nan(cell):
    value = parse_number(cell)
    assert value is not None
    assert math.isnan(value)


@each(
    "cell",
    [
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
        "1 2",
        "٣",
        "1.2.3",
        "e5",
    ],
)
def test_what_is_no_finite_decimal_number_is_none(cell):
    assert parse_number(cell) is None


def test_a_decimal_comma_needs_a_digit_after_it():
    assert parse_number("155,", ",") is None
    assert parse_number("155,5", ",") == 155.5
    assert parse_number("1.5", ",") is None


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


@each(
    ("line", "pairs"),
    [
        ("a:1,b:2", [("a", "1"), ("b", "2")]),
        ("a: 1, b: 2", [("a", "1"), ("b", "2")]),
        ("a:1 b:2\r\n", [("a", "1"), ("b", "2")]),
        ("a:1\tb:2", [("a", "1"), ("b", "2")]),
        ("Sensor Value: 155, Volts: 0.76", [("Sensor Value", "155"), ("Volts", "0.76")]),
        (">a:1", [("a", "1")]),
        ("12:30:05,5", None),
        ("hello world", None),
        ("a:1,5", None),
        ("1,2,3", None),
    ],
)
def test_labels_are_words_before_a_colon(line, pairs):
    assert find_labels(line) == pairs


def test_a_labelled_line_is_put_in_column_order_and_unknown_or_double_labels_refused():
    reader = LineReader(sniff(["a:1,b:2", "a:3,b:4"]))
    assert reader.read(1, "b:2,a:1").rows == ((1.0, 2.0),)
    np.testing.assert_array_equal(reader.read(2, "b:2").rows, [(math.nan, 2.0)])
    assert reader.read(3, "c:2").kind == "rejected"
    assert reader.read(4, "a:1,a:2").kind == "rejected"


@each(
    ("line", "parts"),
    [
        ("[   60] ax=0.5 ay=1", ("60", "ax=0.5 ay=1")),
        ("[12.345678] ax=0.5", ("12.345678", "ax=0.5")),
        ("I (3000) sensor: temp: 21.06", ("3000", "temp: 21.06")),
        ("2024-03-09T22:58:03Z temp=20.87", ("2024-03-09T22:58:03Z", "temp=20.87")),
        ("2024-03-09 22:58:03,123 INFO temp=20.89", ("2024-03-09 22:58:03,123", "INFO temp=20.89")),
        ("60 ax=0.5 ay=1", ("60", "ax=0.5 ay=1")),
        ("12:00:00 21.5 C", None),  # a table of blanks
        ("60 rows read", None),
    ],
)
def test_stamps_before_pairs_are_split_off(line, parts):
    assert split_stamp(line) == parts


def test_the_monitor_stamp_is_cell_zero():
    assert split_stamp("12:00:00.023 -> 20.0\n") == ("12:00:00.023", "20.0\n")
    assert split_stamp("20.0") is None
    reader = LineReader(sniff(["12:00:00.023 -> 1,2", "12:00:00.033 -> 3,4"]))
    ((_, *values),) = reader.read(1, "12:00:00.043 -> 5,6\n").rows
    assert values == [5.0, 6.0]
    assert reader.read(2, "5,6\n").kind == "rejected"


def test_comments_and_blank_lines_are_known():
    assert all(is_comment(line) for line in ("# a", "  % a", "// a"))
    assert not is_comment("1 # a")
    assert is_blank(" \t\r\n")
    assert is_blank(";;;\n", ";")
    assert not is_blank(";0;\n", ";")


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
