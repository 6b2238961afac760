"""The time among several columns that could be: a name is a hint; fill, order and resolution decide."""

import random
from datetime import datetime, timedelta
from itertools import pairwise

import pytest

from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.grammar.timestamps import TimeColumn, row_stamp_parser
from kalscope.sources.reading.columns import Column, named_column
from kalscope.sources.reading.time_columns import find_time

N = 60
START = datetime(2024, 3, 4, 9, 30)
NOISE = [f"{random.Random(i).gauss(20, 1):.3f}" for i in range(N)]
DAY_US = 86400e6


def iso(step, **change):
    return [(START + timedelta(seconds=step * i)).isoformat(" ", **change) for i in range(N)]


def stamps(pattern, step=1.0):
    return [(START + timedelta(seconds=step * i)).strftime(pattern) for i in range(N)]


def made(named):
    """Columns and rows of a table."""
    columns = [
        Column(c.name, c.unit, "channel" if any(cell.replace(".", "").isdigit() for cell in cells) else "text")
        for c, cells in ((named_column(name), cells) for name, cells in named.items())
    ]
    return columns, list(zip(*named.values(), strict=True))


def time_of(named, options=None):
    columns, rows = made(named)
    return find_time(columns, rows, ".", named=any(named), options=options or ReadOptions())


def name_of(named):
    time = time_of(named)
    return [list(named)[i] for i in time.indices] if time else []


