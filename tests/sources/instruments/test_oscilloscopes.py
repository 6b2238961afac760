"""What oscilloscopes write above and beside their samples; each text is made up in the form of real files."""

import pytest
from each import each
from prefaces import head, preface


def test_rigol_names_and_units_rows_and_the_separator_that_only_rows_end_in():
    found = preface("""
,CH1,CH2
Second,Volt,Volt
-4.0e-03,3.04e+00,9.40e+00,\x20
-3.9e-03,3.04e+00,9.40e+00,\x20
""")
    assert (found.header_row, found.unit_row, found.first_row) == (1, 2, 3)
    assert (found.names, found.units) == (("time", "CH1", "CH2"), ("s", "V", "V"))
    assert (found.time_column, found.time_unit) == (0, "s")


@pytest.mark.parametrize("names", ["X,CH1,", "Time,X(CH1),", ",CH1,"])
def test_rigol_calls_its_first_column_differently_by_model(names):
    found = preface(f"{names}\nSecond,Volt,\n-5.99e-06,4.4,\n-5.98e-06,4.3,")
    assert found.names == ("time", "CH1")


def test_rigol_numbers_its_samples_and_says_start_and_increment():
    found = preface("""
X,CH1,CH2,Start,Increment,
Sequence,VOLT,Volt,-6.0e-03,1.0e-06,
0,4.00e-02,1.0,
1,-1.20e-01,1.1,
""")
    assert (found.names, found.units) == (("sequence", "CH1", "CH2"), ("", "V", "V"))
    assert (found.left_out, found.time_column, found.period, found.offset) == ({0}, -1, 1e-6, -6e-3)
    assert found.first_row == 3


def test_rigol_pods_of_digital_lines_are_no_samples():
    found = preface("""
X,CH1,D7-D0,D15-D8,Start,Increment,
Sequence,Volt,,,-1.144e-03,2.0e-06
0,4.00e-02,0x00,0x00,
1,-1.20e-01,0x00,0x01,
2,-1.20e-01,0x00,0x01,
""")
    assert found.left_out == {0, 2, 3}


def test_rigol_that_knows_no_increment_has_no_period():
    found = preface("X,CH1,Start,Increment,\nSequence,Volt,0.000E+0,Inf\n0,1.375E+2,\n1,1.4E+2,")
    assert (found.period, found.offset, found.time_column) == (None, None, -1)


SETTINGS = """
"Number of Data points =",8192,
"Time Scale (s/DIV) =",1E-7,
"Sampling Frequency (Hz)=",{rate},
"Channel Data","CH 1","CH 2"
"Attenuation = ",10,1
"Inverted = ","NO","NO"
"Time (s)","Voltage (V)","Voltage (V)"
0,1.72,9.92
2E-9,-4.52,9.92
4E-9,-4.6,9.92
"""


def test_rigol_settings_name_the_channels():
    found = preface(SETTINGS.format(rate=500000000))
    assert (found.names, found.units) == (("time", "CH 1", "CH 2"), ("s", "V", "V"))
    assert (found.header_row, found.first_row, found.period) == (7, 8, 2e-9)


def test_rigol_says_start_and_increment_behind_the_names():
    found = preface("CH1V,CH2A,t0 =-5.000000e-02, tInc = 1.000000e-05,\n0.1,0.2,,\n0.2,0.3,,")
    assert (found.names, found.units) == (("CH1", "CH2"), ("V", "A"))
    assert (found.time_column, found.period, found.offset, found.first_row) == (-1, 1e-5, -0.05, 2)


def test_rigol_writes_units_into_the_names_of_a_screen():
    found = preface("Time(s),CH1V,CH2(V)\n-0.1,0.1,0.2\n0.0,0.2,0.3")
    assert (found.names, found.units, found.time_column) == (("time", "CH1", "CH2"), ("s", "V", "V"), 0)


