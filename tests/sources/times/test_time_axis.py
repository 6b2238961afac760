import numpy as np
import pytest
from each import each

from kalscope.sources.grammar.timestamps import TimeColumn, row_stamp_parser
from kalscope.sources.reading.axis import GivenPeriod, counted_time, read_time, unwrap

NUMBER = TimeColumn(0, "number", "ms")


@each(("size", "name"), [(2**16, "16-bit"), (2**32, "32-bit")])
@each("step", [1, 10, 997])
def test_a_counter_that_wraps_is_counted_on_and_said(size, name, step):
    true = size - 5 * step + step * np.arange(60.0)
    axis = read_time(true % size, NUMBER)
    np.testing.assert_allclose(np.diff(axis.time), step / 1000, rtol=1e-6)
    assert axis.backward == 0
    assert any("wrap once" in note and name in note for note in axis.notes)


def test_every_wrap_of_a_long_recording_is_undone():
    true = 50.0 * np.arange(20_000)
    np.testing.assert_array_equal(unwrap(true % 2**16)[0], true)


@each(
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
    assert any("the stamps are uneven" in note for note in axis.notes)


@each("step", [1e-320, 1e60])
def test_stamps_too_fine_or_too_coarse_for_a_rate_are_no_time(step):
    stamps, column = step * np.arange(60.0), TimeColumn(0, "number", "s")
    axis = read_time(stamps, column)
    assert (axis.timing.period, axis.time.tolist()) == (None, list(range(60)))
    assert any(note.endswith("which is not a time: the samples were counted") for note in axis.notes)
    assert read_time(stamps, column, given=GivenPeriod(0.5)).timing.period == 0.5


def test_the_advice_says_how_many_rows_it_would_add():
    short, long = np.arange(100) * 10.0, np.concatenate((np.arange(50), 10_000 + np.arange(50))) * 10.0
    short[50:] += 30.0
    assert "adds 3 rows of missing samples" in " ".join(read_time(short, NUMBER).notes)
    said = " ".join(read_time(long, NUMBER).notes)
    assert "read it with --gaps dt (elapsed time): --gaps missing would add 9\u202f950 rows" in said
    assert "read it with" not in " ".join(read_time(short, NUMBER, gaps="dt").notes)


WHOLE_SECONDS = np.floor(np.arange(7000) / 67) * 1000


def test_a_coarse_clock_has_neither_gaps_nor_repeated_samples():
    axis = read_time(WHOLE_SECONDS, NUMBER)
    assert axis.timing.period == pytest.approx(1 / 67, rel=1e-3)
    assert (axis.timing.stamps, axis.timing.resolution, axis.timing.pauses) == ("coarse", 1.0, 0)
    assert not any("repeat" in note or "gap" in note for note in axis.notes)
    assert axis.notes[-1].startswith("the clock has a resolution of 1 s: samples were placed evenly between its")
    assert "67.0 Hz" in axis.notes[-1]


UNSTEADY = np.cumsum(np.random.default_rng(1).pareto(1.1, 400) * 10 + 2)
"""Stamps in ms without a scale at which they come steadily: median step 10 ms, mean step 90 ms."""


@each(
    ("stamps", "given", "source", "rate", "said"),
    [
        (WHOLE_SECONDS, GivenPeriod(file=1 / 66.5), "file", 66.5, "the one that the file gives, 66.5 Hz"),
        (WHOLE_SECONDS, GivenPeriod(file=1 / 33), "stamps", 67, "gives a sample rate of 33.0 Hz, but its stamps"),
        (WHOLE_SECONDS, GivenPeriod(0.015, 1 / 66.5), "option", 1 / 0.015, "the clock has a resolution of 1 s"),
        (np.arange(500) * 10.0, GivenPeriod(file=0.0101), "stamps", 100, "stamps are read as ms"),
        (np.arange(500) * 10.0, GivenPeriod(file=0.02), "stamps", 100, "gives a sample rate of 50.0 Hz, but its"),
        (np.arange(500) * 10.0, GivenPeriod(option=0.02), "option", 50, "stamps are read as ms"),
        (np.full(50, 7000.0), GivenPeriod(file=0.02), "file", 50, "stamps are read as ms"),
        (UNSTEADY, GivenPeriod(file=0.03), "file", 1 / 0.03, "the one that the file gives, 33.3 Hz"),
        (UNSTEADY, GivenPeriod(file=0.001), "stamps", 99.1, "gives a sample rate of 1.00 kHz, but its stamps"),
        (UNSTEADY, GivenPeriod(file=5.0), "stamps", 99.1, "gives a sample rate of 0.200 Hz, but its stamps"),
        (np.array([0.0, 0, 0, 1000, 1000]), GivenPeriod(file=0.34), "file", 1 / 0.34, "the file gives, 2.94 Hz"),
    ],
)
def test_a_rate_that_is_given_has_its_place(stamps, given, source, rate, said):
    axis = read_time(stamps, NUMBER, given=given)
    assert axis.timing.source == source
    assert axis.timing.period == pytest.approx(1 / rate, rel=1e-3)
    assert any(said in note for note in axis.notes)


def test_samples_without_stamps_are_counted_in_the_period_that_is_given():
    assert counted_time(4, GivenPeriod()).time.tolist() == [0, 1, 2, 3]
    axis = counted_time(4, GivenPeriod(file=0.5), offset=-1.0, start=1.5e9)
    assert axis.time.tolist() == [-1, -0.5, 0, 0.5]
    assert (axis.timing.source, axis.timing.summary) == ("file", "2.00 Hz as stated in the file")
    assert axis.notes == ("time counts from 2017-07-14T02:40:00+00:00",)


@each(
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
