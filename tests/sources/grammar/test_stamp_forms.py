"""Which form a column of stamps is in, decided once for the whole column."""

from datetime import datetime, timedelta

import pytest
from each import each
from hypothesis import given
from hypothesis import strategies as st

from kalscope.errors import BadSetting
from kalscope.sources.grammar.read_options import ReadOptions
from kalscope.sources.grammar.timestamps import TimeName, find_stamp_form, stamp_parser

TIME, DATE = TimeName(2), TimeName(2, is_date=True)
START = datetime(2024, 3, 13, 9, 30)


def found(cells, hints=TIME, decimal="."):
    form = find_stamp_form(cells, decimal, hints)
    return form and (form.kind, form.order, form.clock, form.odd)


def days(order, count=11, step=1, start=datetime(2024, 1, 1)):
    pattern = {"dmy": "%d/%m/%Y", "mdy": "%m/%d/%Y"}[order]
    return [(start + timedelta(days=step * i)).strftime(pattern) for i in range(count)]


@each(
    ("cells", "form"),
    [
        (["0.5", "1", "1.5e3"], ("number", "ymd", "h:m:s", "")),
        (["12:00", "12:01"], ("clock", "ymd", "h:m:s", "")),
        (["56:36.147", "56:36.148"], ("clock", "ymd", "min:s", "")),
        (["09:59", "59:59"], ("clock", "ymd", "min:s", "")),
        (["23:59:59", "24:00:00", "125:03:11"], ("clock", "ymd", "elapsed", "")),
        (["0:00:01", "1 day, 0:00:01"], ("clock", "ymd", "elapsed", "")),
        (["2024-03-13 09:30", "2024-03-13 09:31"], ("calendar", "ymd", "h:m:s", "")),
        (["20240313_093000", "20240313_093001"], ("calendar", "ymd", "h:m:s", "")),
        (["20240313093000", "20240313093001"], ("calendar", "ymd", "h:m:s", "")),
        (["10/14/2018 00:01"], ("calendar", "mdy", "h:m:s", "")),
        (["14/10/2018"], ("calendar", "dmy", "h:m:s", "")),
        (["13th of March 2024 9:30 pm", "13th of March 2024 9:31 pm"], ("calendar", "dmy", "h:m:s", "")),
        (["hello", "world 3"], None),
        ([], None),
        (["", "nan"], None),
    ],
)
def test_the_form_that_fits_most_cells_is_found(cells, form):
    assert found(cells) == form


def test_eight_digits_and_day_numbers_are_dates_only_where_the_name_allows():
    assert found(["19580329"], DATE) == ("calendar", "ymd", "h:m:s", "")
    assert found(["19580329"]) == ("number", "ymd", "h:m:s", "")
    assert find_stamp_form(["45123,5"], ",", DATE).unit == "day"
    assert find_stamp_form(["45123,5"], ",", TIME).unit == ""


def test_a_day_above_twelve_anywhere_decides():
    for order, cell in (("dmy", "13/03/2024"), ("mdy", "03/13/2024")):
        cells = ["03/04/2024"] * 500 + [cell] + ["05/04/2024"] * 500
        assert found(cells)[1] == order


@each("order", ["dmy", "mdy"])
@each(("step", "count"), [(1, 12), (2, 6), (3, 4)])
def test_even_steps_decide_where_no_day_is_above_twelve(order, step, count):
    cells = days(order, count, step)
    assert all(int(part) <= 12 for cell in cells for part in cell.split("/")[:2])
    form = find_stamp_form(cells, ".", TIME)
    assert (form.order, form.notes) == (order, ())


def test_where_nothing_decides_the_day_comes_first_and_the_note_names_the_option():
    cells = [f"03/04/2024 12:00:{i:02}" for i in range(60)]
    form = find_stamp_form(cells, ".", TIME)
    assert form.order == "dmy"
    assert "--month-first" in form.notes[0]
    assert not find_stamp_form([cell.replace("03/04", "04/04") for cell in cells], ".", TIME).notes


