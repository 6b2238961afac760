"""Tables as loggers and instruments write them: where they start, what their columns are, what stands beside."""

from datetime import datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.errors import BadSetting
from kalscope.sources.reading.preface import Preface, find_preface

PAIRS = [(f"{0.1 * i:.1f}", f"{20 + i % 7}") for i in range(30)]
ROWS = "".join(f"{t},{a}\n" for t, a in PAIRS)


def notes_of(recording):
    return "\n".join(recording.report.notes)


@pytest.mark.parametrize("word", ["M", "NA", "-", "--", "unavailable", "unknown", "offline", "n.a.", "#N/A", "***"])
def test_first_rows_without_a_sample_do_not_take_the_header_with_them(read, word):
    rows = "".join(f"{i},{i % 5},3\n" for i in range(2, 30))
    recording = read(f"t,a,b\n0,{word},{word}\n1,{word},{word}\n{rows}")
    assert (recording.names, len(recording), recording.report.bad_cells) == (("a", "b"), 30, 0)
    assert np.isnan(recording.values[:2]).all()
    assert word == "NA" or f'"{word}" is a missing sample: 4 cells' in notes_of(recording)


def test_names_that_a_blank_parts_keep_their_units_and_one_of_several_columns_is_that_of_each(read):
    rows = "".join(f"{t}   {a}   5\n" for t, a in PAIRS)
    assert read("t [s]   flow rate   RH\n" + rows).names == ("flow rate", "RH")
    assert read("t (s)  a (V)  b (m)\n" + rows).units == ("V", "m")
    rows = "".join(f"{i / 10};{i % 3};{i};{i + 1};{i + 2};\n" for i in range(30))
    assert read("t;x;T (C)\n" + rows).names == ("x", "T", "T 2", "T 3")


@pytest.mark.parametrize("mark", [",", ";", "|"])
def test_pairs_above_a_table_are_neither_rows_nor_names(read, mark):
    pairs = "Operator,J. Smith\nGain,24\nSample Rate,100 Hz\nOffset,3\n".replace(",", mark)
    assert read(pairs + ("t,a\n" + ROWS).replace(",", mark)).names == ("a",)
    recording = read(pairs + ROWS.replace(",", mark))
    assert (recording.names, len(recording)) == (("value 1",), 30)


def test_metadata_beside_the_data_is_found_and_left_out(read):
    beside = ["Model,X1", "Record Length,30", "Gain,3", *[","] * 27]
    recording = read("".join(f"{text},,{t},{a}\n" for text, (t, a) in zip(beside, PAIRS, strict=True)))
    np.testing.assert_array_equal(recording.values[:, -1], [float(a) for _, a in PAIRS])
    assert "columns of metadata beside the data: 1, 2, 3" in notes_of(recording)


def test_rows_from_before_a_field_was_added_lack_it_and_a_lone_short_row_is_torn(read):
    recording = read("a,b,c\n" + "1.5,2\n2.5,3\n" * 10 + "7.5,1,4\n2,3,4\n" * 10 + "1,2\n3,4,5\n")
    assert (recording.names, recording.report.rows, recording.report.rejected) == (("a", "b", "c"), 41, 1)
    np.testing.assert_array_equal(np.isnan(recording.values[:40, 2]), np.arange(40) < 20)
    assert "rows of 2 fields" in notes_of(recording)


@pytest.mark.parametrize(("cell", "value", "unit"), [
    *(("26.{}C", 26.0, "C"), ("4{}%", 40.0, "%"), ("3.{} V", 3.0, "V"), ('"12,{}"', 12.0, "")),
    *(('"1,23{}.5"', 1230.5, ""), ("+1.{}", 1.0, ""), ("1{}e-3", 0.01, "")),
])  # fmt: skip
def test_the_numbers_of_a_column_are_read_by_the_form_that_all_have(read, cell, value, unit):
    recording = read("t,a\n" + "".join(f"{t},{cell.format(i % 7)}\n" for i, (t, _) in enumerate(PAIRS)))
    assert (recording.values[0, 0], recording.units, recording.report.bad_cells) == (value, (unit,), 0)


def test_thousands_and_decimals_are_told_apart_by_all_cells_or_asked_about(read):
    rows = "".join(f"{i};{'1.' if i % 2 else ''}{i + 100},25\n" for i in range(30))
    assert read("d;x\n" + rows).channel("x")[:2].tolist() == [100.25, 1101.25]
    asked = read("t,x\n" + "".join(f'{t},"1,{i + 100}"\n' for i, (t, _) in enumerate(PAIRS)))
    assert "--decimal comma selects the second" in notes_of(asked)


def test_the_user_says_which_rows_hold_names_and_units(read):
    text = "junk,1\nt,a\nfoo,bar\n" + ROWS
    recording = read(text, header_row=2, unit_row=3)
    assert (recording.names, recording.units, len(recording)) == (("a",), ("bar",), 30)
    assert read("t,a\ns,V\n" + ROWS, unit_row=0).units == ("",)
    assert read("t,a\n" + ROWS, header_row=0).names == ("value 1",)
    with pytest.raises(BadSetting, match="--header-row 999"):
        read(text, header_row=999)


