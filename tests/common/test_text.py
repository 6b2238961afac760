"""One way to write numbers, units, durations, counts, lags and decibels."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.common import text
from kalscope.common.text import THIN_SPACE as THIN
from kalscope.common.text import gate_digits, gate_text, typed_gate, typed_number
from kalscope.errors import BadSetting

WRITTEN = [
    (text.number, {0.095124: "0.0951", 13.0157: "13.0", -3.14159: "−3.14", 99996.0: f"100{THIN}000", 0.0: "0"}),
    (text.number, {12345.6: f"12{THIN}300", math.inf: "∞", math.nan: "none"}),
    (lambda value: text.number(value, 6), {-632.5456: "−632.546"}),
    (text.trimmed, {2.0: "2", 100.0: "100", 1.5e-9: "1.5e-9"}),
    (text.count, {1234567: f"1{THIN}234{THIN}567"}),
    (lambda n: text.plural(n, "sample"), {4.102: "4.1 samples", 0.9996: "1 sample"}),
    (text.percent, {0.1234: "12 %", 0.00417: "0.42 %"}),
    (text.correlation, {-0.0451: "−0.045", -0.0001: "0.000"}),
    (text.p_value, {0.0512: "p\u00a0=\u00a00.051", 1e-9: "p\u00a0<\u00a01e\u20116"}),
    (text.duration, {math.nan: "", 0.0: "0 s", 5e-8: "0.05 µs", 0.0951: "95.1 ms", 0.9999: "1 s", 59.96: "1 min"}),
    (text.duration, {90.0: "1.5 min", 86399.0: "1 day", 2.69 * 31557600.0: "2.69 years", math.inf: "∞"}),
    (lambda lag: text.lag_text(lag, None), {4.1: "4.1 samples"}),
    (lambda lag: text.lag_text(lag, 0.003), {4.1: "12.3 ms"}),
    (lambda lag: text.lag_in_full(lag, None), {4.1: "4.1 samples"}),
    (lambda lag: text.lag_in_full(lag, 0.003), {4.1: "12.3 ms (4.1 samples)"}),
    (text.decibels, {13.0157: "13.0 dB", -13.0157: "−13.0 dB", -0.0: "0 dB"}),
    (text.frequency, {1.592: "1.59 Hz", 999.9: "1.00 kHz", 3e6: "3.00 MHz", 0.0: "0 Hz", math.nan: "none"}),
    (text.frequency, {1e-8: "1 / 3.17 years"}),
    (text.sample_rate, {0.01: "100 Hz", 900.0: "one every 15 min"}),
    (text.squared, {"counts": "counts²", "°C": "°C²", "m/s²": "(m/s²)²", "": "unit²"}),
]


@pytest.mark.parametrize(("write", "written"), WRITTEN)
def test_how_a_value_is_written(write, written):
    assert {value: write(value) for value in written} == written


@given(st.floats(-1e300, 1e300), st.integers(1, 8))
def test_a_number_reads_back_to_its_digits(value, digits):
    written = text.number(value, digits)
    assert typed_number("q", written) == float(f"{value:.{digits - 1}e}")
    assert not re.match(r"−0(\.0*)?$", written)


def test_a_number_that_would_become_zero_is_refused_with_the_smallest_one():
    assert [typed_number("q", written) for written in ("0", "0.0", "0e9", "-0", "5e-324")] == [0, 0, 0, 0, 5e-324]
    for written in ("1e-400", "-1e-400", "0,001e-330"):
        with pytest.raises(BadSetting, match="q must be 0 or at least 5e-324 in size"):
            typed_number("q", written)


@given(st.one_of(st.integers(1, 400).map(float), st.floats(1e-3, 1e6).map(lambda x: float(f"{x:.9g}"))))
def test_a_gate_that_is_shown_and_typed_again_is_the_same(gate):
    assert typed_gate(gate_digits(gate)) == typed_gate(f"{gate_digits(gate)} σ") == gate


def test_a_gate_is_written_in_standard_deviations():
    assert (gate_text(16.0), gate_digits(16.0), typed_gate("4")) == ("4 σ", "4", 16.0)
    assert (gate_text(None), gate_digits(None), typed_gate(" Off "), typed_gate("")) == ("off", "", None, None)
    assert typed_gate("3,5") == 12.25
    for refused in ("0", "-4", "four", "inf"):
        with pytest.raises(BadSetting, match="outlier gate must be"):
            typed_gate(refused)
