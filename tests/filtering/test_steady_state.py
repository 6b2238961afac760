"""The settled filter: every closed form against the filter itself, and there and back again."""

from __future__ import annotations

import math

import numpy as np
import pytest
from each import each

from kalscope import BadSetting, FilterParams, kalman_filter, ratio_for, steady_state

RATIOS = [1e-6, 1e-4, 1e-2, 0.1, 1.0, 3.9]
T = 0.02


@each("ratio", [1e-4, 1e-2, 0.1, 1.0, 25.0])
def test_gain_and_variance_are_where_the_filter_converges(ratio):
    z = np.random.default_rng(0).normal(size=5000)
    result = kalman_filter(z, FilterParams(ratio * 4.0, 4.0))
    steady = steady_state(FilterParams(ratio * 4.0, 4.0))
    assert steady.gain == pytest.approx(result.k[-1], rel=1e-12)
    assert steady.p == pytest.approx(result.p[-1], rel=1e-12)


@each("ratio", RATIOS[1:])
def test_lag_is_what_a_ramp_shows(ratio):
    ramp = np.arange(20_000.0)
    x = kalman_filter(ramp, FilterParams(ratio, 1.0)).x
    steady = steady_state(FilterParams(ratio, 1.0), T)
    assert ramp[-1] - x[-1] == pytest.approx(steady.lag_samples, rel=1e-6)
    assert steady.lag_s == pytest.approx(steady.lag_samples * T)


@each("ratio", RATIOS)
def test_cutoff_is_where_the_frequency_response_is_3_db_down(ratio):
    steady = steady_state(FilterParams(ratio, 1.0), T)
    w = 2 * math.pi * steady.cutoff_hz * T
    response = steady.gain / (1 - (1 - steady.gain) * np.exp(-1j * w))
    assert abs(response) ** 2 == pytest.approx(0.5, rel=1e-9)


@each("ratio", RATIOS[1:])
def test_settling_is_what_a_step_shows(ratio):
    steady = steady_state(FilterParams(ratio, 1.0), T)
    left = (1 - steady.gain) ** steady.settle_samples
    assert left == pytest.approx(0.01)


def test_above_four_there_is_no_cutoff():
    assert steady_state(FilterParams(4.0, 1.0), T).cutoff_hz == pytest.approx(0.5 / T)
    assert math.isnan(steady_state(FilterParams(4.1, 1.0), T).cutoff_hz)


@each(("q", "r"), [(1e300, 1e-300), (1e-300, 1e300), (1e300, 1e300), (1e-300, 1e-300)])
def test_extreme_pairs_neither_overflow_nor_turn_into_nan(q, r):
    steady = steady_state(FilterParams(q, r))
    assert 0 < steady.gain <= 1
    assert math.isfinite(steady.lag_samples)
    assert steady.gain == pytest.approx(1.0 if q > r else (0.6180339887498949 if q == r else 1e-300))


def test_large_ratios_keep_their_digits():
    """1 − K = K²/λ: at λ = 1e12 the form (−λ + √(λ² + 4λ))/2 gives exactly 1."""
    steady = steady_state(FilterParams(1e12, 1.0))
    assert steady.gain == pytest.approx(0.999999999999, abs=1e-15)
    assert steady.lag_samples == pytest.approx(1e-12, rel=1e-9)


def test_no_process_noise_never_settles_and_no_measurement_noise_never_smooths():
    still, raw = steady_state(FilterParams(0.0, 1.0), T), steady_state(FilterParams(1.0, 0.0), T)
    assert (still.gain, still.lag_samples, still.cutoff_hz, still.settle_samples) == (0, math.inf, 0, math.inf)
    assert (raw.gain, raw.lag_samples, raw.noise_reduction_db, raw.settle_samples) == (1, 0, 0, 0)


@each("ratio", RATIOS)
@each("wish", ["gain", "lag_samples", "lag_s", "cutoff_hz", "noise_reduction_db"])
def test_ratio_for_is_the_inverse_of_steady_state(ratio, wish):
    steady = steady_state(FilterParams(ratio, 1.0), T)
    back = ratio_for(**{wish: getattr(steady, wish)}, sample_period=T)
    assert back == pytest.approx(ratio, rel=1e-9)


@each(
    ("given", "message"),
    [
        ({}, "exactly one of"),
        ({"gain": 0.5, "lag_samples": 1}, "exactly one of"),
        ({"gain": 1.0}, "gain must lie between 0 and 1 (got 1)"),
        ({"gain": -0.1}, "gain must be a finite number above 0 (got -0.1)"),
        ({"lag_samples": math.nan}, "lag_samples must be a finite number above 0 (got nan)"),
        ({"lag_s": 0.1}, "lag_s needs sample_period"),
        ({"cutoff_hz": 30.0, "sample_period": T}, "cutoff_hz must be at most half the sample rate, 25 Hz (got 30)"),
        ({"lag_s": 0.1, "sample_period": 0}, "sample_period must be a finite number above 0 (got 0)"),
    ],
)
def test_wishes_that_cannot_be_met_are_refused(given, message):
    with pytest.raises(BadSetting) as refused:
        ratio_for(**given)
    assert message in str(refused.value)
