import numpy as np
import pytest

from kalscope.sources.grammar.timestamps import TimeColumn, row_stamp_parser
from kalscope.sources.times.time_axis import read_time, unwrap

NUMBER = TimeColumn(0, "number", "ms")


@pytest.mark.parametrize(("size", "name"), [(2**16, "16-bit"), (2**32, "32-bit")])
@pytest.mark.parametrize("step", [1, 10, 997])
def test_a_counter_that_wraps_is_counted_on_and_said(size, name, step):
    true = size - 5 * step + step * np.arange(60.0)
    axis = read_time(true % size, NUMBER)
    np.testing.assert_allclose(np.diff(axis.time), step / 1000, rtol=1e-6)
    assert axis.backward == 0
    assert any("wrap once" in note and name in note for note in axis.notes)


def test_every_wrap_of_a_long_recording_is_undone():
    true = 50.0 * np.arange(20_000)
    np.testing.assert_array_equal(unwrap(true % 2**16)[0], true)


@pytest.mark.parametrize(
    "stamps",
    [
        [0, 10, 20, 30, 0, 10, 20],  # the device restarted
        [40_000, 40_010, 40_020, 0, 10, 20],
        [65_520, 65_530, 65_525, 65_535],  # out of order
        [65_530.5, 65_535.5, 4.5, 9.5],  # no counter has fractions
        [-10, 65_530, 4],
    ],
)
def test_other_steps_back_stay_steps_back(stamps):
    stamps = np.array(stamps, dtype=float)
    axis = read_time(stamps, NUMBER)
    np.testing.assert_array_equal(axis.time, stamps / 1000)
    assert axis.backward == np.count_nonzero(np.diff(stamps) < 0)
    assert any("time steps back" in note for note in axis.notes)


def test_a_clock_says_that_it_passed_midnight():
    hours = np.array([22.0, 23.0, 0.0, 1.0, 23.0, 0.5]) * 3600e6
    axis = read_time(hours, TimeColumn(0, "clock"))
    assert (axis.time / 3600).tolist() == [0, 1, 2, 3, 25, 26.5]
    assert any("passes midnight 2 times" in note for note in axis.notes)


def test_samples_that_were_written_twice_are_counted_and_named():
    stamps = np.sort(np.concatenate((np.arange(100.0), [1.0, 50.0, 51.0]))) * 10
    axis = read_time(stamps, NUMBER)
    np.testing.assert_array_equal(axis.time, stamps / 1000)
    assert any("3 samples repeat an earlier stamp, first at sample 3" in note for note in axis.notes)


def test_jitter_is_said_only_where_there_is_some():
    rng = np.random.default_rng(1)
    even, uneven = np.arange(500) * 10.0, np.cumsum(rng.uniform(8, 12, 500))
    assert read_time(even, NUMBER).timing.notes == ()
    axis = read_time(uneven, NUMBER)
    assert axis.timing.period == pytest.approx(0.01, rel=0.05)
    assert any("nine of ten steps lie between 0.0082" in note for note in axis.notes)


def test_gaps_are_counted_and_the_choice_is_named():
    stamps = np.concatenate((np.arange(50), 70 + np.arange(50), 500 + np.arange(50))) * 10.0
    notes = " ".join(read_time(stamps, NUMBER).notes)
    assert "2 gaps, first after sample 50, the longest 3.81 s" in notes
    assert "--gaps missing" in notes


def test_a_given_unit_outranks_the_columns():
    assert read_time(np.arange(5.0), TimeColumn(0, "number", "s"), "ms").timing.period == 0.001


@pytest.mark.parametrize(
    ("cells", "seconds"),
    [
        (("1970", "1", "0"), 0.0),
        (("1970", "2", "130"), 86400 + 5400.0),
        (("1972", "366", "2400"), 3 * 365 * 86400 + 86400.0),
        (("1970", "1", "60"), None),
        (("1970", "0", "0"), None),
        (("170", "1", "0"), None),
        (("1970", "1.5", "0"), None),
    ],
)
def test_year_day_and_clock_make_a_stamp(cells, seconds):
    column = TimeColumn(0, "calendar", clock="hhmm", parts=(("year", 0), ("day of year", 1), ("clock", 2)))
    assert row_stamp_parser(column, ".")(cells) == (None if seconds is None else seconds * 1e6)