@pytest.mark.parametrize("order", ["dmy", "mdy"])
def test_of_runs_far_apart_the_shorter_log_is_likelier_and_the_note_stays(order):
    cells = [f"{day} 10:00:{i:02}" for day in days(order, 3, 3, datetime(2024, 4, 5)) for i in range(30)]
    form = find_stamp_form(cells, ".", TIME)
    assert form.order == order
    assert "could also be" in "".join(form.notes)


@pytest.mark.parametrize(("day_first", "order"), [(True, "dmy"), (False, "mdy")])
def test_the_user_decides_the_order(day_first, order):
    form = find_stamp_form(["03/04/2024"], ".", TimeName(), ReadOptions(day_first=day_first))
    assert (form.order, form.notes) == (order, ())
    assert find_stamp_form(["2024-03-04"], ".", TimeName(), ReadOptions(day_first=day_first)).order == "ymd"


@pytest.mark.slow
@given(
    damaged=st.lists(st.integers(10, 99), max_size=9, unique=True),
    order=st.sampled_from(["dmy", "mdy"]),
)
def test_damaged_cells_change_nothing(damaged, order):
    cells = days(order, 100, 1, START)
    for i in damaged:
        cells[i] = cells[i][:-1] + "x"
    assert found(cells, TimeName())[1] == order


def test_a_format_of_the_user_is_the_form():
    options = ReadOptions(time_format="%H-%M-%S.%f")
    form = find_stamp_form(["01-00-00.5", "01-00-01.5"], ".", TimeName(), options)
    assert (form.kind, form.odd) == ("clock", "%H-%M-%S.%f")
    assert stamp_parser(form, ".")("01-00-00.5") == 3600.5e6
    form = find_stamp_form(["2024|073"], ".", TimeName(), ReadOptions(time_format="%Y|%j"))
    assert form.kind == "calendar"
    assert stamp_parser(form, ".")("1970|002") == 86400e6
    assert find_stamp_form(["12:00"], ".", TimeName(), ReadOptions(time_format="%d.%m.%Y")) is None


@each("form", ["%Q", "abc", "", "%H:%M:%M", "%c %Y"])
def test_a_format_that_is_none_is_refused(form):
    with pytest.raises(BadSetting, match="time_format must"):
        find_stamp_form(["12:00"], ".", TimeName(), ReadOptions(time_format=form))


NAMED = TimeName(is_date=True)  # MESS_DATUM


@each("pattern", ["%Y%m%d%H", "%Y%m%d%H%M", "%Y%m%d%H%M%S"])
@each("hints", [NAMED, TIME])
@each(("start", "count"), [(datetime(1893, 1, 1, 20), 60), (datetime(2024, 2, 28, 22), 5)])
def test_digits_of_a_date_and_a_clock(pattern, hints, start, count):
    stamps = [start + timedelta(hours=i) for i in range(count)]
    cells = [stamp.strftime(pattern) for stamp in stamps]
    form = find_stamp_form(cells, ".", hints)
    assert form.kind == "calendar"
    read = [stamp_parser(form, ".")(cell) for cell in cells]
    assert read == [(stamp - datetime(1970, 1, 1)).total_seconds() * 1e6 for stamp in stamps]


@each("start", [1_700_000_000, 1_801_010_100, 2_024_010_100, 1_999_123_100])
@each("step", [1, 7, 60])
def test_seconds_since_1970_are_no_date_of_ten_digits(start, step):
    cells = [str(start + step * i) for i in range(60)]
    assert found(cells, NAMED)[0] == "number"
    assert found(cells, DATE)[0] == "number"


@pytest.mark.parametrize(("order", "pattern"), [("ymd", "%y%m%d"), ("dmy", "%d%m%y"), ("mdy", "%m%d%y")])
def test_dates_of_six_digits_under_the_name_of_a_date(order, pattern):
    times = [datetime(2024, 2, 20) + timedelta(days=i) for i in range(20)]
    cells = [time.strftime(pattern) for time in times]
    form = find_stamp_form(cells, ".", NAMED)
    assert (form.kind, form.order) == ("calendar", order)
    assert stamp_parser(form, ".")(cells[-1]) == (times[-1] - datetime(1970, 1, 1)).total_seconds() * 1e6
    assert found(cells) == ("number", "ymd", "h:m:s", "")  # a timestamp may count so
    assert found([str(100_000 + 7 * i) for i in range(50)], NAMED)[0] == "number"
