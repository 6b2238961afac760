"""Samples of a stream: kept in order, timed truly after every pause, whatever the board's counter does."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.sources.grammar.timestamps import TimeColumn
from kalscope.sources.live.lines import LineCounts
from kalscope.sources.live.samples import ArrivedRow, LiveSamples, LiveTime, SampleStore
from kalscope.sources.port.registry import PortSpec
from kalscope.sources.reading.line_parser import LineParser

NAN = math.nan
MS = TimeColumn(0, "number", "ms")


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


def numbered(begin, end):
    numbers = np.arange(begin, end, dtype=float)
    return numbers / 10, np.column_stack([numbers, -numbers])


@pytest.mark.slow
@given(st.integers(1, 50), st.lists(st.integers(0, 60), max_size=20))
def test_the_last_samples_are_kept_in_order_and_views_never_change(keep, pieces):
    store, came, views = SampleStore(2, keep), 0, []
    for count in pieces:
        store.append(*(part.tolist() for part in numbered(came, came + count)))
        came += count
        assert store.end == came
        assert min(keep, came) <= len(store) <= keep + max(keep // 4, 1)
        views.append((store.views(), numbered(store.first, came)))
    for found, expected in views:
        for view, numbers in zip(found, expected, strict=True):
            np.testing.assert_array_equal(view, numbers)
            assert not view.flags.writeable


def rows(hosts, stamps):
    return [ArrivedRow(*row, (float(i),)) for i, row in enumerate(zip(hosts, stamps, strict=True))]


def times_of(clock, hosts, stamps):
    return np.array(clock.place(rows(hosts, stamps))[0])


@pytest.mark.parametrize(("unit", "scale"), [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)])
@pytest.mark.parametrize("is_named", [True, False])
def test_stamps_are_the_time_and_a_unit_without_name_is_found_by_the_clock_of_the_host(unit, scale, is_named):
    true = np.arange(200) * 0.01
    for speed in (1.0, 12.0):
        clock = LiveTime(TimeColumn(0, "number", unit if is_named else ""))
        time = times_of(clock, (7 + true / speed).tolist(), (true / scale).tolist())
        np.testing.assert_allclose(time, true, atol=1e-9)


TICKS = np.arange(100) * 0.01
DAMAGED = np.arange(20) * 10.0
DAMAGED[[7, 13]] = 99_999_999.0, 20.0
LATE = TICKS + 0.004 * (np.arange(100) % 3)
CLOCKS = {  # the column, when the rows arrived, s, their stamps, and the right times
    "stamps that stand still are no time": (TimeColumn(0, "number", ""), TICKS, [3.0] * 100, TICKS),
    "a counter that wraps": (MS, LATE, np.mod(TICKS * 1000 + 2.0**32 - 500, 2.0**32), TICKS),
    "a clock at midnight": (TimeColumn(0, "clock"), LATE, np.mod(86399.5e6 + 1e6 * TICKS, 86400e6), TICKS),
    "damaged stamps": (MS, TICKS[:20], DAMAGED, TICKS[:20]),
    "a board that restarts": (
        *(MS, [0, 0.01, 1.62, 1.634, 1.64, 1.65], [50_000.0, 50_010, 3, 13, 23, 33]),
        [0, 0.01, 1.62, 1.634, 1.644, 1.654],
    ),
}


@pytest.mark.parametrize("name", CLOCKS)
def test_a_clock_goes_on_by_the_time_that_has_passed(name):
    column, hosts, stamps, expected = CLOCKS[name]
    time = times_of(LiveTime(column), list(hosts), list(stamps))
    np.testing.assert_allclose(time, expected, atol=0.02 if name == "damaged stamps" else 1e-6)
    assert (np.diff(time) >= 0).all()


@pytest.mark.parametrize("column", [None, MS])
@pytest.mark.parametrize("restarted", [False, True])
def test_after_an_interruption_time_jumps_by_the_true_pause_and_one_row_is_missing(column, restarted):
    clock = LiveTime(column)
    times_of(clock, [0.0, 0.01, 0.02], [70_000.0, 70_010.0, 70_020.0])
    clock.interrupt()
    start = 80_000.0 if restarted else 130_020.0
    time, values = clock.place(rows([60.02, 60.03], [start, start + 10]))
    np.testing.assert_allclose(time, [0.03, 60.02, 60.03], atol=1e-6)
    assert math.isnan(values[0][0])
    assert values[1:] == [(0.0,), (1.0,)]
    assert clock.period == pytest.approx(0.01)
