"""Whole files of instruments, read to the end: rows, names, units and values; all made up."""

import numpy as np
import pytest
from each import each

from kalscope.sources.reading.recording_file import read_recording

N = 60
T = np.arange(N)
A = np.round(np.sin(T / 5) + 2, 3)
COUNTS = (A * 100).astype(int)
B = np.round(np.cos(T / 5) - 1, 3)


def lines(form, **columns):
    return [form.format(*row) for row in zip(*columns.values(), strict=True)]


TRACE = lines("{:.3e},{:.3f},{:.3f},", t=T * 1e-5 - 1e-4, a=A, b=B)
FILES = {
    "rigol two rows": ([",CH1,CH2", "Second,Volt,Volt", *[f"{line} " for line in TRACE]], "CH1 CH2", "V V", 1e-5),
    "rigol numbered": (
        ["X,CH1,CH2,Start,Increment,", "Sequence,Volt,Volt,-1.0e-04,1.0e-05,", *lines("{},{},{},", t=T, a=A, b=B)],
        "CH1 CH2", "V V", 1e-5,
    ),
    "rigol pods": (
        ["X,CH1,D7-D0,Start,Increment,", "Sequence,Volt,,-1.0e-04,1.0e-05",
         *lines("{},{},0x{:02x},", t=T, a=A, d=T)],
        "CH1", "V", 1e-5,
    ),
    "rigol one line": (
        ["CH1V,CH2V,t0 =-1.0e-04, tInc = 1.0e-05,", *lines("{},{},,", a=A, b=B)], "CH1 CH2", "V V", 1e-5,
    ),
    "rigol settings": (
        ['"Number of Data points =",60,', '"Sampling Frequency (Hz)=",100000,', '"Channel Data","CH 1","CH 2"',
         '"Time (s)","Voltage (V)","Voltage (V)"', *[line[:-1] for line in TRACE], ",,"],
        "CH 1|CH 2", "V V", 1e-5,
    ),
    "tektronix beside": (
        [f"{key},,  {line}" for key, line in zip(
            ["Record Length,60", "Sample Interval,1.0e-05", ",", "Source,CH2", "Vertical Units,V", *[","] * 55],
            lines("{:.6f},  {:.3f},", t=T * 1e-5, a=A), strict=True)],
        "CH2", "V", 1e-5,
    ),
    "tektronix above": (
        ["Model,MDO3014", "Waveform Type,ANALOG,", "Horizontal Units,s,", "Sample Interval,1e-05,",
         "Vertical Units,V,A", ",,", "TIME,CH1,CH2", *TRACE],
        "CH1 CH2", "V A", 1e-5,
    ),
    "keysight": (["x-axis,1,2", "second,Volt,Ampere", *[line[:-1] for line in TRACE]], "1 2", "V A", 1e-5),
    "infiniium": (
        ["Type: raw", "Points: 60", "XInc: 1e-05", "XOrg: -1e-04", "XUnits: second", "YUnits: Volt", "Data:",
         *lines("{}", a=A)],
        ("value 1",), "V", 1e-5,
    ),
    "siglent": (
        ["Record Length,Analog:60,", "Sample Interval,Analog:1.0e-05,", "Vertical Units,CH1:V,CH3:A,",
         "Source,CH1,CH3", "Second,Value,Value", *[line[:-1] for line in TRACE]],
        "CH1 CH3", "V A", 1e-5,
    ),
    "lecroy": (
        ["LECROYWS3024,12304,Waveform", "Segments,1,SegmentSize,60", "Segment,TrigTime,TimeSinceSegment1",
         "#1,22-Jan-2015 11:35:11,0", "Time,Ampl", *lines("{:.3e},{}", t=T * 1e-5, a=A)],
        "Ampl", "-", 1e-5,
    ),
    "picoscope": (
        ["Time,Channel A,Channel B", "(ms),(V),(mV)", ",", *lines("{:.5f},{},{}", t=T * 0.01, a=A, b=B)],
        "Channel A|Channel B", "V mV", 1e-5,
    ),
    "gw instek": (
        ["Memory Length,60,", "Source,CH2,", "Vertical Units,V,", "Sampling Period,1.0e-05,", "Mode,Detail,",
         "Waveform Data,", *lines("{:.3e},{},", t=T * 1e-5, a=A)],
        "CH2", "V", 1e-5,
    ),
    "hantek": (
        ["#timebase=1000000(ps)", ",#voltbase=5000000(uV)", "#size=60", *lines("{:.3e},{}", t=T * 1e-5, a=A)],
        ("value 1",), "V", 1e-5,
    ),
    "owon": (
        ["#,Time(ms),CH1(mV)", *lines("{},{:.5f},{}", n=T, t=1 - T * 0.01, a=A)], "CH1", "mV", 1e-5,
    ),
    "rohde": (["in s,C1 in V,C2 in V", *[line[:-1] for line in TRACE]], "C1 C2", "V V", 1e-5),
    "campbell": (
        ['"TOA5","Meadow","CR1000","1","CR1000.Std","CPU:a.CR1","5","T"', '"TIMESTAMP","RECORD","BattV","AirT_Avg"',
         '"TS","RN","Volts","Deg C"', '"","","Smp","Avg"',
         *lines('"2014-01-01 00:{:02d}:00",{},{},{}', t=T, n=T + 7, a=A, b=B)],
        "BattV AirT_Avg", "Volts|Deg C", 60.0,
    ),
    "empatica": (
        ["1551453301.000000, 1551453301.000000, 1551453301.000000", "32.000000, 32.000000, 32.000000",
         *lines("{},{},{}", a=A, b=B, c=T)],
        "x y z", "1/64 g|1/64 g|1/64 g", 1 / 32,
    ),
    "empatica one": (["1551453301.00", "4.000000", *lines("{}", a=A)], "value", "-", 0.25),
    "openbci": (
        ["%OpenBCI Raw EEG Data", "%Number of channels = 2", "%Sample Rate = 250.0 Hz",
         "%First Column = SampleIndex", *lines("{}, {}, {}", n=T, a=A, b=B)],
        "EXG Channel 0|EXG Channel 1", "µV µV", 0.004,
    ),
    "shimmer": (
        ['"sep=;"', "S_Timestamp_Unix_CAL;S_Accel_X_CAL;S_GSR_Range_CAL;", "ms;m/(s^2);no_units;",
         *lines("1595933{:06d}.0;{};{};", t=T * 10, a=A, b=B)],
        "S_Accel_X_CAL S_GSR_Range_CAL", "m/s^2 -", 0.01,
    ),
    "actigraph": (
        ["------ Data File Created By ActiGraph GT3X+ Firmware v3.2.1 date format M/d/yyyy  Filter Normal ------",
         "Serial Number: NEO1", "Start Time 07:00:00", "Start Date 9/4/2012", "Epoch Period (hh:mm:ss) 00:00:10",
         "Current Battery Voltage: 4.22     Mode = 12", "--------------------------------------------------",
         "Axis1,Axis2,Steps", *lines("{},{},{}", a=A, b=B, c=T)],
        "Axis1 Axis2 Steps", "- - -", 10.0,
    ),
    "actiwatch": (
        ["subject", "17-May-2007", "13:00", "4", "35", "V1", "M", *lines("{}", a=COUNTS)],
        "activity", "-", 60.0,
    ),
    "opensignals": (
        ["# OpenSignals Text File Format",
         '# {"00:07": {"sensor": ["ECG"], "column": ["nSeq", "CH1"], "sampling rate": 1000}}', "# EndOfHeader",
         *lines("{}\t{}\t", n=T, a=A)],
        ("CH1 ECG",), "-", 0.001,
    ),
    "biopac": (
        ["b.acq", "0.5 msec/sample", "2 channels", "EMG", "mV", "Force", "kg", "milliSec\tCH1\tCH2", "\t60\t60",
         *lines("{}\t{}\t{}", t=T / 2, a=A, b=B)],
        "EMG Force", "mV kg", 0.0005,
    ),
    "labchart": (
        ["Interval=\t0.001 s", "ExcelDateTime=\t4.0e+004\t7/6/2009 12:00:00", "TimeFormat=\tStartOfBlock",
         "ChannelTitle=\tECG\tPulse", "Range=\t10.000 V\t200.0 mV", *lines("{:.3f}\t{}\t{}", t=T / 1000, a=A, b=B)],
        "ECG Pulse", "- -", 0.001,
    ),
    "rate above": (["# Sampling Rate: 250 Hz", "ax,ay", *lines("{},{}", a=A, b=B)], "ax ay", "- -", 0.004),
}  # fmt: skip


