"""Chains and their filters as values: what they accept, what they say of themselves, and how they settle."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import freqz

from kalscope import BadSetting, FilterParams, ratio_for, steady_state
from kalscope.classic import Butterworth, Chain, Exponential, Median, MovingAverage, OneEuro
from kalscope.filtering.classic import ChainFilter

PARAMS = FilterParams(0.04, 1.0, gate=9.0)


def settled(chain, z, params=PARAMS, period=None):
    used = ChainFilter(chain, params)
    return used.settled(used.run(z), period)


def noise(n=20_000):
    return np.random.default_rng(5).normal(size=n)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: MovingAverage(0), "window must be a whole number from 1 to 100000 (got 0)"),
        (lambda: MovingAverage(True), "window must be a whole number from 1 to 100000 (got True)"),
        (lambda: Median(4), "window must be an odd number of samples, such as 5 (got 4)"),
        (lambda: Exponential(math.nan), "alpha must be a number from 9.31e-10 to 1 (got nan)"),
        (lambda: Butterworth(0.5), "cutoff in cycles per sample must be a number from 1e-06 to 0.499 (got 0.5)"),
        (lambda: OneEuro(1.0, 1.0, 0.0), "speed_cutoff in cycles per sample must be a number from 1e-12 to 1e+09"),
        (lambda: OneEuro(1.0, 10**400, 1.0), "beta must be a number from 0 to 1e+300 (got 1000"),
        (lambda: Chain(2), "median must be an odd number of samples, such as 3 (got 2)"),
        (Chain, "a chain must have a median of at least 3 samples, or a filter in place of Kalman's (got neither)"),
        (lambda: Chain(3, "one-euro"), "then must be a classic filter, or None for the Kalman filter (got"),
    ],
)  # fmt: skip
def test_what_is_no_setting_is_refused_in_words(make, says):
    with pytest.raises(BadSetting) as refused:
        make()
    assert str(refused.value).startswith(says)


def test_a_chain_is_a_value_with_words():
    chain = Chain(np.int64(5), OneEuro(np.float32(0.5), 2, 0.25))
    assert chain == Chain(5.0, OneEuro(0.5, 2.0, 0.25))
    assert hash(chain) == hash(replace(chain))
    assert len({chain, Chain(5), Chain(5, Exponential(0.1)), Chain(3)}) == 4
    assert chain.words == "median of 5, then one-euro (cut-off 0.5, β 2)"
    assert Chain(3).words == "median of 3, then Kalman"
    assert Chain(1, Butterworth(0.1)).words == "2nd-order Butterworth (cut-off 0.1)"


def test_a_linear_filter_settles_by_formula_as_its_answer_to_a_step_and_to_a_wave():
    impulse, n = np.zeros(4000), 2000
    impulse[n:] = np.r_[1.0, np.zeros(n - 1)]
    step = np.cumsum(impulse)
    for stage in (MovingAverage(25), Exponential(0.07), Butterworth(0.012)):
        found = settled(Chain(1, stage), impulse, period=0.01)
        h, s = (ChainFilter(Chain(1, stage), PARAMS).denoise(z)[n:] for z in (impulse, step))
        assert found.gain == pytest.approx(h[0])
        assert found.lag_samples == pytest.approx(np.sum(np.arange(n) * h), rel=1e-9)
        assert found.lag_s == pytest.approx(0.01 * found.lag_samples)
        assert found.noise_reduction_db == pytest.approx(-10 * np.log10(np.sum(h**2)), rel=1e-9)
        at_cutoff = freqz(h, worN=[2 * np.pi * 0.01 * found.cutoff_hz])[1][0]
        assert abs(at_cutoff) == pytest.approx(math.sqrt(0.5), rel=1e-9)
        assert found.settle_samples == pytest.approx(np.flatnonzero(np.abs(s - 1) > 0.01)[-1] + 2, abs=2)
        assert found.overshoot == pytest.approx(s.max() - 1, abs=1e-3)
        assert math.isnan(found.p)


def test_a_median_or_a_one_euro_filter_is_measured_on_the_noise_and_speed_of_the_run():
    z = noise()
    kalman, both = steady_state(PARAMS), settled(Chain(5), z)
    assert both.lag_samples == pytest.approx(kalman.lag_samples + 2, abs=0.05)
    assert both.settle_samples == kalman.settle_samples + 2
    assert (both.gain, both.p) == (kalman.gain, kalman.p)
    left = ChainFilter(Chain(5), PARAMS).denoise(noise(200_000))[1000:]
    assert both.noise_reduction_db == pytest.approx(-10 * np.log10(np.mean(left**2)), abs=0.2)
    middle = settled(Chain(1, Median(9)), z, period=2.0)
    assert middle.lag_s == pytest.approx(8.0, abs=0.1)
    assert math.isnan(middle.gain)
    assert math.isnan(middle.cutoff_hz)
    slow, quick = (settled(Chain(3, OneEuro(0.01, beta, 0.01)), z) for beta in (0.0, 3.0))
    assert quick.lag_samples < 0.5 * slow.lag_samples
    assert slow.noise_reduction_db > quick.noise_reduction_db + 3


def test_a_slow_filter_behind_a_median_is_not_taken_for_one_that_has_settled():
    """No ramp is long enough for a lag of 10,000 samples, or without end: a quicker filter is measured instead."""
    z = noise()
    slow, quick = (FilterParams(ratio_for(lag_samples=lag), 1.0, p0=1.0, x0=1e9) for lag in (10_000.0, 90.0))
    found, own = settled(Chain(5), z, slow), steady_state(slow)
    assert found.lag_samples == pytest.approx(10_002.0)
    lost = settled(Chain(5), z, quick).noise_reduction_db - steady_state(quick).noise_reduction_db
    assert found.noise_reduction_db - own.noise_reduction_db == pytest.approx(lost, abs=0.15)
    never = settled(Chain(5), z, FilterParams(0.0, 1.0))
    assert (never.lag_samples, never.noise_reduction_db, never.settle_samples) == (math.inf, math.inf, math.inf)
