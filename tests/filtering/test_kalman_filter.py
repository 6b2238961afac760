"""The filter and the smoother: its parameters, laws and published numbers."""

from __future__ import annotations

import copy
import dataclasses
import math

import numpy as np
import pytest

from kalscope import BadSetting, FilterParams, KalmanFilter, denoise, fuse, kalman_filter, smooth, steady_state
from kalscope.estimation.likelihood import log_likelihood
from kalscope.estimation.noise import noise_scale
from kalscope.estimation.request import starting_params


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


def noisy_walk(n=2000, q=0.01, r=1.0, seed=0, missing=0.0):
    g = np.random.default_rng(seed)
    z = np.cumsum(g.normal(0, math.sqrt(q), n)) + g.normal(0, math.sqrt(r), n)
    z[g.random(n) < missing] = np.nan
    return z


# --- the source documents -------------------------------------------------------------------------------


def test_nile_steps_and_log_likelihood_are_the_published_ones(nile):
    """Durbin & Koopman (2012), section 2.10; log-likelihood in the n - 1 convention, as KFAS prints it."""
    result = kalman_filter(nile, FilterParams(1469.1, 15099.0))
    assert result.x[:4] == pytest.approx([1120.0, 1140.92784, 1072.79853, 1117.30895], abs=5e-6)
    assert result.innovation[1:4] == pytest.approx([40.0, -177.92784, 137.20147], abs=5e-6)
    assert result.s[1:4] == pytest.approx([31667.1, 24467.83638, 22349.56994], abs=5e-6)
    assert result.p[-1] == pytest.approx(4032.158, abs=1e-3)
    assert result.k[-1] == pytest.approx(0.267048, abs=1e-6)
    assert result.m == 99
    assert kalman_filter(nile, FilterParams(1469.18, 15098.52)).loglik == pytest.approx(-632.5456, abs=5e-5)


def test_a_start_variance_far_above_r_is_the_unknown_start():
    """Where 1 - k is 0 in double, p = (1 - k) p would keep the first sample for ever."""
    z = noisy_walk(500, q=0.0, seed=7)
    for momentum, p0 in ((0.0, 1e17), (0.0, 1e300), (5.0, 1e17)):
        params = FilterParams(q=0.0, r=1.0, p0=p0, x0=0.0, momentum=momentum)
        means = np.cumsum(z) / np.arange(1, len(z) + 1)
        assert kalman_filter(z, params).x == pytest.approx(means, rel=1e-9)
        assert smooth(z, params).x == pytest.approx(np.full(len(z), means[-1]), rel=1e-9)


# --- laws -----------------------------------------------------------------------------------------------


# --- momentum -----------------------------------------------------------------------------------------


# --- several sensors ----------------------------------------------------------------------------------


def test_the_gate_of_one_sensor_does_not_touch_the_others_and_lets_go():
    z = np.ones((14, 2))
    z[8:, 1] = 100.0
    found = fuse(z, FilterParams(0.01, [1.0, 1.0], gate=9.0))
    assert found.rejected.tolist() == [0, 5]  # five rows, then the jump is taken
    assert found.k[13, 1] > 0.0
    assert np.all(found.k[8:13, 1] == 0.0)
    np.testing.assert_allclose(found.x[8:13], 1.0)
    assert np.all(found.k[8:13, 0] > 0.0)


def test_a_row_that_is_refused_leaves_the_state():
    stream = KalmanFilter(FilterParams(1.0, [1.0, 2.0], gain=[1.0, 1e-90]))
    stream.update([3.0, np.nan])
    for row in ([1.0], [1.0, 2.0, 3.0], [[1.0, 2.0], [1.0, 2.0]], [np.inf, 1.0], [1.0, 1e250]):
        with pytest.raises(BadSetting):
            stream.update(row)
    with pytest.raises(BadSetting, match="dt"):
        stream.update([1.0, 2.0], -1.0)
    assert (stream.x, stream.p) == (3.0, 1.0)


# --- the gate -------------------------------------------------------------------------------------------


def test_a_masked_sample_is_missing():
    masked, plain = np.ma.array([1, 2, 5, 4], mask=[False, True, False, False]), [1, math.nan, 5, 4]
    params = FilterParams(1, 1)
    np.testing.assert_array_equal(kalman_filter(masked, params).x, kalman_filter(plain, params).x)
    assert starting_params(masked).r == starting_params(plain).r


