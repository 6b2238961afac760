"""How numbers and names read."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope_app.views.text import count, duration, frequency, number, plain, squared, typed


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.095124, "0.0951"),
        (13.0157, "13.0"),
        (999.6, "1000"),
        (15098.5, "15 100"),
        (-3.14159, "−3.14"),
        (1.234e-9, "1.23e-9"),
        (2e12, "2.00e12"),
        (-2e12, "−2.00e12"),
        (0.0, "0"),
        (math.inf, "∞"),
        (-math.inf, "−∞"),
        (math.nan, "none"),
    ],
)
def test_number(value, text):
    assert number(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(1e-9, "1e-9"), (0.0589, "0.0589"), (1e300, "1e300"), (0.0, "0"), (1469.18, "1469.18")],
)
def test_typed(value, text):
    assert typed(value) == text


@given(st.floats(1e-300, 1e300))
def test_typed_reads_back_to_eight_digits(value):
    assert float(typed(value)) == pytest.approx(value, rel=1e-7)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0951, "95.1 ms"),
        (2.0, "2 s"),
        (90.0, "1.5 min"),
        (31557600.0, "1 year"),
        (31557600.0 * 2.69, "2.69 years"),
        (86400.0, "1 day"),
        (5e-8, "0.05 µs"),
        (0.0, "0 s"),
        (math.inf, "∞"),
        (None, ""),
    ],
)
def test_duration(seconds, text):
    assert duration(seconds) == text


@pytest.mark.parametrize(
    ("hertz", "text"),
    [
        (1.592, "1.59 Hz"),
        (0.796, "0.796 Hz"),
        (2100.0, "2.10 kHz"),
        (1e-8, "1 / 3.17 years"),
        (0.0, "0 Hz"),
        (math.nan, "none"),
    ],
)
def test_frequency(hertz, text):
    assert frequency(hertz) == text


@pytest.mark.parametrize(
    ("unit", "text"),
    [("counts", "counts²"), ("°C", "°C²"), ("m/s²", "(m/s²)²"), ("1e8 m³", "(1e8 m³)²"), ("", "unit²")],
)
def test_squared(unit, text):
    assert squared(unit) == text


def test_count_groups_thousands():
    assert count(1234567) == "1 234 567"


@given(st.text(max_size=200))
def test_a_name_from_outside_carries_no_live_markup(name):
    shown = plain(name)
    assert "\n" not in shown
    assert len(shown) <= 122
    for i, mark in enumerate(shown):
        if mark in "<>&`[]!*_|#":
            assert shown[i - 1] == "\\"
