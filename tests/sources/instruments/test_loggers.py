"""What loggers and wearables write above their samples; each text is made up in the form of real files."""

import pytest
from each import each
from prefaces import head, preface

from kalscope.sources.instruments.registry import find_preface


def test_campbell_toa5_names_units_and_its_counter():
    found = preface("""
"TOA5","Meadow","CR1000","1234","CR1000.Std.28","CPU:prog.CR1","53071","Table1"
"TIMESTAMP","RECORD","BattV_Avg","PTemp_C_Avg"
"TS","RN","Volts","Deg C"
"","","Avg","Avg"
"2014-01-01 00:10:00",0,12.6,"NAN"
""")
    assert (found.header_row, found.unit_row, found.first_row) == (2, 3, 5)
    assert found.names == ("TIMESTAMP", "RECORD", "BattV_Avg", "PTemp_C_Avg")
    assert found.units == ("", "", "Volts", "Deg C")
    assert (found.left_out, found.time_column) == ({1}, 0)
    assert "Meadow" in found.notes[0]


def test_a_spreadsheet_saves_toa5_with_other_marks():
    found = preface("""
TOA5;Meadow;CR1000;1234;;;;
TIMESTAMP;RECORD;AirTC_Avg;;
TS;RN;Deg C;;
;;Avg;;
01.01.2014 00:10;0;12,6;;
""")
    assert (found.delimiter, found.decimal, found.names) == (";", ",", ("TIMESTAMP", "RECORD", "AirTC_Avg"))


def test_campbell_toaci1_has_two_lines():
    found = preface('"TOACI1","Pk","Min10"\n"TMSTAMP","RECNBR","GHI_Avg"\n"2015-09-17 16:30:00",7,471.45')
    assert (found.header_row, found.unit_row, found.first_row, found.left_out) == (2, 0, 3, {1})


def test_empatica_start_and_rate_are_no_samples():
    found = preface("""
1551453301.000000, 1551453301.000000, 1551453301.000000
32.000000, 32.000000, 32.000000
-1,65,5
-1,65,4
""")
    assert (found.first_row, found.time_column) == (3, -1)
    assert (found.period, found.start) == (1 / 32, 1551453301)
    assert (found.names, found.units) == (("x", "y", "z"), ("1/64 g",) * 3)


@pytest.mark.parametrize("rate", [1, 4, 64])
def test_empatica_one_column(rate):
    found = preface(f"1551453311.00\n{rate}.000000\n88.00\n88.67")
    assert (found.names, found.period, found.start) == (("value",), 1 / rate, 1551453311)


def test_empatica_beats_are_stamped_from_the_start():
    found = preface("1551453301.000000, IBI\n145.631666,0.62509\n146.522332,0.890666")
    assert (found.names, found.units) == (("time", "IBI"), ("s", "s"))
    assert (found.first_row, found.time_column, found.start) == (2, 0, 1551453301)


@each(
    "text",
    [
        "1551453301\n1551453302\n1551453303",  # stamps alone
        "1551453301\n1\n1551453302\n1",
        "1551453301,1551453301\n32,64\n1,2\n3,4",
        "1551453301,20.5\n32,20.6\n64,20.7",
        "1551453301\n33\n1\n2",  # no rate of an E4
        "100.0\n32.0\n1\n2",
        "1551453301,1551453301\n32,32\n1\n2",
    ],
)
def test_numbers_that_begin_like_an_empatica_file_are_no_such_file(text):
    assert find_preface(head(text)) is None


OPENBCI = """
%OpenBCI Raw EXG Data
%Number of channels = 2
%Sample Rate = 250 Hz
%Board = OpenBCI_GUI$BoardCytonSerial
Sample Index,EXG Channel 0,EXG Channel 1,Accel Channel 0,Not Used,Timestamp,Marker Channel,Timestamp (Formatted)
0, 61379.36, 49492.89, 0.040,0, {stamp},0, 12:00:53.329
"""


