"""The comparison of a filter with momentum: its lag, noise and overshoot against direct simulation."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from kalscope import FilterParams, kalman_filter, params_for_specification, steady_state
from kalscope.analysis.alternatives import compare_alternatives
from kalscope.analysis.candidates import at_lag
from kalscope.filtering.classic import Bench

RNG = np.random.default_rng(31)


def moving(n=60_000, tau=60.0, q=0.3):
    """A signal that keeps its direction, and noise of variance 1."""
    fade = math.exp(-1.0 / tau)
    kicks = RNG.normal(size=n) * math.sqrt(0.5 * q / tau * (1.0 - fade * fade))
    v = np.empty(n)
    v[0] = 0.0
    for i in range(1, n):
        v[i] = fade * v[i - 1] + kicks[i]
    truth = np.cumsum(v)
    return truth, truth + RNG.normal(size=n), FilterParams(q, 1.0, momentum=tau)


def overshoot_of(run, size=20_000):
    step = np.repeat([0.0, 1.0], size)
    return max(0.0, float(np.nanmax(run(step))) - 1.0)


@pytest.mark.parametrize("lag", [0.7, 3.0, 9.5, 60.0])
def test_each_candidate_overshoots_a_step_as_it_is_said_to(lag):
    bench = Bench(noise=RNG.normal(size=5000), speed=0.2, samples=100_000, present_lag=lag)
    for one in at_lag(lag, bench):
        if one.name == "One-euro":  # what it answers depends on the size of the step; it never goes beyond
            assert one.overshoot == 0.0
            assert overshoot_of(one.run) <= 1e-12
        else:
            assert one.overshoot == pytest.approx(overshoot_of(one.run), abs=1e-6), one.name


def test_a_filter_with_momentum_is_compared_at_its_own_lag():
    truth, z, params = moving()
    found = compare_alternatives(z, params, truth=truth)
    steady = steady_state(params)
    assert found.present.lag_samples == steady.lag_samples
    assert found.present.overshoot == steady.overshoot > 0.05
    assert found.present.parameters == f"K = {steady.gain:.4g}, L = {steady.velocity_gain:.4g}"
    exponential = next(one for one in found.others if one.name == "Exponential")
    assert exponential.lag_samples == pytest.approx(steady.lag_samples)
    assert exponential.noise_reduction_db < steady.noise_reduction_db - 1.0
    assert found.present.rmse == pytest.approx(
        math.sqrt(np.mean((kalman_filter(z, params).x - truth)[-found.judged :] ** 2)), rel=1e-12
    )


@pytest.mark.slow
@pytest.mark.parametrize("match", ["lag", "noise"])
def test_where_the_signal_keeps_its_direction_nothing_simpler_is_better(match):
    truth, z, params = moving()
    found = compare_alternatives(z, params, match=match, truth=truth)
    assert "nothing simpler does better than your filter here" in found.verdict
    exponential = next(one for one in found.others if one.name == "Exponential")
    assert exponential.matched
    assert exponential.against.worse
    if match == "noise":
        assert exponential.noise_reduction_db == pytest.approx(found.present.noise_reduction_db)
        assert exponential.lag_samples > 2.0 * found.present.lag_samples


def test_the_identity_is_the_settled_recursion():
    _, z, params = moving()
    found = compare_alternatives(z, params)
    ahead, kept, gain, faster = map(float, re.findall(r"\d[\d.e-]*(?=·|\spredict)", found.identity)[:4])
    x = v = 0.0
    for _ in range(5000):
        x += ahead * v
        v *= kept
        e = 1.0 - x
        x += gain * e
        v += faster * e
    assert x == pytest.approx(1.0, abs=1e-3)
    steady = steady_state(params)
    assert (gain, faster) == pytest.approx((steady.gain, steady.velocity_gain), rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("momentum", [1e-6, 5.0, 1e5])
@pytest.mark.parametrize("match", ["lag", "noise"])
def test_every_momentum_can_be_compared(momentum, match):
    z = np.cumsum(RNG.normal(size=3000)) + 3.0 * RNG.normal(size=3000)
    found = compare_alternatives(z, FilterParams(0.5, 9.0, momentum=momentum), match=match)
    assert found.verdict
    assert np.isfinite(found.present.curve).all()


@pytest.mark.slow
def test_what_has_the_same_noise_is_measured_on_ramps_as_long_as_its_own_lag():
    _, z, _ = moving(20_000)
    params = params_for_specification(1.0, noise_reduction_db=26.0, momentum=1e5)
    assert steady_state(params).lag_samples < 5.0
    median = next(one for one in compare_alternatives(z, params, match="noise").others if one.name == "Median")
    window = int(median.parameters.split()[-1])
    assert window > 400
    assert median.lag_samples == pytest.approx(0.5 * (window - 1), rel=0.02)