def words(text):
    if isinstance(text, tuple):
        return text
    return tuple("" if word == "-" else word for word in (text.split("|") if "|" in text else text.split()))


def comma(line):
    return line.replace(",", ";").replace(".", ",")


@pytest.mark.slow
@each("name", FILES)
@each("ending", ["\n", "\r\n"])
def test_a_whole_file(name, ending, tmp_path):
    text, names, units, period = FILES[name]
    path = tmp_path / "file.csv"
    path.write_bytes((ending.join(text) + ending).encode())
    recording = read_recording(path)
    assert recording.names == words(names)
    assert recording.units == words(units)
    assert recording.report.rejected == 0
    assert recording.values[:, -1 if name == "opensignals" else 0] == pytest.approx(
        A * 100 // 1 if name == "actiwatch" else A
    )
    assert recording.sample_period == pytest.approx(period, rel=1e-6)


@each("name", ["rigol numbered", "tektronix beside", "siglent", "keysight", "picoscope"])
def test_a_file_that_a_spreadsheet_saved_with_decimal_commas(name, tmp_path):
    text, names, units, period = FILES[name]
    path = tmp_path / "file.csv"
    path.write_text("\n".join(map(comma, text)) + "\n", encoding="utf-8")
    recording = read_recording(path)
    assert (recording.names, recording.units) == (words(names), words(units))
    assert recording.values[:, 0] == pytest.approx(A)
    assert recording.sample_period == pytest.approx(period, rel=1e-6)