@pytest.mark.parametrize(("stamp", "unit"), [("1557936053329", "ms"), ("1557936053.329", "s")])
def test_openbci_leaves_out_its_counter_and_markers(stamp, unit):
    found = preface(OPENBCI.format(stamp=stamp))
    assert (found.left_out, found.time_column, found.time_unit) == ({0, 4, 6, 7}, 5, unit)
    assert (found.period, found.units[1], found.units[3]) == (0.004, "µV", "g")
    assert (found.header_row, found.first_row) == (5, 6)


@pytest.mark.parametrize(
    ("said", "tail"), [("%Number of channels = 2", ", 18:51:16.059, 1557936053329"), ("%", "")]
)
def test_old_openbci_files_have_no_names(said, tail):
    rows = "".join(f"\n{i}, 0.10, 0.20, 0.04, 0.42, 0.24{tail}" for i in range(3))
    found = preface(f"%OpenBCI Raw EEG Data\n{said}\n%Sample Rate = 250.0 Hz\n%First Column = SampleIndex{rows}")
    assert found.names[:6] == (
        "Sample Index", "EXG Channel 0", "EXG Channel 1", "Accel Channel 0", "Accel Channel 1", "Accel Channel 2",
    )  # fmt: skip
    assert (found.time_column, found.left_out) == ((7, {0, 6}) if tail else (-1, {0}))
    assert (found.header_row, found.first_row, found.period) == (0, 5, 0.004)


def test_shimmer_names_then_units_below_a_line_for_a_spreadsheet():
    found = preface("""
"sep=,"
S_Head_Timestamp_Unix_CAL,S_Head_Accel_WR_X_CAL,S_Head_GSR_Range_CAL,
ms,m/(s^2),no_units,
1595933810034.1,9.81,0,
1595933810057.2,9.80,0,
""")
    assert (found.header_row, found.unit_row, found.first_row, found.delimiter) == (2, 3, 4, ",")
    assert (found.units, found.time_column, found.time_unit) == (("ms", "m/s^2", ""), 0, "ms")


def test_shimmer_device_name_kind_and_unit_in_four_rows():
    found = preface("""
Shimmer 1\tShimmer 1\tShimmer 1
Timestamp\tAccelerometer X\tAccelerometer X
CAL\tRAW\tCAL
mSecs\tn/a\tm/(sec^2)
0.0\t2047\t0.1
9.8\t2048\t0.2
""")
    assert (found.header_row, found.unit_row, found.first_row) == (2, 4, 5)
    assert found.names == ("Timestamp CAL", "Accelerometer X RAW", "Accelerometer X CAL")
    assert (found.units, found.time_unit) == (("ms", "", "m/s^2"), "ms")


ACTIGRAPH = """
--------- Data File Created By ActiGraph GT3X+ Firmware v3.2.1 date format {form}{raw}  Filter Normal --------
Serial Number: NEO1F09120034
Start Time 07:00:00
Start Date {date}
Epoch Period (hh:mm:ss) {epoch}
Download Time 11:38:05
Current Battery Voltage: 4.22     Mode = 12
--------------------------------------------------
{header}0,1,2
3,4,5
"""


@pytest.mark.parametrize(("form", "date"), [("M/d/yyyy", "9/4/2012"), ("dd/MM/yyyy", "04/09/2012")])
def test_actigraph_counts_begin_at_the_start_that_it_says(form, date):
    text = ACTIGRAPH.format(form=form, raw="", date=date, epoch="00:00:10", header="Axis1,Axis2,Axis3\n")
    found = preface(text)
    assert (found.period, found.start) == (10, 1346742000)
    assert (found.header_row, found.first_row, found.time_column) == (9, 10, -1)


def test_actigraph_raw_samples_have_a_rate_and_no_epoch():
    found = preface(
        ACTIGRAPH.format(form="M/d/yyyy", raw=" at 30 Hz", date="9/4/2012", epoch="00:00:00", header="")
    )
    assert (found.period, found.header_row, found.first_row) == (1 / 30, 0, 9)


@each(("line", "delimiter"), [("sep=;", ";"), ('"sep=,"', ","), ("sep=\t", "\t"), ("SEP=|", "|")])
def test_a_separator_line_for_a_spreadsheet_names_the_delimiter(line, delimiter):
    assert preface(f"{line}\nt{delimiter}a\n0{delimiter}1").delimiter == delimiter


