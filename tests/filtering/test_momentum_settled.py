"""What the filter settles to, against the filter itself run until it has settled, and exact gains."""

from __future__ import annotations

import decimal
import math
from decimal import Decimal

import numpy as np
import pytest

from kalscope import FilterParams, kalman_filter, steady_state

PAIRS = (
    *((ratio, 1.0, 0.0) for ratio in (1e-4, 1e-2, 0.1, 1.0, 3.9, 25.0)),
    (0.01, 1.0, 20.0),
    (1e-4, 1.0, 5.0),
    (1.0, 1.0, 0.05),
    (1.0, 1.0, 0.5),
    (100.0, 1.0, 1000.0),
    (1e4, 1.0, 1e5),
    (0.3, 1.0, 1e-6),
    (10.0, 1.0, 3.0),
    (1e3, 1.0, 10.0),
)


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
    assert found.gain == pytest.approx(gain, rel=1e-12)
    assert found.velocity_gain == pytest.approx(velocity, rel=1e-9)
    assert found.p == pytest.approx(gain * r, rel=1e-12)
    assert found.lag_samples == pytest.approx(answer @ np.arange(len(answer)), rel=1e-8, abs=1e-8)
    assert found.noise_reduction_db == pytest.approx(-10 * math.log10(answer @ answer), abs=1e-3)
    assert found.overshoot == pytest.approx(max(0.0, step.max() - 1.0), rel=1e-4, abs=1e-9)
    if momentum:  # without it the moment between two samples is known
        assert found.settle_samples == (outside[-1] + 2 if len(outside) else 1)


@pytest.mark.parametrize(("q", "r", "momentum"), PAIRS)
def test_at_the_cutoff_half_of_the_power_passes(q, r, momentum):
    answer, *_ = settled_answer(q, r, momentum)
    cutoff = steady_state(FilterParams(q, r, momentum=momentum), sample_period=1.0).cutoff_hz
    if math.isnan(cutoff):
        nyquist = abs(answer @ (-1.0) ** np.arange(len(answer))) ** 2
        assert nyquist > 0.5
        return
    passed = abs(answer @ np.exp(-2j * np.pi * cutoff * np.arange(len(answer)))) ** 2
    assert passed == pytest.approx(0.5, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("momentum", [1e-12, 1e-6, 1e-3, 0.02, 0.3, 2.0, 50.0, 3e3, 1e5])
def test_gains_and_what_follows_are_those_of_the_riccati_equation_in_fifty_digits(momentum):
    for ratio in (1e-12, 1e-5, 0.1, 6.0, 1e3, 1e12):
        gain, velocity_gain, lag, noise = exact(ratio, momentum)
        found = steady_state(FilterParams(ratio, 1.0, momentum=momentum))
        assert found.gain == pytest.approx(gain, rel=1e-12)
        assert found.velocity_gain == pytest.approx(velocity_gain, rel=1e-12)
        assert found.lag_samples == pytest.approx(lag, rel=1e-12)
        assert 10.0 ** (-0.1 * found.noise_reduction_db) == pytest.approx(noise, rel=1e-12)


def exact(ratio, momentum):
    """Gain, velocity gain, lag and noise of the settled filter, from the textbook matrices.

    The Riccati equation of the predicted covariance and the variance of the answer to white noise are solved by
    doubling (Chu, Fan & Lin 2005): each turn takes twice as many samples, so that a slow filter settles too.
    """
    with decimal.localcontext() as digits:
        digits.prec = 50
        q, tau, no, one = (
            Decimal(ratio),
            Decimal(momentum),
            Decimal(0),
            np.array([[Decimal(1), 0], [0, Decimal(1)]]),
        )
        e = (-1 / tau).exp()
        u = 1 - e
        move = np.array([[1, tau * u], [no, e]])
        across = q * u * u / 2
        p = np.array(
            [[q * tau * (1 / tau - 2 * u + (1 - e * e) / 2), across], [across, q / (2 * tau) * (1 - e * e)]]
        )
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
    assert found.lag_samples >= 0.0
    assert found.noise_reduction_db >= -1e-9
    assert 0.0 <= found.overshoot < 0.5
    assert found.settle_samples >= 0.0


def test_a_sensor_without_noise_is_reduced_by_0_and_not_by_minus_0():
    reduction = steady_state(FilterParams(1.0, 0.0, momentum=20.0)).noise_reduction_db
    assert str(reduction) == "0.0"