@pytest.mark.parametrize("name", ["rigol numbered", "rigol one line", "infiniium"])
def test_a_trace_without_stamps_counts_from_the_trigger(name, tmp_path):
    path = tmp_path / "file.csv"
    path.write_text("\n".join(FILES[name][0]) + "\n", encoding="utf-8")
    assert read_recording(path).time == pytest.approx(T * 1e-5 - 1e-4)


@pytest.mark.parametrize(
    ("text", "start"),
    [
        (["1551453301.000000, IBI", *lines("{:.6f},{}", t=T + 145.631666, a=A)], "2019-03-01T15:15:01"),
        (FILES["labchart"][0], "2009-07-06T00:00:00"),
    ],
    ids=["empatica", "labchart"],
)
def test_the_start_is_said_where_there_are_stamps(text, start, tmp_path):
    path = tmp_path / "file.csv"
    path.write_text("\n".join(text) + "\n", encoding="utf-8")
    recording = read_recording(path)
    assert recording.time[0] == pytest.approx(145.631666 if "IBI" in text[0] else 0)
    assert f"stamps are read as s; time counts from {start}+00:00" in recording.report.notes


def quoted(line):
    return line if '"' in line else ",".join(f'"{cell}"' if cell else cell for cell in line.split(","))


MANGLED = {
    "blank lines above": lambda text: ["", "", *text],
    "each line end doubled": lambda text: "\n\n".join(text).split("\n"),
    "blanks behind commas": lambda text: [line.replace(",", ", ") for line in text],
    "all cells quoted": lambda text: [quoted(line) for line in text],
    "one more separator": lambda text: [line + "," for line in text],
    "a line for a spreadsheet": lambda text: ["sep=,", *text],
}
NAMES = [
    "rigol numbered",
    "rigol settings",
    "tektronix above",
    "siglent",
    "picoscope",
    "campbell",
    "empatica",
    "openbci",
]


@pytest.mark.slow
@each("mangling", MANGLED)
@each("name", NAMES)
def test_a_file_that_a_script_copied(name, mangling, tmp_path):
    text, names, units, period = FILES[name]
    path = tmp_path / "file.csv"
    path.write_text("\n".join(MANGLED[mangling](text)) + "\n", encoding="utf-8")
    recording = read_recording(path)
    assert (recording.names, recording.units) == (words(names), words(units))
    assert recording.values[:, 0] == pytest.approx(A)
    assert recording.sample_period == pytest.approx(period, rel=1e-6)