@pytest.mark.slow
def test_what_stands_only_further_down_is_seen_as_well(read):
    empty = "".join(f"{i / 10:.1f},{i % 7},-,\n" for i in range(9000))
    recording = read("t,a,b,c\n" + empty + "".join(f"{i / 10:.1f},{i % 7},ok,3C\n" for i in range(9000, 16000)))
    assert (recording.names, recording.units) == (("a", "c"), ("", "C"))


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_names_that_break_inside_their_quotes(read, mark):
    rows = "".join(f"{0.1 * i:.1f},{20 + i % 7},{i % 5}\n" for i in range(30)).replace(",", mark)
    names = '"time","temp ""inner""\n(degC)","two\n\nlines"\n'.replace(",", mark)
    recording = read(f"made by hand\n{names}{rows}")
    assert (recording.names, recording.units) == (('temp "inner"', "two lines"), ("degC", ""))
    assert recording.sample_period == pytest.approx(0.1)
    report = recording.report
    assert (report.rows, report.rejected, report.lines) == (30, 0, 35)
    assert report.rows + report.blank + report.comments + report.headers == 35


@pytest.mark.parametrize("form", ["%y%m%d,%H%M%S", "%d%m%y,%H%M%S"])
def test_a_date_and_a_clock_of_six_digits_each_are_one_time(read, form):
    start = datetime(2024, 3, 30, 22)
    stamps = [(start + timedelta(minutes=10 * i)).strftime(form) for i in range(400)]
    recording = read("Date,Time,a\n" + "".join(f"{stamp},{i % 7}\n" for i, stamp in enumerate(stamps)))
    assert (recording.names, recording.sample_period) == (("a",), 600.0)
    assert any("2024-03-30T22:00:00" in note for note in recording.report.notes)


UNITS = [
    ("accel (m/s^2)", "accel", "m/s^2"), ("v [us]", "v", "us"), ("gX [°/s]", "gX", "°/s"), ("a_x", "a_x", ""),
    ("Distance_cm", "Distance_cm", "cm"), ("CO(GT)", "CO(GT)", ""), ("plain", "plain", ""),
    ("Pressure in hPa", "Pressure", "hPa"), ('"Temp, °C (LGR S/N: 10229, SEN S/N: 10229)"', "Temp", "°C"),
    ("Coupler (LGR S/N: 10229)", "Coupler (LGR S/N: 10229)", ""), ("spin in place", "spin in place", ""),
]  # fmt: skip


def test_a_unit_stands_in_brackets_or_as_a_clear_suffix(read):
    for text, name, unit in UNITS:
        recording = read(f"time,{text}\n{ROWS}")
        assert (recording.names, recording.units) == ((name,), (unit,))


@pytest.mark.parametrize(("header", "step", "names"), [
    ("count,a", 1, ("a",)), ("Index,a", 1, ("a",)),
    ("count,a", 2, ("count", "a")),  # a counter of something else
    ("light,a", 1, ("light", "a")),  # no row number by its name
    ("count", 1, ("count",)),  # all there is
])  # fmt: skip
def test_a_column_that_numbers_the_rows_is_no_channel(read, header, step, names):
    cells = [[str(step * i), str((7 * i) % 5)][: header.count(",") + 1] for i in range(20)]
    assert read("\n".join([header, *map(",".join, cells), ""])).names == names


N = 60
T = np.arange(N)
A = np.round(np.sin(T / 5) + 2, 3)
B = np.round(np.cos(T / 5) - 1, 3)


def lines(form, **columns):
    return [form.format(*row) for row in zip(*columns.values(), strict=True)]


TRACE = lines("{:.3e},{:.3f},{:.3f},", t=T * 1e-5 - 1e-4, a=A, b=B)
FILES = {
    "rigol settings": (
        ['"Number of Data points =",60,', '"Sampling Frequency (Hz)=",100000,', '"Channel Data","CH 1","CH 2"',
         '"Time (s)","Voltage (V)","Voltage (V)"', *[line[:-1] for line in TRACE], ",,"], "CH 1|CH 2", "V V", 1e-5),
    "tektronix beside": ([f"{key},,  {line}" for key, line in zip(
            ["Record Length,60", "Sample Interval,1.0e-05", ",", "Source,CH2", "Vertical Units,V", *[","] * 55],
            lines("{:.6f},  {:.3f},", t=T * 1e-5, a=A), strict=True)], "CH2", "V", 1e-5),
    "tektronix above": (["Model,MDO3014", "Waveform Type,ANALOG,", "Horizontal Units,s,", "Sample Interval,1e-05,",
         "Vertical Units,V,A", ",,", "TIME,CH1,CH2", *TRACE], "CH1 CH2", "V A", 1e-5),
    "picoscope": (["Time,Channel A,Channel B", "(ms),(V),(mV)", ",", *lines("{:.5f},{},{}", t=T * 0.01, a=A, b=B)],
        "Channel A|Channel B", "V mV", 1e-5,
    ),
    "empatica": (["1551453301.000000, 1551453301.000000, 1551453301.000000", "32.000000, 32.000000, 32.000000",
         *lines("{},{},{}", a=A, b=B, c=T)], "value 1|value 2|value 3", "- - -", 1 / 32),
    "rate above": (["# Sampling Rate: 250 Hz", "ax,ay", *lines("{},{}", a=A, b=B)], "ax ay", "- -", 0.004),
}  # fmt: skip


