import pytest

from kalscope import read_recording
from kalscope.sources.reading.columns import distinct_names, named_column
from kalscope.sources.reading.sniffer import sniff


@pytest.mark.parametrize(
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


@pytest.mark.parametrize("filling", [" ", "\t", "a ", ":", " :", "#"])
def test_a_long_unit_comment_is_no_unit_and_is_passed_over_at_once(filling):
    # Half a minute for 4,800 blanks once; 64,000 would outlast any test run.
    layout = sniff([f"# unit{filling * 64_000}x", "t,temp", "0.0,20.5", "0.1,20.6"])
    assert layout is not None
    assert layout.columns[1].unit == ""


def test_names_are_made_distinct_without_taking_a_given_one():
    assert distinct_names(["a", "a", "a 2", ""]) == ("a", "a 3", "a 2", "value 4")
    assert distinct_names(["", "value 1"]) == ("value 2", "value 1")


@pytest.mark.parametrize(
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
