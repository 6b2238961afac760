"""Filters with momentum from a specification: what was asked comes back from the settled filter."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kalscope import BadSetting, FilterParams, kalman_filter, params_for_specification, ratio_for, steady_state

T = 0.02
MOMENTA = (0.0, 1e-9, 0.05, 0.7, 5.0, 60.0, 3e3, 1e5)
TARGETS = [
    *(("lag_samples", value) for value in (1e-3, 0.3, 2.0, 11.0, 400.0, 1e6)),
    *(("lag_s", value) for value in (1e-3, 0.05, 30.0)),
    *(("gain", value) for value in (1e-5, 0.02, 0.4, 0.97)),
    *(("noise_reduction_db", value) for value in (0.05, 3.0, 13.0, 60.0)),
    *(("cutoff_hz", value) for value in (1e-4, 0.3, 7.0, 24.0)),
]


@pytest.mark.slow
@pytest.mark.parametrize("momentum", MOMENTA)
@pytest.mark.parametrize(("target", "value"), TARGETS)
def test_ratio_for_is_the_inverse_of_steady_state_at_any_momentum(target, value, momentum):
    ratio = ratio_for(**{target: value}, sample_period=T, momentum=momentum)
    found = getattr(steady_state(FilterParams(ratio, 1.0, momentum=momentum), T), target)
    assert found == pytest.approx(value, rel=1e-9)


# ---- an overshoot that is allowed


@pytest.mark.slow
@pytest.mark.parametrize("overshoot", [1e-4, 0.02, 0.1, 0.18])
@pytest.mark.parametrize(
    ("target", "value"),
    [("lag_samples", 0.4), ("lag_samples", 5.0), ("lag_s", 0.5), ("noise_reduction_db", 12.0), ("cutoff_hz", 1.0)],
)
def test_lag_or_noise_or_cutoff_comes_back_together_with_the_overshoot(target, value, overshoot):
    params = params_for_specification(2.5, **{target: value}, sample_period=T, overshoot=overshoot)
    found = steady_state(params, T)
    assert params.r == 2.5
    assert getattr(found, target) == pytest.approx(value, rel=1e-9)
    assert found.overshoot == pytest.approx(overshoot, rel=1e-6)
    assert found.overshoot <= overshoot


def test_the_filter_itself_has_the_lag_and_the_overshoot_that_were_asked():
    params = params_for_specification(4.0, lag_samples=6.0, overshoot=0.08)
    step = kalman_filter(np.repeat([0.0, 1.0], 3000), params).x[3000:]
    assert step.max() == pytest.approx(1.08, abs=1e-9)
    ramp = np.arange(6000.0)
    assert ramp[-1] - kalman_filter(ramp, params).x[-1] == pytest.approx(6.0, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("lag", [0.7, 4.0, 60.0])
def test_no_filter_within_lag_and_overshoot_leaves_less_noise(lag):
    best = params_for_specification(1.0, lag_samples=lag, overshoot=0.07)
    least = steady_state(best).noise_reduction_db
    rng = np.random.default_rng(5)
    tried = 0
    for shift, stretch in rng.normal(0.0, 0.7, (150, 2)):
        other = steady_state(
            FilterParams(best.q * math.exp(shift), 1.0, momentum=min(best.momentum * math.exp(stretch), 1e5))
        )
        if other.lag_samples <= lag and other.overshoot <= 0.07:
            tried += 1
            assert other.noise_reduction_db <= least + 1e-9
    assert tried > 20


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({"lag_samples": 5.0, "overshoot": 0.3}, r"at most 20\.55 % of a step with this target \(got 30 %\)"),
        ({"gain": 0.9, "overshoot": 0.2}, r"at most 7\.44 % of a step with this target \(got 20 %\)"),
        ({"lag_samples": 5.0, "overshoot": -0.1}, r"overshoot must be a share .* \(got -0\.1\)"),
        ({"overshoot": 0.1}, "exactly one of"),
        ({"lag_samples": 5.0, "overshoot": 0.1, "momentum": 3.0}, r"without momentum.*\(got 3\)"),
        ({"lag_samples": 5.0, "momentum": -1.0}, "momentum must be a number of sample periods"),
    ],
)
def test_what_no_filter_has_is_refused_with_what_is_possible(asked, says):
    with pytest.raises(BadSetting, match=says):
        params_for_specification(1.0, **asked)


@pytest.mark.parametrize(("ratio", "tau"), [(1e-7, 3e4), (1e-9, 8e4), (1e-8, 3e3)])
def test_the_step_of_a_slow_filter_is_exact(ratio, tau):
    settled = steady_state(FilterParams(ratio, 1.0, momentum=tau), 1.0)
    e, f, x, v = math.exp(-1.0 / tau), -tau * math.expm1(-1.0 / tau), 0.0, 0.0
    errors = [1.0]
    for _ in range(400_000):
        ahead = x + f * v
        x, v = ahead + settled.gain * (1.0 - ahead), e * v + settled.velocity_gain * (1.0 - ahead)
        errors.append(1.0 - x)
    error = np.array(errors)
    assert settled.overshoot == pytest.approx(max(0.0, -error.min()), rel=1e-7, abs=1e-12)
    assert settled.settle_samples == pytest.approx(np.flatnonzero(np.abs(error) > 0.01)[-1] + 1, abs=1)
