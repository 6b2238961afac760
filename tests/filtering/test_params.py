"""What FilterParams accepts, refuses and derives; where tuning starts."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from each import each

from kalscope import (
    BadSetting,
    FilterParams,
    KalmanFilter,
    denoise,
    kalman_filter,
    log_likelihood,
    smooth,
    starting_params,
    steady_state,
)


@each(
    ("given", "message"),
    [
        ({"q": -1, "r": 1}, "q must be a finite variance from 0 to 1e300 (got -1)"),
        ({"q": 1, "r": math.nan}, "r must be a finite variance from 0 to 1e300 (got nan)"),
        ({"q": math.inf, "r": 1}, "q must be a finite variance from 0 to 1e300 (got inf)"),
        ({"q": 1.1e300, "r": 1}, "q must be a finite variance"),
        ({"q": "abc", "r": 1}, "q must be a finite variance from 0 to 1e300 (got 'abc')"),
        ({"q": 0, "r": 0}, "q and r must not both be 0"),
        ({"q": [1, 0], "r": [1, 0]}, "q and r must not both be 0"),
        ({"q": 1, "r": 1, "p0": -1}, "p0 must be a finite variance"),
        ({"q": 1, "r": 1, "x0": 1}, "x0 needs p0"),
        ({"q": 1, "r": 1, "p0": 1, "x0": math.nan}, "x0 must be a finite number"),
        ({"q": 1, "r": 1, "gate": 0}, "gate must be a finite threshold"),
        ({"q": [1, 2], "r": [1, 2, 3]}, "one value per channel (got [2, 3] values)"),
        ({"q": [[1]], "r": 1}, "q must be a finite variance"),
        ({"q": [], "r": 1}, "q must be a finite variance"),
    ],
)
def test_a_bad_value_is_refused_with_what_must_hold_and_what_came(given, message):
    with pytest.raises(BadSetting) as refused:
        FilterParams(**given)
    assert message in str(refused.value)


@pytest.mark.parametrize("given", [{"q": 0, "r": 1}, {"q": 1, "r": 0}, {"q": 1e300, "r": 1e-300, "p0": 0}])
def test_edges_of_the_range_are_valid(given):
    assert FilterParams(**given).q == given["q"]


def test_params_are_frozen_values_with_equality():
    a, b = FilterParams([1, 2], 3, p0=0), FilterParams(np.array([1.0, 2.0]), 3.0, p0=0.0)
    assert a == b
    assert hash(a) == hash(b)
    assert a != FilterParams([1, 2], 4, p0=0)
    assert a != FilterParams(1, 3, p0=0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        a.q = 2
    with pytest.raises(ValueError, match="read-only"):
        a.q[0] = 7


def test_params_do_not_share_memory_with_what_they_were_made_from():
    q = np.array([1.0, 2.0])
    params = FilterParams(q, 1.0)
    q[0] = 99.0
    assert params.q[0] == 1.0


def test_ratio_is_q_over_r():
    assert FilterParams(1, 4).ratio == 0.25
    assert FilterParams(1, 0).ratio == math.inf
    assert FilterParams([1, 2], 4).ratio.tolist() == [0.25, 0.5]


def test_tuning_starts_at_half_the_variance_of_the_differences():
    z = np.array([1.0, 3.0, 2.0, 5.0, 4.0])
    params = starting_params(z)
    assert params.r == pytest.approx(np.var(np.diff(z), ddof=1) / 2)
    assert params.q == pytest.approx(params.r / 100)
    assert (params.p0, params.x0) == (None, None)


@pytest.mark.parametrize("z", [np.arange(100) * 0.1 + 3, 5e6 - 0.3 * np.arange(500), [1.0, 2.0, 3.0]])
def test_an_even_ramp_starts_at_half_the_square_of_its_step_not_at_its_rounding(z):
    assert starting_params(z).r == pytest.approx((z[1] - z[0]) ** 2 / 2)


def test_what_wobbles_in_its_last_bit_stands_still():
    assert starting_params([3.3, math.nextafter(3.3, 4)] * 9).r == pytest.approx(0.0033**2)


@each("scale", [1e-140, 1e-9, 1.0, 1e9, 1e140])
def test_the_start_follows_the_unit_of_the_signal(scale):
    z = np.array([1.0, 3.0, 2.0, 5.0, 4.0])
    assert starting_params(z * scale).r == pytest.approx(starting_params(z).r * scale**2, rel=1e-9)


@each("z", [[], [1.0], [math.nan] * 5, [0.0] * 9, [7.0] * 9, [1e200, -1e200, 1e200], [5e-324] * 3])
def test_every_signal_has_a_usable_start(z):
    params = starting_params(z)
    assert params.r > 0
    assert params.q > 0


@each("function", [kalman_filter, denoise, smooth, log_likelihood, lambda _, params: KalmanFilter(params)])
def test_the_params_of_an_estimate_without_any_are_refused_in_words(function):
    with pytest.raises(BadSetting, match=r"FilterParams \(got None\): where estimate finds no usable q and r"):
        function(np.ones(3), None)
    with pytest.raises(BadSetting, match="params must be FilterParams"):
        steady_state(None)