def test_a_rate_that_the_stamps_contradict_is_not_used_and_said():
    found = preface(SETTINGS.format(rate=100000000))
    assert found.period is None
    assert any("contradict" in note for note in found.notes)


BESIDE = """
{q}Record Length{q},2.5e+03,{points}  -0.000480,  -0.86000,
{q}Sample Interval{q},2.0e-06,{s}  -0.000478,  -0.86000,
Trigger Point,2.4e+02,,  -0.000476,  -0.88000,
,,,  -0.000474,  -0.86000,
Source,CH2,,  -0.000472,  -0.86000,
Vertical Units,V,,  -0.000470,  -0.86000,
Horizontal Units,s,,  -0.000468,  -0.86000,
Model Number,TBS1022,,-00.000466,  -0.86000,
,,,-00.000464,  -0.86000,
"""


@pytest.mark.parametrize("form", [("", ",", ","), ('"', '"Points",', '"s",')])
def test_tektronix_settings_beside_the_samples(form):
    quote, points, s = form
    found = preface(BESIDE.format(q=quote, points=points, s=s))
    assert (found.left_out, found.time_column, found.first_row) == ({0, 1, 2}, 3, 1)
    assert (found.names[3:], found.units[3:], found.period) == (("time", "CH2"), ("s", "V"), 2e-6)


@pytest.mark.parametrize("mark", ["", "#"])
def test_tektronix_settings_above_the_samples(mark):
    lines = """
Model,MSO4034B
Firmware Version,2.90

Waveform Type,ANALOG,,
Point Format,Y,,
Horizontal Units,s,,
Sample Interval,4e-06,,
Record Length,1000,,
Vertical Units,V,A,
,,,
Label,,,
TIME,CH1,CH2,
-2.0000e-03,0.01,1.5,
-1.9960e-03,0.02,1.6,
-1.9920e-03,0.03,1.6,
"""
    found = preface("\n".join(mark + line if line[:1].isalpha() else line for line in head(lines)))
    assert (found.names, found.units) == (("time", "CH1", "CH2"), ("s", "V", "A"))
    assert (found.header_row, found.first_row, found.period) == (12, 13, 4e-6)


def test_tektronix_writes_the_settings_of_digital_lines_beside_those_of_the_analog_ones():
    found = preface("""
Model,MDO3014
Waveform Type,ANALOG,,Waveform Type,DIGITAL,
Horizontal Units,s,,Horizontal Units,s,
Sample Interval,4e-09,,Sample Interval,4e-09,
Vertical Units,V,,Vertical Units,V,V
TIME,CH1,,TIME,D1,D0
-1.000000000e-03,0.01,,-1.000000000e-03,0,1
-9.99996000e-04,0.01,,-9.99996000e-04,0,1
""")
    assert found.left_out == {2, 3}
    assert found.units == ("s", "V", "", "", "V", "V")


DIALECTS = {
    "semicolons and decimal commas": lambda text: text.replace(",", ";").replace(".", ","),
    "tabs and decimal commas": lambda text: text.replace(",", "\t").replace(".", ","),
    "tabs": lambda text: text.replace(",", "\t"),
}
FILES = {
    "rigol": "X,CH1,Start,Increment,\nSequence,Volt,-6.0e-03,1.0e-06,\n0,4.5e-02,\n1,-1.2e-01,",
    "rigol settings": SETTINGS.format(rate=500000000),
    "tektronix": BESIDE.format(q="", points=",", s=","),
}


@each("name", FILES)
@each("dialect", DIALECTS)
def test_a_spreadsheet_may_save_the_file_again_with_its_own_marks(name, dialect):
    as_written, saved = preface(FILES[name]), preface(DIALECTS[dialect](FILES[name]))
    assert (saved.delimiter, saved.decimal) == (
        "\t" if "tabs" in dialect else ";",
        "," if "commas" in dialect else ".",
    )
    for field in ("names", "units", "period", "offset", "left_out", "time_column", "first_row", "header_row"):
        assert getattr(saved, field) == getattr(as_written, field)
