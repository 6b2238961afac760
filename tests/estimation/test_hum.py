"""Narrow lines: found where they are, explained as aliases, offered as a notch only where they are no movement."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope import BadSetting, tune
from kalscope.estimation.hum import find_line, notch_for
from kalscope.estimation.request import Request, find_parameters
from kalscope.filtering.steady import steady_state

RNG = np.random.default_rng(8)


def record(cycles, size=2.0, n=4000):
    """A random walk in noise of 1 unit, with a sine."""
    z = np.cumsum(0.1 * RNG.normal(size=n)) + RNG.normal(size=n)
    return z + size * np.sin(2.0 * np.pi * cycles * np.arange(n) + 1.0)


@pytest.mark.parametrize("cycles", [0.021, 0.1, 0.2718, 0.494])
def test_a_line_is_found_where_it_is_with_its_size(cycles):
    """In any unit, also behind missing samples."""
    z = record(cycles)
    z[:40] = np.nan
    for scale in (1.0, 1e-200, 1e300):
        line = find_line(scale * z)
        assert line.frequency == pytest.approx(cycles, abs=2e-4)
        assert line.of_record * np.nanvar(z) == pytest.approx(2.0, rel=0.15)
        assert line.of_noise == pytest.approx(2.0 / 3.0, abs=0.05)


def test_no_line_is_found_without_one():
    """Nor in gaps, spikes, steps, rounding or too few samples; `benchmarks/hum_exam.py` has the rate."""
    z = record(0.1, size=0.0)
    spiky, gappy = z.copy(), z.copy()
    spiky[::97] += 40.0
    gappy[RNG.random(len(z)) < 0.05] = np.nan
    steps = z + 20.0 * (np.arange(len(z)) // 700 % 2)
    for one in (z, spiky, gappy, steps, np.round(z), np.zeros(500), z[:100], np.full(400, np.nan)):
        assert find_line(one) is None
    assert find_line(record(0.1), 1.0 + RNG.random(4000)) is None


@pytest.mark.parametrize(
    ("cycles", "period", "advice"),
    [
        (0.25, 0.005, "hum at 50.0 Hz is "),
        (0.2, 0.016, "hum at 12.5 Hz, as 50 Hz appears at 62.5 samples a second, is "),
        (0.13, 0.005, "the narrow line at 26.0 Hz is "),
        (0.1, 0.5, None),
        (0.1, None, None),
    ],
)
def test_advice_says_what_the_line_is_an_alias_of_and_leaves_movement_alone(cycles, period, advice):
    line = find_line(record(cycles) + 0.01 * np.arange(4000))
    text = line.advice(period)
    assert text.startswith(advice.replace("second, is", "second is")) if advice else text == ""
    assert ("unless it is what you measure" in text) == bool(advice and advice.startswith("the narrow"))


def test_q_and_r_are_found_behind_the_notch_as_without_the_hum():
    z = record(0.2)
    found, plain = tune(z, notch="auto"), find_parameters(record(0.2, size=0.0))
    assert found.params.ratio == pytest.approx(plain.params.ratio, rel=0.3)
    assert found.params.r == pytest.approx(1.0, rel=0.1)
    notch = found.tuning.channels[0].chain.notch
    assert notch.frequency == pytest.approx(0.2, abs=1e-3)
    assert np.abs(found.x[500:] - tune(z).x[500:]).max() < 3.0
    assert find_parameters(z, Request(notch=60.0), sample_period=0.004).chain.notch.frequency == pytest.approx(0.24)
    assert find_parameters(record(0.2, size=0.0), Request(notch="auto")).chain is None


@pytest.mark.parametrize(
    ("period", "says"), [(None, "needs the time between two samples"), (0.02, "which appears at 0 Hz")]
)
def test_a_notch_that_cannot_be_is_refused(period, says):
    with pytest.raises(BadSetting, match=says):
        notch_for(np.zeros(10), None, 50.0, period)


def test_the_lag_of_a_notch_is_part_of_the_goal():
    z = record(0.2)
    found = find_parameters(z, Request(target={"lag_s": 0.05}, notch=50.0), sample_period=0.004)
    lag = found.chain.notch.lag + steady_state(found.params).lag_samples
    assert lag == pytest.approx(0.05 / 0.004, rel=1e-6)
    assert found.how == found.request.goal == "a lag of 50 ms"
    for request, says in (
        (Request(target={"lag_samples": 0.05}, notch=50.0), "the notch has nearly that much"),
        (Request(two_speeds=True, notch="auto"), "two speeds run without a notch"),
    ):
        with pytest.raises(BadSetting, match=says):
            find_parameters(z, request, sample_period=0.004)