def words(text):
    return tuple("" if word == "-" else word for word in (text.split("|") if "|" in text else text.split()))


def quoted(line):
    return line if '"' in line else ",".join(f'"{cell}"' if cell else cell for cell in line.split(","))


COPIED = {
    "as it is": lambda text: text,
    "line ends of Windows": lambda text: [line + "\r" for line in text],
    "decimal commas": lambda text: [line.replace(",", ";").replace(".", ",") for line in text],
    "blank lines above": lambda text: ["", "", *text],
    "blanks behind commas": lambda text: [line.replace(",", ", ") for line in text],
    "all cells quoted": lambda text: [quoted(line) for line in text],
    "a line for a spreadsheet": lambda text: ["sep=,", *text],
}
CASES = [
    *((name, "as it is") for name in FILES),
    *((name, copied) for name in ("rigol settings", "tektronix above", "picoscope") for copied in COPIED),
    *(("empatica", copied) for copied in COPIED if copied != "decimal commas"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "copied"), CASES)
def test_a_whole_file_as_it_is_or_copied_by_a_script(name, copied, read):
    text, names, units, period = FILES[name]
    recording = read("\n".join(COPIED[copied](text)) + "\n")
    assert (recording.names, recording.units, recording.report.rejected) == (words(names), words(units), 0)
    assert recording.values[:, 0] == pytest.approx(A)
    assert recording.sample_period == pytest.approx(period, rel=1e-6)


TABLE = ["t,a", "0,1", "1,2", "2,3"]


@pytest.mark.parametrize(("line", "period"), [
    *(("# Sampling Rate: 250 Hz", 0.004), ("% fs = 100", 0.01), ("Sample Interval,1.0,ms,", 1e-3)),
    ('"Sampling Frequency (Hz)=",500000000,', 2e-9),
    *(("# Config: data_rate = 2000.0 Hz, filter = 488 Hz", 5e-4), ("// Sampling interval (ms): 10", 0.01)),
    *(('"Epoch Length:","30","seconds",""', 30.0), ("Sample Rate 100 Hz", 0.01)),
    *(("# Sampling Period = 4us", 4e-6), ("Abtastrate: 50 Hz", 0.02), ("; Samplerate: 20 MHz", 5e-8)),
    *(("# sampled at 125 Hz", 0.008), ("# fps: 30", 1 / 30), ('# fs = "12,50"', 0.08)),
    *(("Sample interval = 0,001 s", 1e-3), ("# gain=2,fs=100,filter=5", 0.01)),
])  # fmt: skip
def test_a_rate_above_the_table(line, period):
    found = find_preface(["My logger 3.1", line, *TABLE])
    assert (found.period, found.header_row) == (pytest.approx(period), None)


@pytest.mark.parametrize("line", [
    *("# Sampling Rate: unknown", "# Sampling Rate: 0 Hz", "# Sampling Rate: 1e999 Hz"),
    *("# Sampling Rate: 250 apples", "# Sampling rate: 1,000 Hz", "# Sampling rate: 1,000.5 Hz"),
    *("Sample interval = 2,500 ms", "# heart rate: 60", "# Range = 4 g, filter = 488 Hz", "rate"),
])  # fmt: skip
def test_no_rate(line):
    assert find_preface([line, *TABLE]) == Preface()


STARTS = [
    "X,CH1,Start,Increment,", "Time,X(CH1),", '"Number of Data points =",', "Record Length,1,,2,3",
    "Model,MSO", "TIME,CH1", "Sequence,Volt,1,2", "Second,Volt", "1551453301", "1551453301,IBI", "sep=;", "-----",
    "fs = 100", "Sample Index", "", ",", '"', "0,1", "1,2,", "0", "Inf", "1e999,1e999", "Vertical Units,CH1:V",
    "Sampling Period,4", "1e-320", "Sampling Period,1e-320", "%Sample Rate = 1e-320",
]  # fmt: skip


@pytest.mark.slow
@given(st.lists(st.sampled_from(STARTS) | st.text(max_size=12), max_size=14))
def test_no_first_lines_make_a_rule_fail(lines):
    found = find_preface(lines)
    assert found.period is None or 0 < found.period < float("inf")
    assert 0 < found.first_row <= max(1, len(lines))
