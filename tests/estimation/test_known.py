"""q and r from a still stretch, a data sheet, a wish, or one of the two."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kalscope import BadSetting, FilterParams, steady_state
from kalscope.estimation.estimate import estimate
from kalscope.estimation.known import (
    estimate_fixed_r,
    estimate_fixed_ratio,
    noise_from_datasheet,
    noise_from_still,
    params_for_specification,
)
from kalscope.estimation.likelihood.profile import log_likelihood


def walk(n, ratio, seed=0):
    g = np.random.default_rng(seed)
    return np.cumsum(g.normal(0, math.sqrt(ratio), n)) + g.normal(0, 1, n)


# --- a still stretch ------------------------------------------------------------------------------------


def test_still_noise_is_the_variance_about_a_straight_line():
    g = np.random.default_rng(0)
    z = 20 + 0.3 * np.arange(4000) + g.normal(0, 0.5, 4000)
    z[100:150] = np.nan
    found = noise_from_still(z)
    i = np.flatnonzero(np.isfinite(z))
    residual = z[i] - np.polyval(np.polyfit(i, z[i], 1), i)
    assert found.r == found.variance == pytest.approx(residual @ residual / (len(i) - 2), rel=1e-9)
    assert found.r == pytest.approx(0.25, rel=0.1)
    assert found.drift == pytest.approx(0.3, rel=1e-3)
    assert found.samples == len(i)


def test_still_noise_is_at_least_that_of_the_steps():
    """A 10-bit converter that toggles once in 200 readings: the floor Δ²/12 is more than its variance."""
    step = 0.0049
    z = np.full(200, 3 * step)
    z[77] = 4 * step
    found = noise_from_still(z)
    assert found.quantum == pytest.approx(step, rel=1e-9)
    assert found.r == found.floor == pytest.approx(step**2 / 12)
    assert found.variance < found.floor
    assert "steps" in found.message


def test_the_step_found_is_not_the_rounding_of_decimal_numbers():
    z = np.array([0.1 * k for k in (1, 2, 3, 2, 1, 3, 2, 1)] + [0.30000000000000004, 0.1 + 0.2])
    assert noise_from_still(z).quantum == pytest.approx(0.1)


def test_a_given_quantum_speaks_for_readings_that_never_change():
    assert noise_from_still([5.0] * 20, quantum=0.5).r == pytest.approx(0.25 / 12)


@pytest.mark.parametrize(
    ("z", "quantum"),
    [([5.0] * 20, None), ([1.0, 2.0, 3.0], None), (np.ones((9, 2)), None), ([np.inf] * 9, None), ([1.0] * 9, -1.0)],
)
def test_a_stretch_without_noise_to_measure_is_refused(z, quantum):
    with pytest.raises(BadSetting):
        noise_from_still(z, quantum)


# --- the data sheet -------------------------------------------------------------------------------------


def test_noise_from_a_data_sheet():
    assert noise_from_datasheet(sigma=0.03) == pytest.approx(9e-4)
    assert noise_from_datasheet(density=400e-6, bandwidth_hz=50.0) == pytest.approx(400e-6**2 * 50)


@pytest.mark.parametrize(
    "values",
    [{}, {"sigma": 1.0, "density": 1.0}, {"density": 1.0}, {"sigma": 0.0}, {"density": 1.0, "bandwidth_hz": -1.0}],
)
def test_half_a_data_sheet_is_refused(values):
    with pytest.raises(BadSetting):
        noise_from_datasheet(**values)


# --- a wish ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wish", "field", "value"),
    [
        ({"gain": 0.2}, "gain", 0.2),
        ({"lag_samples": 4.0}, "lag_samples", 4.0),
        ({"lag_s": 0.05, "sample_period": 0.01}, "lag_s", 0.05),
        ({"cutoff_hz": 3.0, "sample_period": 0.01}, "cutoff_hz", 3.0),
        ({"noise_reduction_db": 12.0}, "noise_reduction_db", 12.0),
    ],
)
def test_the_settled_filter_has_what_was_asked(wish, field, value):
    params = params_for_specification(2.5, **wish)
    assert params.r == 2.5
    assert getattr(steady_state(params, 0.01), field) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize("r", [0.0, -1.0, math.nan, math.inf])
def test_a_wish_needs_a_noise_variance(r):
    with pytest.raises(BadSetting):
        params_for_specification(r, gain=0.5)


# --- one of the two is fixed ----------------------------------------------------------------------------


def test_fixed_r_finds_the_best_q_for_it(nile):
    found = estimate_fixed_r(nile, 10_000.0)
    assert (found.method, found.r) == ("fixed_r", pytest.approx(10_000.0))
    q = found.q * np.linspace(0.8, 1.2, 401)
    best = q[np.argmax([log_likelihood(nile, FilterParams(v, 10_000.0)) for v in q])]
    assert found.q == pytest.approx(best, rel=1.1e-3)
    assert found.loglik == pytest.approx(log_likelihood(nile, FilterParams(found.q, 10_000.0)), rel=1e-12)
    assert found.loglik < estimate(nile).loglik


def test_fixing_r_at_the_ml_value_finds_the_ml_pair(nile):
    ml = estimate(nile)
    assert estimate_fixed_r(nile, ml.r).q == pytest.approx(ml.q, rel=1e-8)


@pytest.mark.parametrize("s", [1e-9, 1e9])
def test_fixed_r_in_another_unit(nile, s):
    one, other = estimate_fixed_r(nile, 1e4), estimate_fixed_r(nile * s, 1e4 * s * s)
    assert other.q == pytest.approx(one.q * s * s, rel=1e-6)


def test_far_too_large_an_r_leaves_no_movement_and_far_too_small_an_r_takes_all_for_movement(nile):
    assert estimate_fixed_r(nile, 1e7).verdict == "no_movement"
    tiny = estimate_fixed_r(nile, 1e-30)
    assert tiny.verdict == "ok"
    assert tiny.q == pytest.approx(np.mean(np.diff(nile) ** 2), rel=1e-6)


def test_fixed_ratio_finds_the_best_r_for_it(nile):
    found = estimate_fixed_ratio(nile)
    assert found.ratio == pytest.approx(0.01)
    r = found.r * np.linspace(0.9, 1.1, 401)
    best = r[np.argmax([log_likelihood(nile, FilterParams(0.01 * v, v)) for v in r])]
    assert found.r == pytest.approx(best, rel=6e-4)
    assert "contradicts" in found.message  # 0.01 is outside the Nile's 0.0137 … 0.557
    assert "allows" in estimate_fixed_ratio(nile, 0.1).message
    assert found.params is not None


def test_several_channels_and_poor_records():
    z = np.stack([walk(200, 0.1), np.zeros(200)], axis=1)
    for found in (estimate_fixed_r(z, 1.0), estimate_fixed_ratio(z)):
        assert found.verdict.tolist() == ["ok", "constant"]
    assert estimate_fixed_r(z[:, 0], 1e200).verdict == "bad_unit"
    with pytest.raises(BadSetting):
        estimate_fixed_r(z, 0.0)
    with pytest.raises(BadSetting):
        estimate_fixed_ratio(z, math.nan)
