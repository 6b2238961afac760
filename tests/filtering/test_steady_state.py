"""The settled filter: every closed form against the filter itself, exact gains, and there and back again."""

from __future__ import annotations

import decimal
import math
from decimal import Decimal

import numpy as np
import pytest

from kalscope import BadSetting, FilterParams, kalman_filter, params_for_specification, ratio_for, steady_state

T = 0.02


PAIRS = [(ratio, 1.0, 0.0) for ratio in (1e-4, 1e-2, 0.1, 1.0, 3.9, 25.0)]
PAIRS += [(0.01, 1.0, 20.0), (1e-4, 1.0, 5.0), (1.0, 1.0, 0.05), (1.0, 1.0, 0.5), (100.0, 1.0, 1000.0)]
PAIRS += [(1e4, 1.0, 1e5), (0.3, 1.0, 1e-6), (10.0, 1.0, 3.0), (1e3, 1.0, 10.0)]


def test_limits():
    """Above q/r = 4 there is no cut-off; at 1e12 (−λ + √(λ² + 4λ))/2 would give exactly 1; no −0 dB."""
    assert steady_state(FilterParams(4.0, 1.0), T).cutoff_hz == pytest.approx(0.5 / T)
    assert math.isnan(steady_state(FilterParams(4.1, 1.0), T).cutoff_hz)
    large = steady_state(FilterParams(1e12, 1.0))
    assert (large.gain, large.lag_samples) == (
        pytest.approx(1.0 - 1e-12, abs=1e-15),
        pytest.approx(1e-12, rel=1e-9),
    )
    still, raw = steady_state(FilterParams(0.0, 1.0), T), steady_state(FilterParams(1.0, 0.0), T)
    assert (still.gain, still.lag_samples, still.cutoff_hz, still.settle_samples) == (0, math.inf, 0, math.inf)
    assert (raw.gain, raw.lag_samples, raw.noise_reduction_db, raw.settle_samples) == (1, 0, 0, 0)
    assert str(steady_state(FilterParams(1.0, 0.0, momentum=20.0)).noise_reduction_db) == "0.0"


def settled_answer(q, r, momentum, n=6000):
    """The filter's answer to one sample of 1 among zeros, long after its start: shape (n,)."""
    start = 6000
    z = np.zeros(start + n)
    z[start] = 1.0
    result = kalman_filter(z, FilterParams(q, r, p0=r, x0=0.0, momentum=momentum))
    return result.x[start:], result.velocity[start] if momentum else 0.0, result.k[start]


@pytest.mark.parametrize(("q", "r", "momentum"), PAIRS)
def test_gains_lag_noise_and_overshoot_are_those_of_the_filter(q, r, momentum):
    answer, velocity, gain = settled_answer(q, r, momentum)
    found = steady_state(FilterParams(q, r, momentum=momentum))
    step = np.cumsum(answer)
    outside = np.flatnonzero(np.abs(1.0 - step) > 0.01)
    assert (found.gain, found.p) == pytest.approx((gain, gain * r), rel=1e-12)
    assert found.velocity_gain == pytest.approx(velocity, rel=1e-9)
    assert found.lag_samples == pytest.approx(answer @ np.arange(len(answer)), rel=1e-8, abs=1e-8)
    assert found.noise_reduction_db == pytest.approx(-10 * math.log10(answer @ answer), abs=1e-3)
    assert found.overshoot == pytest.approx(max(0.0, step.max() - 1.0), rel=1e-4, abs=1e-9)
    if momentum:  # without it the moment between two samples is known
        assert found.settle_samples == (outside[-1] + 2 if len(outside) else 1)


@pytest.mark.slow
@pytest.mark.parametrize("momentum", [1e-12, 1e-6, 1e-3, 0.02, 0.3, 2.0, 50.0, 3e3, 1e5])
def test_gains_and_what_follows_are_those_of_the_riccati_equation_in_fifty_digits(momentum):
    for ratio in (1e-12, 1e-5, 0.1, 6.0, 1e3, 1e12):
        found = steady_state(FilterParams(ratio, 1.0, momentum=momentum))
        left = 10.0 ** (-0.1 * found.noise_reduction_db)
        assert (found.gain, found.velocity_gain, found.lag_samples, left) == pytest.approx(
            exact(ratio, momentum), 1e-12
        )


def exact(ratio, momentum):
    """Gain, velocity gain, lag and noise of the settled filter, from the textbook matrices.

    The Riccati equation of the predicted covariance and the variance of the answer to white noise are solved by
    doubling (Chu, Fan & Lin 2005): each turn takes twice as many samples, so that a slow filter settles too.
    """
    with decimal.localcontext() as digits:
        digits.prec = 50
        q, tau, no = Decimal(ratio), Decimal(momentum), Decimal(0)
        one = np.array([[no + 1, no], [no, no + 1]])
        e = (-1 / tau).exp()
        u = 1 - e
        move = np.array([[1, tau * u], [no, e]])
        own, across = q * tau * (1 / tau - 2 * u + (1 - e * e) / 2), q * u * u / 2
        p = np.array([[own, across], [across, q / (2 * tau) * (1 - e * e)]])
        over, known, before = move.T, np.array([[Decimal(1), no], [no, no]]), no * p
        while abs(p - before).max() > Decimal("1e-30") * abs(p).max():
            before, share = p, inverse(one + known @ p)
            p = p + over.T @ p @ share @ over
            known = known + over @ share @ known @ over.T
            over = over @ share @ over
        gains = p[:, :1] / (p[0, 0] + 1)
        turn = move - gains @ move[:1]  # x and v without a new sample
        rest = inverse(one - turn)
        lag = (turn @ rest @ rest @ gains)[0, 0]
        power, noise = turn, gains @ gains.T
        while abs(power).max() > Decimal("1e-30"):
            noise, power = noise + power @ noise @ power.T, power @ power
        return float(gains[0, 0]), float(gains[1, 0]), float(lag), float(noise[0, 0])


