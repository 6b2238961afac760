"""A rate above a table of any logger; and that ordinary tables are no instrument's."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.sources.reading.preface import Preface, find_preface

TABLE = ["t,a", "0,1", "1,2", "2,3"]


@pytest.mark.parametrize(
    ("line", "period"),
    [
        ("# Sampling Rate: 250 Hz", 0.004),
        ("% fs = 100", 0.01),
        ("Sample Interval,1.0,ms,", 1e-3),
        ('"Sampling Frequency (Hz)=",500000000,', 2e-9),
        ("# Config: data_rate = 2000.0 Hz, filter = 488 Hz", 5e-4),
        ("// Sampling interval (ms): 10", 0.01),
        ('"Epoch Length:","30","seconds",""', 30.0),
        ("Sample Rate 100 Hz", 0.01),
        ("# Sampling Period = 4us", 4e-6),
        ("Abtastrate: 50 Hz", 0.02),
        ("; Samplerate: 20 MHz", 5e-8),
        ("# sampled at 125 Hz", 0.008),
        ("# fps: 30", 1 / 30),
        ('# fs = "12,50"', 0.08),
        ("Sample interval = 0,001 s", 1e-3),
        ("# gain=2,fs=100,filter=5", 0.01),
    ],
)
def test_a_rate_above_the_table(line, period):
    found = find_preface(["My logger 3.1", line, *TABLE])
    assert found is not None
    assert found.period == pytest.approx(period)
    assert found.header_row is None


@pytest.mark.parametrize(
    "line",
    [
        "# Sampling Rate: unknown",
        "# Sampling Rate: 0 Hz",
        "# Sampling Rate: 1e999 Hz",
        "# Sampling Rate: 250 apples",
        "# Sampling rate: 1,000 Hz",
        "# Sampling rate: 1,000.5 Hz",
        "Sample interval = 2,500 ms",
        "# heart rate: 60",
        "# Range = 4 g, filter = 488 Hz",
        "rate",
    ],
)
def test_no_rate(line):
    assert find_preface([line, *TABLE]) == Preface()


def test_a_key_on_each_line_is_a_value_of_the_board():
    assert find_preface([f"dt: {10 + i % 3}" for i in range(50)]) == Preface()
    assert find_preface(["dt: 10"] * 50) == Preface()


STARTS = [
    "X,CH1,Start,Increment,", "Time,X(CH1),", '"Number of Data points =",', "Record Length,1,,2,3",
    "Model,MSO", "TIME,CH1", "Sequence,Volt,1,2", "Second,Volt", "1551453301", "1551453301,IBI", "sep=;", "-----",
    "fs = 100", "Sample Index", "", ",", '"', "0,1", "1,2,", "0", "Inf", "1e999,1e999", "Vertical Units,CH1:V",
    "Sampling Period,4", "1e-320", "Sampling Period,1e-320", "%Sample Rate = 1e-320",
]  # fmt: skip


@given(st.lists(st.sampled_from(STARTS) | st.text(max_size=12), max_size=14))
def test_no_first_lines_make_a_rule_fail(lines):
    found = find_preface(lines)
    assert found.period is None or 0 < found.period < float("inf")
    assert 0 < found.first_row <= max(1, len(lines))


@pytest.mark.parametrize(
    "text",
    [
        "1551453301\n1551453302\n1551453303",  # stamps alone
        "1551453301,1551453301\n32,64\n1,2\n3,4",
        "1551453301\n33\n1\n2",  # no rate of an E4
        "1551453301,1551453301\n32,32\n1\n2",
    ],
)
def test_numbers_that_begin_like_an_empatica_file_are_no_such_file(text):
    assert find_preface(text.split("\n")) == Preface()
