"""The time among several columns that could be: a name is a hint; fill, order and resolution decide."""

import random
from datetime import datetime, timedelta

import pytest

from kalscope.errors import BadSetting
from kalscope.sources.grammar.timestamps import TimeColumn, row_stamp_parser

N = 60
START = datetime(2024, 3, 4, 9, 30)
NOISE = [f"{random.Random(i).gauss(20, 1):.3f}" for i in range(N)]
DAY_US = 86400e6


def stamps(pattern, step=1.0):
    return [(START + timedelta(seconds=step * i)).strftime(pattern) for i in range(N)]


@pytest.fixture
def times(read):
    """The recording of a table with these columns; where the first has no name, none is written."""

    def read_table(named, **options):
        header = ";".join(named) + "\n" if next(iter(named)) else ""
        return read(header + "".join(";".join(row) + "\n" for row in zip(*named.values(), strict=True)), **options)

    return read_table


@pytest.mark.parametrize("bad", [
    NOISE,  # goes back and forth
    ["" if i % 3 else str(i) for i in range(N)],  # half empty
    [str(i // 20) for i in range(N)],  # coarser
    ["7"] * N,  # never changes
])  # fmt: skip
@pytest.mark.parametrize("is_first", [True, False])
def test_a_full_rising_fine_column_outranks_a_better_name(times, bad, is_first):
    named = {"t": bad, "timestamp": [f"{1551453301 + 0.02 * i:.3f}" for i in range(N)], "a": NOISE}
    recording = times(named if is_first else dict(reversed(named.items())))
    assert (set(recording.names), recording.sample_period) == ({"t", "a"}, pytest.approx(0.02))


def test_a_column_that_is_nearly_as_good_is_named(times):
    named = {"timestamp": stamps("%Y-%m-%d %H:%M:%S"), "time_ms": [str(1000 * i) for i in range(N)], "a": NOISE}
    assert any('"time_ms"' in note and "--time-column" in note for note in times(named).report.notes)
    del named["time_ms"]
    assert not any("--time-column" in note for note in times(named).report.notes)


def test_numbers_that_go_back_and_forth_are_no_time_whatever_their_name(times):
    slow = [f"{20 + 0.1 * (i // 10 % 3 % 2):.1f}" for i in range(N)]  # a temperature t that moves now and then
    for named in ({"t": slow, "h": NOISE}, {"t": NOISE, "h": NOISE[::-1]}, {"reaction_time_ms": NOISE, "a": NOISE}):
        assert times(named).names == tuple(named)


@pytest.mark.slow
@pytest.mark.parametrize("date", ["%d.%m.%Y", "%Y-%m-%d", "%m/%d/%Y", "%Y%m%d", "%d-%b-%Y"])
@pytest.mark.parametrize("clock", ["%H:%M:%S", "%H.%M.%S", "%I:%M:%S %p", "%H%M%S"])
def test_a_date_and_a_clock_beside_it_are_one_time(times, date, clock):
    columns = {"Date": stamps(date, 700), "Time": stamps(clock, 700)}
    for named in (columns, dict(reversed(columns.items()))):
        recording = times({**named, "a": NOISE}, day_first=None if date != "%m/%d/%Y" else False)
        assert (recording.names, recording.sample_period) == (("a",), 700.0)


PARTS = {
    "in words": {"Year": "%Y", "Month": "%m", "Day": "%d", "Hour": "%H", "Minute": "%M", "Second": "%S"},
    "in short words": {"YEAR": "%Y", "mon": "%m", "dd": "%d", "hr": "%H", "min": "%M"},
    "in letters": {"#YY": "%y", "MM": "%m", "DD": "%d", "hh": "%H", "mm": "%M"},
    "with a clock": {"Year": "%Y", "Month": "%m", "Day": "%d", "Time": "%H:%M"},
    "with a day of the year": {"Year": "%Y", "DOY": "%j", "HHMM": "%H%M"},
    "with a day of the year in words": {"year": "%Y", "day_of_year": "%j", "hour": "%H", "minute": "%M"},
    "by their ranges": {"": "%Y", "m": "%m", "d": "%d", "H": "%H", "M": "%M"},
    "by their ranges, with a day of the year": {"": "%Y", "j": "%j", "m": "%m", "d": "%d", "H": "%H", "M": "%M"},
}  # fmt: skip


@pytest.mark.parametrize("name", PARTS)
def test_date_columns_are_one_time(times, name):
    recording = times({**{name: stamps(code, 60) for name, code in PARTS[name].items()}, "a": NOISE})
    assert (len(recording.names), recording.sample_period) == (1, 60.0)
    assert any("2024-03-04T09:30:00" in note for note in recording.report.notes)


@pytest.mark.parametrize(("names", "turn", "scale"), [
    ("sec msec", 1000, 1), ("secs nsecs", 1000, 10**6), ("week tow_ms", 604_800_000, 1),
])  # fmt: skip
def test_a_column_that_counts_the_turns_of_the_next_is_taken_with_it(times, names, turn, scale):
    at = [1_709_769_599_000 + 40 * i for i in range(N)]
    cells = [str(ms // turn) for ms in at], [str(ms % turn * scale) for ms in at]
    recording = times({**dict(zip(names.split(), cells, strict=True)), "a": NOISE})
    assert (recording.names, recording.sample_period) == (("a",), pytest.approx(0.04))


def test_a_damaged_part_is_no_stamp():
    parts = (("year", 0), ("month", 1), ("day", 2), ("hour", 3), ("minute", 4), ("second", 5))
    parse = row_stamp_parser(TimeColumn(0, "calendar", parts=parts), ".")
    row = ["1970", "1", "2", "0", "0", "1.25"]
    assert parse(row) == DAY_US + 1.25e6
    by_day = TimeColumn(0, "calendar", clock="hhmm", parts=(("year", 0), ("day of year", 1), ("clock", 2)))
    read = row_stamp_parser(by_day, ".")
    assert read(["1972", "366", "2400"]) == 3 * 365 * DAY_US + DAY_US
    for bad in (["1970", "1", "60"], ["1970", "0", "0"], ["170", "1", "0"], ["1970", "1.5", "0"]):
        assert read(bad) is None
    for i, bad in enumerate(["19x0", "13", "32", "25", "60", "nan"]):
        assert parse([*row[:i], bad, *row[i + 1 :]]) is None
        assert parse([*row[:i], "", *row[i + 1 :]]) is None


def test_a_time_format_finds_its_column_and_says_where_it_fits_none(times):
    named = {"when": stamps("%H-%M-%S"), "time": stamps("%d.%m.%Y"), "a": NOISE}
    assert times(named, time_format="%H-%M-%S").sample_period == 1.0
    for options, said in (
        ({"time_format": "%j:%H"}, "%j"),
        ({"time_format": "%H:%M", "time_column": "time"}, "04.03"),
    ):
        with pytest.raises(BadSetting, match=rf"time_format must fit.*{said}"):
            times(named, **options)


@pytest.mark.parametrize(("cell", "is_time"), [
    (lambda i: 1551453301000 + 20 * i, True), (lambda i: 1551453301000 + 80 * (i // 4), True),
    (lambda i: 1551453301000 + 20 * (i - i % 10 + 9 - i % 10), True),  # pages
    (lambda i: 15000 + 20 * i, False), (lambda i: 1551453301000 + 80 * (i // N), False),
])  # fmt: skip
def test_stamps_since_1970_need_no_name(times, cell, is_time):
    assert times({"x": [str(cell(i)) for i in range(N)], "a": NOISE}).names == (("a",) if is_time else ("x", "a"))


@pytest.mark.slow
@pytest.mark.parametrize("count", [100, 599, 601, 2000])
def test_a_counter_without_a_name_is_no_time_however_many_rows_are_weighed(times, count):
    for step, names in ((1, ("value 1", "value 2")), (20, ("value 1",))):
        named = {"": [str(500 + step * i) for i in range(count)], " ": (NOISE * count)[:count]}
        assert times(named).names == names


def test_digits_with_a_unit_beside_a_date_are_no_clock(times):
    days, counted = ["2024-03-04"] * N, [str(100 + i) for i in range(N)]
    assert times({"date": days, "time_ms": counted, "x": NOISE}).sample_period == 0.001
    assert times({"date": days, "time": counted, "x": NOISE}).sample_period == 60.0
    assert times({"date": days, "time": [str(i) for i in range(N)], "x": NOISE}).sample_period == 1.0