def inverse(m):
    (a, b), (c, d) = m
    return np.array([[d, -b], [-c, a]]) / (a * d - b * c)


@pytest.mark.parametrize(("q", "r"), [(1e-300, 1e300), (1e300, 1e-300), (1.0, 0.0), (0.0, 1.0), (1e-28, 1.0)])
@pytest.mark.parametrize("momentum", [1e-9, 1.0, 1e5])
def test_every_answer_is_a_number_at_every_edge(q, r, momentum):
    found = steady_state(FilterParams(q, r, momentum=momentum), 0.01)
    assert 0.0 <= found.gain <= 1.0
    assert 0.0 <= found.overshoot < 0.5
    assert min(found.lag_samples, found.noise_reduction_db + 1e-9, found.settle_samples) >= 0.0


TARGETS = {
    "lag_samples": (1e-3, 0.3, 2.0, 11.0, 400.0, 1e6),
    "lag_s": (1e-3, 0.05, 30.0),
    "gain": (1e-5, 0.02, 0.4, 0.97),
    "noise_reduction_db": (0.05, 3.0, 13.0, 60.0),
    "cutoff_hz": (1e-4, 0.3, 7.0, 24.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("momentum", [0.0, 1e-9, 0.05, 0.7, 5.0, 60.0, 3e3, 1e5])
@pytest.mark.parametrize("target", TARGETS)
def test_ratio_for_is_the_inverse_of_steady_state_at_any_momentum(target, momentum):
    for value in TARGETS[target]:
        ratio = ratio_for(**{target: value}, sample_period=T, momentum=momentum)
        found = getattr(steady_state(FilterParams(ratio, 1.0, momentum=momentum), T), target)
        assert found == pytest.approx(value, rel=1e-9)


# ---- an overshoot that is allowed


@pytest.mark.slow
@pytest.mark.parametrize("overshoot", [1e-4, 0.02, 0.1, 0.18])
@pytest.mark.parametrize(("target", "value"), [("lag_s", 0.5), ("noise_reduction_db", 12.0), ("cutoff_hz", 1.0)])
def test_lag_or_noise_or_cutoff_comes_back_together_with_the_overshoot(target, value, overshoot):
    params = params_for_specification(2.5, **{target: value}, sample_period=T, overshoot=overshoot)
    found = steady_state(params, T)
    assert params.r == 2.5
    assert getattr(found, target) == pytest.approx(value, rel=1e-9)
    assert found.overshoot == pytest.approx(overshoot, rel=1e-6)
    assert found.overshoot <= overshoot


@pytest.mark.slow
@pytest.mark.parametrize("lag", [0.7, 4.0, 60.0])
def test_no_filter_within_lag_and_overshoot_leaves_less_noise(lag):
    best = params_for_specification(1.0, lag_samples=lag, overshoot=0.07)
    least = steady_state(best).noise_reduction_db
    rng = np.random.default_rng(5)
    tried = 0
    for shift, stretch in np.exp(rng.normal(0.0, 0.7, (150, 2))):
        other = steady_state(FilterParams(best.q * shift, 1.0, momentum=min(best.momentum * stretch, 1e5)))
        within = other.lag_samples <= lag and other.overshoot <= 0.07
        tried += within
        assert not within or other.noise_reduction_db <= least + 1e-9
    assert tried > 20


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({}, "exactly one of"),
        ({"gain": 0.5, "lag_samples": 1}, "exactly one of"),
        ({"gain": 1.0}, r"gain must lie between 0 and 1 \(got 1\)"),
        ({"gain": -0.1}, r"gain must be a finite number above 0 \(got -0\.1\)"),
        ({"lag_samples": math.nan}, r"lag_samples must be a finite number above 0 \(got nan\)"),
        ({"lag_s": 0.1}, "lag_s needs sample_period"),
        ({"cutoff_hz": 30.0, "sample_period": T}, r"at most half the sample rate, 25 Hz \(got 30\)"),
        ({"lag_s": 0.1, "sample_period": 0}, r"sample_period must be a finite number above 0 \(got 0\)"),
        ({"lag_samples": 5.0, "overshoot": 0.3}, r"at most 20\.55 % of a step with this target \(got 30 %\)"),
        ({"gain": 0.9, "overshoot": 0.2}, r"at most 7\.44 % of a step with this target \(got 20 %\)"),
        ({"lag_samples": 5.0, "overshoot": -0.1}, r"overshoot must be a share .* \(got -0\.1\)"),
        ({"lag_samples": 5.0, "overshoot": 0.1, "momentum": 3.0}, r"without momentum.*\(got 3\)"),
        ({"lag_samples": 5.0, "momentum": -1.0}, "momentum must be a number of sample periods"),
    ],
)
def test_what_no_filter_has_is_refused_with_what_is_possible(asked, says):
    with pytest.raises(BadSetting, match=says):
        params_for_specification(1.0, **asked)
