"""Densities and Allan deviations of signals whose laws are known, and the filter's response by brute force."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from kalscope import BadSetting, FilterParams, kalman_filter, steady_state
from kalscope.analysis.spectrum import allan_deviation, allan_model, magnitude_response, spectrum, whole_stretch

RNG = np.random.default_rng(21)
PARAMS = FilterParams(q=0.01, r=1.0)


@pytest.mark.parametrize("period", [None, 0.01, 86400.0])
def test_the_density_of_white_noise_is_flat_and_integrates_to_its_variance(period):
    z = 3.0 * RNG.normal(size=200_000)
    found = spectrum(z, PARAMS, sample_period=period)
    step = found.frequency[1] - found.frequency[0]
    assert np.sum(found.raw) * step == pytest.approx(z.var(), rel=0.01)
    assert found.frequency[-1] == pytest.approx(0.5 / (period or 1.0))
    assert np.mean(found.raw[:200]) == pytest.approx(np.mean(found.raw[-200:-1]), rel=0.1)
    assert found.in_hertz == (period is not None)


def test_filtered_density_is_the_raw_one_times_the_response_squared():
    found = spectrum(RNG.normal(size=400_000), PARAMS)
    passed = (found.filtered / found.raw)[5:-1]
    assert np.median(passed / found.response[5:-1] ** 2) == pytest.approx(1.0, rel=0.02)
    kept, gain = (found.residual / found.raw)[5:-1], float(steady_state(PARAMS).gain)
    transfer = gain / (1 - (1 - gain) * np.exp(-2j * np.pi * found.frequency[5:-1]))
    assert np.median(kept / np.abs(1 - transfer) ** 2) == pytest.approx(1.0, rel=0.02)


MOVING = [(0.01, 0.0), (0.01, 20.0), (1e-4, 300.0), (1.0, 0.3), (30.0, 5.0), (1e3, 1e5), (1e-6, 3e3), (0.1, 0.01)]


@pytest.mark.parametrize(("q", "momentum"), [(1e-6, 0.0), (1e4, 0.0), *MOVING])
def test_the_response_is_the_fourier_transform_of_what_the_filter_answers(q, momentum):
    params = FilterParams(q=q, r=1.0, p0=1.0, x0=0.0, momentum=momentum)
    start, n = 1 << 15, 1 << 15
    z = np.zeros(start + n)
    z[start] = 1.0  # long after the start
    dense = np.abs(np.fft.rfft(kalman_filter(z, params).x[start:]))
    frequency = np.arange(len(dense)) / n
    assert np.allclose(magnitude_response(params, frequency), dense, rtol=0, atol=2e-6)
    assert magnitude_response(params, 0.0) == pytest.approx(1.0, abs=1e-12)
    assert np.all(magnitude_response(FilterParams(q=0.0, r=1.0), frequency) == 0.0)
    cutoff = steady_state(params, 1.0).cutoff_hz
    if not math.isnan(cutoff):
        assert magnitude_response(params, cutoff) == pytest.approx(math.sqrt(0.5), rel=1e-9)


def test_missing_samples_the_longest_whole_stretch_or_lines_and_the_note_says_which():
    z = RNG.normal(size=1000)
    assert whole_stretch(z) == (slice(0, 1000), "No sample is missing.")
    z[100] = np.nan
    part, note = whole_stretch(z)
    assert (part, "Samples 101 to 999, the longest stretch" in note) == (slice(101, 1000), True)
    z[::5] = z[:3] = np.nan
    part, note = whole_stretch(z)
    assert (part, note.startswith("202 missing samples are interpolated linearly")) == (slice(3, 1000), True)
    assert np.isfinite(spectrum(z, PARAMS).filtered).all()
    assert whole_stretch(np.full(5, np.nan))[0] == slice(0, 0)


def test_too_short_records_have_no_density_and_no_allan_deviation():
    for n in (0, 1, 31):
        found = spectrum(np.arange(float(n)), PARAMS)
        assert (found.samples, len(found.frequency), "needs 32 samples" in found.note) == (0, 0, True)
    for z in (np.arange(3.0), np.full(100, np.nan)):
        assert "too short" in allan_deviation(z, PARAMS).message
    for function in (spectrum, allan_deviation):
        with pytest.raises(BadSetting, match="one channel"):
            function(np.zeros((40, 2)), PARAMS)


@pytest.mark.slow
@pytest.mark.parametrize(("q", "r"), [(0.0, 4.0), (1e-4, 1.0), (0.25, 0.0), (1e-2, 9.0)])
def test_allan_of_simulated_noise_and_walk_follows_the_model(q, r):
    n = 400_000
    z = 5.0 + math.sqrt(r) * RNG.normal(size=n) + np.cumsum(math.sqrt(q) * RNG.normal(size=n))
    found = allan_deviation(z, FilterParams(q=q, r=r), sample_period=0.5)
    assert np.all(np.abs(found.deviation - found.model) < 5.0 * found.spread + 1e-12)
    assert np.array_equal(found.tau, 0.5 * found.size)
    assert found.size[-1] > 1e4


def test_allan_deviation_is_its_definition_gaps_left_out():
    z = RNG.normal(size=400)
    z[[50, 51, 170]] = np.nan
    found = allan_deviation(z, PARAMS)
    for size, deviation in zip(found.size.astype(int), found.deviation, strict=True):
        means = np.array([z[i : i + size].mean() for i in range(len(z) - size + 1)])
        jumps = means[size:] - means[:-size]
        assert deviation == pytest.approx(math.sqrt(np.nanmean(jumps**2) / 2))


@pytest.mark.parametrize("momentum", [1e-9, 0.3, 5.0, 80.0, 3e3, 1e5])
def test_allan_of_the_model_with_momentum_is_its_definition(momentum):
    """Two averages of a process that is off by q(k - τ + τ exp(-k/τ)) after k samples, in the mean square."""
    for size in (1, 2, 7, 40, 300):
        apart = np.abs(np.subtract.outer(np.arange(2.0 * size), np.arange(2.0 * size)))
        off = 2.0 * (apart + momentum * np.expm1(-apart / momentum))
        weights = np.repeat([-1.0 / size, 1.0 / size], size)
        expected = -0.25 * weights @ off @ weights + 3.0 / size
        assert float(allan_model(size, 2.0, 3.0, momentum)) == pytest.approx(expected, rel=1e-11)


def test_the_words_name_the_minimum_of_model_and_recording():
    n = 100_000
    z = RNG.normal(size=n) + np.cumsum(0.01 * RNG.normal(size=n))
    said = allan_deviation(z, FilterParams(q=1e-4, r=1.0), sample_period=0.01).message
    assert "averaging longer than 1.73 s (173 samples) does not help" in said
    assert "In this recording it stops helping at" in said
    assert "always help" in allan_deviation(RNG.normal(size=n), FilterParams(q=0.0, r=1.0)).message
    walk = allan_deviation(np.cumsum(RNG.normal(size=n)), FilterParams(q=1.0, r=0.0)).message
    assert all(words in walk for words in ("does not help at all", "averaging never helps"))
    assert "is constant" in allan_deviation(np.full(500, 5.0), FilterParams(q=1.0, r=1.0)).message
    swing = np.sin(np.arange(n) * 2 * np.pi / 60) + 0.001 * RNG.normal(size=n)
    assert re.search(r"over less than \d+ samples does not help", allan_deviation(swing, PARAMS).message)