def test_a_byte_order_mark_hides_no_instrument():
    assert (
        preface('\ufeff"TOACI1","Pk","Min10"\n"TMSTAMP","A"\n"2015-09-17 16:30:00",7').instrument
        == "Campbell logger"
    )


def test_actiwatch_counts_follow_seven_lines():
    found = preface("subject\n17-May-2007\n13:00\n 4\n35\nV123456\nM\n0\n12\n7 M\n3")
    assert (found.first_row, found.names, found.period, found.start) == (8, ("activity",), 60, 1179406800)


def test_four_lines_of_text_are_no_actiwatch():
    assert find_preface(["subject", "here", "13:00", "4", "35", "V1", "M", "0", "1", "2"]) is None


OPENSIGNALS = """
# OpenSignals Text File Format. Version 1
# {"00:07": {"sensor": ["ECG", "RAW"], "column": ["nSeq", "DI", "CH1", "CH2"], "time": "9:39:1.0", \
"date": "2017-5-22", "sampling rate": 700, "label": ["CH1", "CH2"]}}
# EndOfHeader
0\t0\t32000\t31000\t
1\t0\t32001\t31000\t
2\t0\t32002\t31000\t
"""


def test_opensignals_say_their_columns_in_json():
    found = preface(OPENSIGNALS)
    assert (found.names, found.left_out) == (("nSeq", "DI", "CH1 ECG", "CH2"), {0})
    assert (found.delimiter, found.period, found.start, found.first_row) == ("\t", 1 / 700, 1495445941, 4)


@each("said", ["", "{", "[1]", "{}", '{"a": 1}', '{"a": {"column": 5}}', "{" * 9000])
def test_opensignals_without_a_header_are_none(said):
    assert find_preface(["# OpenSignals Text File Format", f"# {said}", "# EndOfHeader", "0\t1", "1\t1"]) is None


BIOPAC = ["b.acq", "0.5 msec/sample", "2 channels", "EMG - EMG100C", "mV", "Clench Force", "kg"]


@pytest.mark.parametrize("mark", [",", "\t"])
def test_biopac_names_and_units_stand_in_lines_of_their_own(mark):
    rows = [row.replace(",", mark) for row in ("milliSec,CH1,CH2", ",3,3", "0,0.1,1", "0.5,0.2,1")]
    found = preface("\n".join([*BIOPAC, *rows]))
    assert (found.names, found.units) == (("time", "EMG - EMG100C", "Clench Force"), ("ms", "mV", "kg"))
    assert (found.period, found.time_unit, found.time_column, found.first_row) == (5e-4, "ms", 0, 10)


def test_biopac_without_stamps():
    found = preface("\n".join([*BIOPAC, "CH1\tCH2", "3\t3", "0.1\t1", "0.2\t1"]))
    assert (found.names, found.time_column, found.first_row) == (("EMG - EMG100C", "Clench Force"), -1, 10)


@pytest.mark.parametrize("count", ["9" * 4400, "²"])
def test_biopac_with_an_unreadable_count_of_channels_is_none(count):
    rows = [*BIOPAC[:2], f"{count} channels", *BIOPAC[3:], "CH1\tCH2", "3\t3", "0.1\t1", "0.2\t1"]
    assert find_preface(rows) is None


def test_labchart_names_its_channels():
    found = preface("""
Interval=\t0.001 s
ExcelDateTime=\t4.0000500000000000e+004\t7/6/2009 12:00:00.0
TimeFormat=\tStartOfBlock
ChannelTitle=\tECG\tPulse
Range=\t10.000 V\t200.0 mV
0\t0.1\t0.2
0.001\t0.1\t0.2
""")
    assert (found.names, found.period, found.time_unit) == (("time", "ECG", "Pulse"), 0.001, "s")
    assert (found.delimiter, found.first_row, found.start) == ("\t", 6, 1246881600)


def test_openbci_without_a_sample_as_yet():
    assert preface("\n".join(head(OPENBCI)[:5])).first_row == 6
