"""Cells of a line: brackets around a row of numbers, and what they do not change."""

from each import each

from kalscope.sources.grammar.cells import split_fields


@each(
    ("line", "delimiter", "cells"),
    [
        ("[1.5, -2, 3]", ",", ["1.5", "-2", "3"]),
        ("(1;2)\n", ";", ["1", "2"]),
        (" ( .5  7 ) \r\n", " ", [".5", "7"]),
        ("[V]", ",", ["[V]"]),
        ("(12)", ",", ["(12)"]),
        ("[a, b]", ",", ["[a", "b]"]),
        ("[1, 2)", ",", ["[1", "2)"]),
        ("[1], [2]", ",", ["[1]", "[2]"]),
        ("(1) x, (2)", ",", ["(1) x", "(2)"]),
        ("1, 2 (3)", ",", ["1", "2 (3)"]),
        ("]", ",", ["]"]),
        ("[]", ",", ["[]"]),
        ("[ ]", " ", ["[", "]"]),
        ("[nan, 0.5, 2]", ",", ["nan", "0.5", "2"]),
        ("(None, 0.5, 2)", ",", ["None", "0.5", "2"]),
        ("[NaN 0.5]", " ", ["NaN", "0.5"]),
    ],
)
def test_brackets_around_a_row_of_numbers_are_left_out_and_no_others(line, delimiter, cells):
    assert split_fields(line, delimiter) == cells