@pytest.mark.parametrize("bad", [
    NOISE,  # goes back and forth
    ["" if i % 3 else str(i) for i in range(N)],  # half empty
    [str(i // 20) for i in range(N)],  # coarser
    ["7"] * N,  # never changes
])  # fmt: skip
@pytest.mark.parametrize("is_first", [True, False])
def test_a_full_rising_fine_column_outranks_a_better_name(bad, is_first):
    good = [f"{1551453301 + 0.02 * i:.3f}" for i in range(N)]
    named = {"t": bad, "timestamp": good, "a": NOISE}
    assert name_of(named if is_first else dict(reversed(named.items()))) == ["timestamp"]


def test_a_column_that_is_nearly_as_good_is_named():
    named = {"timestamp": iso(1), "time_ms": [str(1000 * i) for i in range(N)], "a": NOISE}
    time = time_of(named)
    assert any('"time_ms"' in note and "--time-column" in note for note in time.notes)
    assert not time_of({"timestamp": iso(1), "a": NOISE}).notes


def test_numbers_that_go_back_and_forth_are_no_time_whatever_their_name():
    slow = [f"{20 + 0.1 * (i // 10 % 3 % 2):.1f}" for i in range(N)]  # a temperature t that moves now and then
    assert name_of({"t": slow, "h": NOISE}) == []
    assert name_of({"t": NOISE, "h": NOISE[::-1]}) == []
    assert name_of({"reaction_time_ms": NOISE, "a": NOISE}) == []


@pytest.mark.slow
@pytest.mark.parametrize("date", ["%d.%m.%Y", "%Y-%m-%d", "%m/%d/%Y", "%Y%m%d", "%d-%b-%Y"])
@pytest.mark.parametrize("clock", ["%H:%M:%S", "%H.%M.%S", "%I:%M:%S %p", "%H%M%S"])
@pytest.mark.parametrize("is_date_first", [True, False])
def test_a_date_and_a_clock_beside_it_are_one_time(date, clock, is_date_first):
    named = {"Date": stamps(date, 700), "Time": stamps(clock, 700)}
    columns, rows = made({**(named if is_date_first else dict(reversed(named.items()))), "a": NOISE})
    day_first = None if date != "%m/%d/%Y" else False
    time = find_time(columns, rows, ".", named=True, options=ReadOptions(day_first=day_first))
    assert sorted(time.indices) == [0, 1]
    parse = row_stamp_parser(time, ".")
    steps = {b - a for a, b in pairwise(map(parse, rows))}
    assert steps == {700e6}


SIX = {"Year": "%Y", "Month": "%m", "Day": "%d", "Hour": "%H", "Minute": "%M", "Second": "%S"}


@pytest.mark.parametrize("parts", [
    SIX, {"YEAR": "%Y", "mon": "%m", "dd": "%d", "hr": "%H", "min": "%M"},
    {"#YY": "%y", "MM": "%m", "DD": "%d", "hh": "%H", "mm": "%M"},
    {"Year": "%Y", "Month": "%m", "Day": "%d", "Time": "%H:%M"}, {"Year": "%Y", "DOY": "%j", "HHMM": "%H%M"},
    {"year": "%Y", "day_of_year": "%j", "hour": "%H", "minute": "%M"},
])  # fmt: skip
def test_date_columns_of_any_name_are_one_time(parts):
    columns, rows = made({**{name: stamps(code, 60) for name, code in parts.items()}, "a": NOISE})
    time = find_time(columns, rows, ".", named=True)
    assert sorted(time.indices) == list(range(len(parts)))
    parse = row_stamp_parser(time, ".")
    assert [parse(row) for row in rows] == [
        ((START - datetime(1970, 1, 1)).total_seconds() + 60 * i) * 1e6 for i in range(N)
    ]


@pytest.mark.parametrize("has_day_of_year", [True, False])
def test_date_columns_without_a_header_are_known_by_their_ranges(has_day_of_year):
    codes = ["%Y", *(["%j"] if has_day_of_year else []), "%m", "%d", "%H", "%M"]
    columns = [Column("") for _ in (*codes, 0)]
    rows = list(zip(*(stamps(code, 60) for code in codes), NOISE, strict=True))
    time = find_time(columns, rows, ".", named=False)
    parse = row_stamp_parser(time, ".")
    assert sorted(time.indices) == list(range(len(codes)))
    assert parse(rows[5]) - parse(rows[0]) == 300e6


@pytest.mark.parametrize(("names", "codes", "step"), [
    ("sec msec", (lambda t: t // 1000, lambda t: t % 1000), 40),
    ("secs nsecs", (lambda t: t // 1000, lambda t: t % 1000 * 10**6), 40e6),
    ("week tow_ms", (lambda t: t // 604_800_000, lambda t: t % 604_800_000), 40),
])  # fmt: skip
def test_a_column_that_counts_the_turns_of_the_next_is_taken_with_it(names, codes, step):
    cells = ([str(code(1_709_769_599_000 + 40 * i)) for i in range(N)] for code in codes)
    columns, rows = made({**dict(zip(names.split(), cells, strict=True)), "a": NOISE})
    time = find_time(columns, rows, ".", named=True)
    assert time.indices == (0, 1)
    read = [row_stamp_parser(time, ".")(row) for row in rows]
    assert [b - a for a, b in pairwise(read)] == pytest.approx([step] * (N - 1), abs=256)


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


def test_a_time_format_finds_its_column_and_says_where_it_fits_none():
    named = {"when": stamps("%H-%M-%S"), "time": stamps("%d.%m.%Y"), "a": NOISE}
    assert time_of(named, ReadOptions(time_format="%H-%M-%S")).index == 0
    with pytest.raises(BadSetting, match=r"time_format must fit.*%j"):
        time_of(named, ReadOptions(time_format="%j:%H"))
    columns, rows = made(named)
    with pytest.raises(BadSetting, match=r"time_format must fit.*04\.03\.2024"):
        find_time(columns, rows, ".", named=True, choice="time", options=ReadOptions(time_format="%H:%M"))


def test_stamps_since_1970_need_no_name():
    def is_time(stamps):
        return name_of({"x": [str(stamp) for stamp in stamps], "a": NOISE}) == ["x"]

    assert is_time(1551453301000 + 20 * i for i in range(N))
    assert is_time(1551453301000 + 80 * (i // 4) for i in range(N))
    assert is_time(1551453301000 + 20 * (i - i % 10 + 9 - i % 10) for i in range(N))  # pages
    assert not is_time(15000 + 20 * i for i in range(N))
    assert not is_time(1551453301000 + 80 * (i // N) for i in range(N))


@pytest.mark.parametrize("count", [100, 599, 601, 2000])
def test_a_counter_without_a_name_is_no_time_however_many_rows_are_weighed(count):
    columns, noise = [Column(""), Column("")], (NOISE * count)[:count]
    rising = [[str(500 + step * i) for i in range(count)] for step in (1, 20)]
    found = [find_time(columns, list(zip(cells, noise, strict=True)), ".", named=False) for cells in rising]
    assert found == [None, TimeColumn(0, "number")]


def test_digits_with_a_unit_beside_a_date_are_no_clock():
    days, counted = ["2024-03-04"] * N, [str(100 + i) for i in range(N)]
    assert all(int(cell) % 100 < 60 for cell in counted)
    time = time_of({"date": days, "time_ms": counted, "x": NOISE})
    assert (time.indices, time.unit) == ((1,), "ms")
    assert set(time_of({"date": days, "time": counted, "x": NOISE}).indices) == {0, 1}