# --- what is refused ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: kalman_filter([1.0, math.inf], FilterParams(1, 1)), "or NaN where missing (got inf at sample 1)"),
        (lambda: kalman_filter([[[1.0]]], FilterParams(1, 1)), "have shape (n,) (got shape (1, 1, 1))"),
        (lambda: kalman_filter(["a"], FilterParams(1, 1)), "z must be an array of numbers"),
        (lambda: kalman_filter([1.0, 2.0], FilterParams(1, 1), dt=[1.0]), "shape (2,) (got (1,))"),
        (lambda: kalman_filter([1.0, 2.0], FilterParams(1, 1), dt=[1.0, -1.0]), "not negative"),
        (lambda: kalman_filter([1.0], FilterParams(1, [1, 1])), "a column for each of the 2 sensors (got shape"),
        (lambda: fuse([1.0], FilterParams(1, 1)), "r must be one variance per sensor"),
        (lambda: denoise([1.0], FilterParams(1, 1), out=np.empty(2)), "out must be a writeable float64 array"),
        (lambda: KalmanFilter(FilterParams(1, 1)).update(math.inf), "or NaN where missing (got inf at sample 0)"),
        (lambda: KalmanFilter(FilterParams(1, 1)).update(1.0, dt=-1), "dt must be finite and not negative"),
    ],
)
def test_what_cannot_be_filtered_is_refused_with_its_reason(call, message):
    with pytest.raises(BadSetting) as refused:
        call()
    assert message in str(refused.value)


@pytest.mark.parametrize(("q", "r"), [(0, 1), (1, 0), (1e300, 1e-300), (1e-300, 1e300), (1e300, 1e300)])
def test_extreme_variances_give_finite_answers(q, r):
    z = noisy_walk(500, missing=0.1)
    for start in ((None, None), (0.0, 1.0), (1e300, 1.0)):
        params = FilterParams(q, r, *start)
        result = kalman_filter(z, params)
        assert np.isfinite(result.x).all()
        assert ((result.k >= 0) & (result.k <= 1)).all()
        assert np.abs(denoise(z, params) - result.x).max() <= 1e-12 * np.nanmax(np.abs(z))


# --- published tables -----------------------------------------------------------------------------------


def test_nile_smoothed_level_is_the_published_one(nile):
    """Durbin & Koopman (2012), figure 2.2, at r = 15099, q = 1469.1."""
    x = smooth(nile, FilterParams(q=1469.1, r=15099.0)).x
    assert x[[0, 99]] == pytest.approx([1111.66832, 798.37029], abs=5e-6)


def test_norwegian_road_fatalities_smoothed_level_is_the_published_one(norway):
    """Commandeur & Koopman (2007), section 2.3, level[1] = 6.3048 as printed by sinhrks' R script."""
    x = smooth(np.log(norway), FilterParams(q=0.0047026, r=0.00326838)).x
    assert x[0] == pytest.approx(6.3048, abs=5e-5)


def test_prior_at_the_first_sample_gives_the_columns_of_the_marss_guide(nile):
    """MARSS user guide, KFAS chapter: a1 = 0, P1 = 1000, q = 15210.195, r = 33874.59; dt[0] = 0 states it."""
    dt = np.r_[0.0, np.ones(99)]
    got = smooth(nile, FilterParams(q=15210.195, r=33874.59, p0=1000.0, x0=0.0), dt)
    x = [64.38081, 569.63686, 809.81105, 981.20113, 1049.85712]
    x += [1069.05730, 1047.42286, 1131.04778, 1170.24168, 1119.74113]
    p = [942.3097, 8128.6821, 10055.5588, 10572.2107, 10710.7402]
    assert got.x[:10] == pytest.approx(x, abs=1e-5)  # q and r are printed to eight and seven digits
    assert got.p[:5] == pytest.approx(p, rel=1e-7)
    half = 1.959964 * math.sqrt(got.p[0])
    assert (got.x[0] - half, got.x[0] + half) == pytest.approx((4.215678, 124.5460), abs=1e-4)


def test_exact_diffuse_start_gives_the_ten_points_of_kfas():
    """statsmodels' results_exact_initial_local_level_R.csv (KFAS 1.3.1): alphahat and sumV."""
    got = smooth([10.2394] + [1.0] * 9, FilterParams(q=8.253, r=1.993))
    x = [8.69269189482201, 2.28778372019385, 1.21557953089427, 1.03608877283924, 1.00604138771061]
    x += [1.00101134968464, 1.0001693041059, 1.00002834572536, 1.00000476680865, 1.00000092721546]
    p = [1.65936477978876, 1.42808320855318, 1.4216017878374, 1.42142015300846, 1.42141506687939]
    assert got.x == pytest.approx(x, rel=1e-13)
    assert got.p == pytest.approx(p + p[::-1], rel=1e-13)


# --- edges ----------------------------------------------------------------------------------------------


def test_without_measurement_noise_samples_stay_and_gaps_are_bridged():
    got = smooth([1.0, math.nan, 3.0, 7.0], FilterParams(q=2.0, r=0.0))
    assert got.x.tolist() == [1.0, 2.0, 3.0, 7.0]
    assert got.p.tolist() == [0.0, 1.0, 0.0, 0.0]


def test_refused_sample_counts_as_missing():
    z = noisy_walk(300, 0.05, seed=4)
    z[100] += 50.0
    params = FilterParams(q=0.05, r=1.0, gate=16.0)
    assert kalman_filter(z, params).rejected == 1
    without = np.where(np.arange(len(z)) == 100, math.nan, z)
    assert np.array_equal(smooth(z, params).x, smooth(without, FilterParams(q=0.05, r=1.0)).x)
