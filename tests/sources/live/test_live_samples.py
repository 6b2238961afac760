"""Variables that come together are one sample of several channels."""

import math

import numpy as np
from each import each

from kalscope.sources.live.live_samples import gathered
from kalscope.sources.live.sample_times import ArrivedRow

NAN = math.nan


@each(
    ("rows", "expected"),
    [
        ([], []),
        ([(5, 1, NAN), (5, NAN, 2)], [(5, 1, 2)]),
        ([(5, 1, NAN), (6, NAN, 2)], [(5, 1, NAN), (6, NAN, 2)]),  # another moment of the board
        ([(NAN, 1, NAN), (NAN, NAN, 2)], [(NAN, 1, 2)]),  # no stamps: they came in one read
        ([(5, 1, NAN), (5, 2, NAN)], [(5, 1, NAN), (5, 2, NAN)]),  # twice the same variable
        ([(5, 1, NAN), (NAN, NAN, 2)], [(5, 1, NAN), (NAN, NAN, 2)]),
        ([(5, NAN, NAN), (5, 1, NAN), (5, NAN, 2)], [(5, 1, 2)]),
    ],
)
def test_rows_of_one_moment_are_one_row(rows, expected):
    arrived = [ArrivedRow(float(i), stamp, tuple(values)) for i, (stamp, *values) in enumerate(rows)]
    found = [(row.stamp, *row.values) for row in gathered(arrived)]
    np.testing.assert_equal(found, expected)
