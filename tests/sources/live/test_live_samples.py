"""Variables that come together are one sample of several channels."""

import math

import numpy as np
import pytest

from kalscope.sources.live.lines import LineCounts
from kalscope.sources.live.samples import ArrivedRow, LiveSamples, gathered
from kalscope.sources.port.registry import PortSpec
from kalscope.sources.reading.line_parser import LineParser

NAN = math.nan


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([(5, 1, NAN), (5, NAN, 2)], [(5, 1, 2)]),
        ([(5, 1, NAN), (6, NAN, 2)], [(5, 1, NAN), (6, NAN, 2)]),  # another moment of the board
        ([(NAN, 1, NAN), (NAN, NAN, 2)], [(NAN, 1, 2)]),  # no stamps: they came in one read
        ([(5, 1, NAN), (5, 2, NAN)], [(5, 1, NAN), (5, 2, NAN)]),  # twice the same variable
        ([(5, NAN, NAN), (5, 1, NAN), (5, NAN, 2)], [(5, 1, 2)]),
    ],
)
def test_rows_of_one_moment_are_one_row(rows, expected):
    arrived = [ArrivedRow(float(i), stamp, tuple(values)) for i, (stamp, *values) in enumerate(rows)]
    found = [(row.stamp, *row.values) for row in gathered(arrived)]
    np.testing.assert_equal(found, expected)


def test_a_topic_that_is_new_later_gets_a_column_and_the_others_keep_their_samples():
    samples, parser = LiveSamples(PortSpec("mqtt://broker/#"), 4), LineParser()

    def say(at, line):
        parser.feed(line)
        event = parser.next_line()
        samples.keep([(at, event)], parser.layout)
        return samples.snapshot(LineCounts())

    for at in range(1, 5):
        before = say(at, b">a:%d\n" % at)
    after = say(5, b">b:50\n")
    assert (after.generation > before.generation, after.first, after.recording.names) == (True, 0, ("a", "b"))
    np.testing.assert_array_equal(after.recording.values, [[1, NAN], [2, NAN], [3, NAN], [4, NAN], [NAN, 50]])
    np.testing.assert_array_equal(after.recording.time, np.arange(5))
    np.testing.assert_array_equal(before.recording.values, [[1], [2], [3], [4]])
    again = say(6, b">c:600\n")  # 5 rows fit, 4 are to be kept: the first two leave
    assert (again.first, again.recording.names) == (2, ("a", "b", "c"))
    np.testing.assert_array_equal(again.recording.values[[0, -1]], [[3, NAN, NAN], [NAN, NAN, 600]])
