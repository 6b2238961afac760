import pytest
from each import each

from kalscope import read_recording
from kalscope.sources.reading.columns import distinct_names, named_column
from kalscope.sources.reading.sniffer import sniff


def _head(names, delimiter, decimal, n=12):
    rows = [[f"{0.25 * i:.2f}", f"{20 + 0.5 * i:.1f}"] for i in range(n)]
    lines = [delimiter.join(cell.replace(".", decimal) for cell in row) for row in rows]
    return ([delimiter.join(names)] if names else []) + lines


@each(("delimiter", "decimal"), [(d, m) for d in ",;\t| " for m in ".," if d != m])
@each("names", [("t", "temp"), ()])
def test_delimiter_decimal_mark_and_header_are_found(delimiter, decimal, names):
    layout = sniff(_head(names, delimiter, decimal))
    assert layout is not None
    assert (layout.form.delimiter, layout.form.decimal) == (delimiter, decimal)
    assert layout.headers == (frozenset({1}) if names else frozenset())
    assert layout.time is not None
    assert layout.time.index == 0
    assert [column.name for column in layout.columns if column.role == "channel"] == (
        ["temp"] if names else ["value 1"]
    )


def test_one_column_of_decimal_commas_is_known_by_its_header():
    layout = sniff(["temp", "20,5", "20,7", "21,0"])
    assert layout is not None
    assert (layout.form.decimal, len(layout.columns)) == (",", 1)


@each(
    ("text", "name", "unit"),
    [
        ("accel (m/s^2)", "accel", "m/s^2"),
        ("t [us]", "t", "us"),
        ("gX [°/s]", "gX", "°/s"),
        ("Distance_cm", "Distance_cm", "cm"),
        ("CO(GT)", "CO(GT)", ""),
        ("a_x", "a_x", ""),
        ("plain", "plain", ""),
        ("Pressure in hPa", "Pressure", "hPa"),
        ("Temp, °C (LGR S/N: 10229, SEN S/N: 10229)", "Temp", "°C"),
        ("Coupler (LGR S/N: 10229)", "Coupler (LGR S/N: 10229)", ""),
        ("spin in place", "spin in place", ""),
    ],
)
def test_a_unit_stands_in_brackets_or_as_a_clear_suffix(text, name, unit):
    column = named_column(text)
    assert (column.name, column.unit) == (name, unit)


@each(
    ("header", "unit"),
    [
        ("time_ms", "ms"),
        ("t [us]", "us"),
        ("time(ms)", "ms"),
        ("millis", "ms"),
        ("year", "year"),
        ("timestamp", ""),
    ],
)
def test_the_time_column_and_its_unit_are_known_by_name(header, unit):
    layout = sniff([f"a,{header}", *[f"{i % 3},{1900 + 7 * i}" for i in range(20)]])
    assert layout is not None
    assert layout.time is not None
    assert (layout.time.index, layout.time.unit) == (1, unit)


def test_a_capital_t_is_a_temperature():
    layout = sniff(["T,RH", *[f"{20 + i},{50 - i}" for i in range(9)]])
    assert layout is not None
    assert layout.time is None


def test_a_time_that_stands_still_is_no_time():
    layout = sniff(["year,a", *[f"2018,{i % 5}" for i in range(9)]])
    assert layout is not None
    assert layout.time is None


def test_a_counter_without_a_header_is_no_time():
    layout = sniff([f"{i},{i % 3}" for i in range(20)])
    assert layout is not None
    assert layout.time is None


def test_date_and_clock_in_two_columns_are_one_time():
    layout = sniff(["Date;Time;T", *[f"10/03/2004;{h}.00.00;{h},5" for h in range(10, 20)]])
    assert layout is not None
    assert layout.time is not None
    assert layout.time.indices == (0, 1)


def test_units_come_from_a_row_or_from_our_comment():
    layout = sniff(["t,temp", "s,degC", "0.0,20", "0.1,21"])
    assert layout is not None
    assert [column.unit for column in layout.columns] == ["s", "degC"]
    layout = sniff(["# unit volume: 1e8 m3", "year,volume", "1871,1120", "1872,1160"])
    assert layout is not None
    assert layout.columns[1].unit == "1e8 m3"


