import numpy as np
import pytest

from kalscope.sources.grammar.stamps.clocks import parse_clock
from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.times.seconds import to_seconds, unit_by_magnitude


def test_a_clock_goes_on_over_midnight():
    stamps = np.array([parse_clock("23:59:59"), parse_clock("00:00:00"), parse_clock("00:00:01")])
    assert to_seconds(stamps, TimeColumn(0, "clock"))[0].tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("stamps", "unit"),
    [
        ([0, 1, 2], "s"),
        ([0.0, 8.5, 17.1], "s"),
        ([0, 60, 120], "s"),
        ([0, 10, 20], "ms"),
        ([0, 10000, 20011], "us"),
        ([584065454762638, 584065474483599], "ns"),
        ([1.7e9, 1.7e9 + 1], "s"),
        ([1.7e12, 1.7e12 + 10], "ms"),
        ([1.7e15, 1.7e15 + 10000], "us"),
        ([1.7e18, 1.7e18 + 1e7], "ns"),
        ([1.2e9, 1.2e9 + 4000], "us"),
    ],
)
def test_the_unit_follows_from_the_size_of_stamp_and_step(stamps, unit):
    assert unit_by_magnitude(np.array(stamps, dtype=float)) == unit
