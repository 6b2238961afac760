"""Whole files of instruments, and a rate above a table of any logger."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.sources.reading.preface import Preface, find_preface

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
    "picoscope": (
        ["Time,Channel A,Channel B", "(ms),(V),(mV)", ",", *lines("{:.5f},{},{}", t=T * 0.01, a=A, b=B)],
        "Channel A|Channel B", "V mV", 1e-5,
    ),
    "campbell": (
        ['"TOA5","Meadow","CR1000","1","CR1000.Std","CPU:a.CR1","5","T"', '"TIMESTAMP","RECORD","BattV","AirT_Avg"',
         '"TS","RN","Volts","Deg C"', '"","","Smp","Avg"',
         *lines('"2014-01-01 00:{:02d}:00",{},{},{}', t=T, n=T + 7, a=A, b=B)],
        "RECORD BattV AirT_Avg", "RN|V|Deg C", 60.0,
    ),
    "empatica": (
        ["1551453301.000000, 1551453301.000000, 1551453301.000000", "32.000000, 32.000000, 32.000000",
         *lines("{},{},{}", a=A, b=B, c=T)],
        "value 1|value 2|value 3", "- - -", 1 / 32,
    ),
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
    assert recording.values[:, int(name == "campbell")] == pytest.approx(A)
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