@each("filling", [" ", "\t", "a ", ":", " :", "#"])
def test_a_long_unit_comment_is_no_unit_and_is_passed_over_at_once(filling):
    # Half a minute for 4,800 blanks once; 64,000 would outlast any test run.
    layout = sniff([f"# unit{filling * 64_000}x", "t,temp", "0.0,20.5", "0.1,20.6"])
    assert layout is not None
    assert layout.columns[1].unit == ""


def test_names_may_stand_in_the_comment_above_the_data():
    layout = sniff(["# time ax", "0.0 1", "0.1 2"])
    assert layout is not None
    assert [column.name for column in layout.columns] == ["time", "ax"]


def test_boot_text_above_the_header_is_passed_over():
    layout = sniff(["rst:0x1 (POWERON_RESET),boot:0x13", "ip 192.0.2.7", "t,a", "0.0,1", "0.1,2", "0.2,2"])
    assert layout is not None
    assert (layout.first_data, layout.headers) == (4, frozenset({3}))


def test_a_name_too_few_means_row_names_as_r_writes_them():
    layout = sniff(['"date","a","b"', *[f'"{i}","2015-02-02 14:{i:02}:00",{i},{-i}' for i in range(10, 20)]])
    assert layout is not None
    assert [column.role for column in layout.columns] == ["row name", "time", "channel", "channel"]


@each(
    "lines",
    [
        [],
        ["hello", "world"],
        ["a sentence with 3 numbers, 4 of them", "and none here", "nor there at all", "or so"],
        [",".join(["1"] * 300)] * 3,
        ["1 2 3", "4 5", "6 7 8", "9 0"] * 10,
    ],
)
def test_what_is_no_table_of_samples_is_none(lines):
    assert sniff(lines) is None


def test_names_are_made_distinct_without_taking_a_given_one():
    assert distinct_names(["a", "a", "a 2", ""]) == ("a", "a 3", "a 2", "value 4")
    assert distinct_names(["", "value 1"]) == ("value 2", "value 1")


@each(
    ("header", "step", "names"),
    [
        ("count,a", 1, ("a",)),
        ("Index,a", 1, ("a",)),
        ("count,a", 2, ("count", "a")),  # a counter of something else
        ("light,a", 1, ("light", "a")),  # no row number by its name
        ("count", 1, ("count",)),  # all there is
    ],
)
def test_a_column_that_numbers_the_rows_is_no_channel(tmp_path, header, step, names):
    file = tmp_path / "log.csv"
    cells = [[str(step * i), str((7 * i) % 5)][: header.count(",") + 1] for i in range(20)]
    file.write_text("\n".join([header, *map(",".join, cells)]) + "\n")
    assert read_recording(file).names == names


@pytest.mark.parametrize("above", ["#;hum;level", "# n;hum;level"])
def test_a_log_gains_a_field_below_names_that_look_like_a_comment(above):
    narrow, wide = ([f"{i};{i % 7},5{end}" for i in range(1, 14)] for end in ("", ";3,5"))
    layout = sniff(["Site: Barn 7", above, *narrow, *wide, *wide])
    assert (layout.narrow, layout.first_data) == ({2}, 3)


def test_units_stand_behind_numbers_with_thousands_too():
    layout = sniff(["n|level", *(f"{i}|4,{500 + i}.144C" for i in range(20))])
    assert layout is not None
    assert [(column.unit, column.role) for column in layout.columns][1] == ("C", "channel")


@pytest.mark.parametrize(
    "head",
    [
        ["CH1V,CH2V,t0 = , tInc = 1.0e-05,", "0.1,0.2,,", "0.2,0.3,,", "0.3,0.4,,"],
        ["X,CH1,Start,Increment,", "Sequence,Volt,,1.0e-05,", "0,0.1,", "1,0.2,", "2,0.3,"],
        ["Type: raw", "XInc: 1.0e-05", "Data:", "0.1", "0.2", "0.3"],
    ],
)
def test_an_oscilloscope_that_leaves_its_start_empty_counts_from_zero(head):
    layout = sniff(head)
    assert layout is not None
    assert (layout.offset, layout.period) == (0.0, 1e-5)


def test_empty_cells_above_a_table_between_blanks_are_no_names_in_brackets():
    layout = sniff(['a "" [V] b c', *(f"{i} {i}.5 {i % 3}" for i in range(12))])
    assert layout is not None
    assert (layout.first_data, len(layout.columns)) == (2, 3)
