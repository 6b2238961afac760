"""What FilterParams accepts, refuses and derives; the noise that stands for an estimate."""

from __future__ import annotations

import copy
import dataclasses
import math

import numpy as np
import pytest

from kalscope import BadSetting, FilterParams, KalmanFilter, denoise, kalman_filter, smooth, steady_state
from kalscope.estimation.likelihood import log_likelihood
from kalscope.estimation.noise import noise_scale


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"q": -1, "r": 1}, "q must be a finite variance from 0 to 1e300 (got -1)"),
        ({"q": "abc", "r": 1}, "q must be a finite variance from 0 to 1e300 (got 'abc')"),
        ({"q": 0, "r": 0}, "q and r must not both be 0"),
        ({"q": 1, "r": 1, "p0": -1}, "p0 must be a finite variance"),
        ({"q": 1, "r": 1, "x0": 1}, "x0 needs p0"),
        ({"q": 1, "r": 1, "p0": 1, "x0": math.nan}, "x0 must be a finite number"),
        ({"q": 1, "r": 1, "gate": 0}, "gate must be a finite threshold"),
        ({"q": [1, 2], "r": [1, 2]}, "q must be a finite variance"),
        *(({"q": 1, "r": 1, "momentum": tau}, "must be a number of sample periods from 0 to 1e5")
          for tau in (-1.0, math.nan, 1.1e5, "long")),
        ({"q": 1, "r": []}, "r must have one value per sensor"),
        ({"q": 1, "r": [1.0, -1.0]}, "r must be a finite variance from 0 to 1e300 (got -1.0)"),
        ({"q": 1, "r": [0.0, 0.0]}, "at most one r may be 0"),
        ({"q": 1, "r": 1, "offset": [1.0, 2.0]}, "offset must have one value per sensor"),
        ({"q": 1, "r": [1, 4], "offset": "ab"}, "offset must be a number of a size up to 1e200 (got 'ab')"),
        ({"q": 1, "r": [1, 4], "gain": [1.0, 0.0]}, "gain must be a number of a size from 1e-100 to 1e100 (got"),
        ({"q": 1, "r": [1e-200, 1.0], "gain": [1e90, 1.0]}, "r/gain² must be"),
    ],
)  # fmt: skip
def test_a_bad_value_is_refused_with_what_must_hold_and_what_came(given, message):
    with pytest.raises(BadSetting) as refused:
        FilterParams(**given)
    assert message in str(refused.value)


def test_params_are_frozen_values_with_equality():
    given = np.array([1.0, 4.0])
    a, b = FilterParams(1.0, given, p0=0, gate=9), FilterParams(1, [1, 4], 0.0, gate=9.0, offset=[0, 0], gain=1)
    given[0] = 99.0
    for one in (a, copy.deepcopy(a), eval(repr(a))):
        assert one == b
        assert hash(one) == hash(b)
        for array in (one.r, one.offset, one.gain):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 7
    for other in ({"gain": [1, 2]}, {"offset": [1, 0]}, {"q": 2}, {"gate": None}, {"r": 1}, {"momentum": 1e-9}):
        assert a != FilterParams(**{"q": 1, "r": [1, 4], "p0": 0, "gate": 9, **other})
    assert FilterParams(1, 1) != FilterParams(1, [1])  # the second one takes a table of one column
    with pytest.raises(dataclasses.FrozenInstanceError):
        a.q = 2


@pytest.mark.parametrize("momentum", [0.0, -0.0, 5e-324, 1e-300, 9e-13])
def test_a_momentum_too_short_to_change_a_digit_is_none(momentum):
    assert FilterParams(1.0, 1.0, momentum=momentum) == FilterParams(1.0, 1.0)
    assert FilterParams(1.0, 1.0, momentum=2e-12).momentum == 2e-12


def test_some_sensors_are_a_filter_too_and_ratio_is_q_over_the_r_of_all():
    rest = {"p0": 3.0, "x0": 0.5, "gate": 9.0, "momentum": 7.0}
    params = FilterParams(1.0, [1.0, 2.0, 4.0], **rest, offset=[0.0, 1.0, 2.0], gain=[1.0, -1.0, 2.0])
    assert params.only([2, 0]) == FilterParams(1.0, [4.0, 1.0], **rest, offset=[2.0, 0.0], gain=[2.0, 1.0])
    assert params.shares.tolist() == pytest.approx([0.4, 0.2, 0.4])
    given = ((4, 1.0), (0, 1.0), ([8, 8], 1.0), (4, 2.0))
    assert [FilterParams(1, r, gain=gain).ratio for r, gain in given] == [0.25, math.inf, 0.25, 1.0]


def test_a_noise_without_an_estimate_is_half_the_variance_of_the_differences():
    """Of an even ramp half the square of its step, not its rounding; what wobbles in its last bit stands still."""
    z = np.array([1.0, 3.0, 2.0, 5.0, 4.0])
    for scale in (1e-140, 1.0, 1e140):
        assert noise_scale(z * scale) == pytest.approx(np.var(np.diff(z), ddof=1) / 2 * scale**2, rel=1e-9)
    for ramp in (np.arange(100) * 0.1 + 3, 5e6 - 0.3 * np.arange(500)):
        assert noise_scale(ramp) == pytest.approx((ramp[1] - ramp[0]) ** 2 / 2)
    assert noise_scale([3.3, math.nextafter(3.3, 4)] * 9) == pytest.approx(0.0033**2)


@pytest.mark.parametrize(
    "function", [kalman_filter, denoise, smooth, log_likelihood, lambda _, params: KalmanFilter(params)]
)
def test_the_params_of_an_estimate_without_any_are_refused_in_words(function):
    with pytest.raises(BadSetting, match=r"FilterParams \(got None\): where estimate finds no usable q and r"):
        function(np.ones(3), None)
    with pytest.raises(BadSetting, match="params must be FilterParams"):
        steady_state(None)
