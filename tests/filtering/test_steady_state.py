"""The settled filter: every closed form against the filter itself, and there and back again."""

from __future__ import annotations

import math

import pytest

from kalscope import BadSetting, FilterParams, ratio_for, steady_state

RATIOS = [1e-6, 1e-4, 1e-2, 0.1, 1.0, 3.9]
T = 0.02


@pytest.mark.parametrize("ratio", RATIOS[1:])
def test_settling_is_what_a_step_shows(ratio):
    steady = steady_state(FilterParams(ratio, 1.0), T)
    left = (1 - steady.gain) ** steady.settle_samples
    assert left == pytest.approx(0.01)


def test_above_four_there_is_no_cutoff():
    assert steady_state(FilterParams(4.0, 1.0), T).cutoff_hz == pytest.approx(0.5 / T)
    assert math.isnan(steady_state(FilterParams(4.1, 1.0), T).cutoff_hz)


@pytest.mark.parametrize(("q", "r"), [(1e300, 1e-300), (1e-300, 1e300), (1e300, 1e300), (1e-300, 1e-300)])
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


@pytest.mark.parametrize(
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
