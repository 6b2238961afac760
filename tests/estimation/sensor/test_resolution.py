"""The step of the readings, and what is found where the noise is smaller than that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kalscope import estimate, kalman_filter, steady_state
from kalscope.common.text import percent
from kalscope.estimation.likelihood import log_likelihood
from kalscope.estimation.noise import resolution_of

WALK = np.cumsum(np.random.default_rng(0).normal(0, 0.1, 3000))
FAHRENHEIT = (np.rint(1.8 * WALK + 70) - 32) / 1.8
OFF_GRID = np.where(np.arange(3000) % 100 == 0, WALK, np.round(WALK, 1))
MIXED = np.where(np.arange(3000) < 1500, np.round(WALK, 1), np.round(WALK, 2))


def walk(n, movement, sigma, seed=0):
    """A walk and its readings, in steps of the sensor."""
    g = np.random.default_rng(seed)
    truth = np.cumsum(g.normal(0, movement, n)) + g.uniform()
    return truth, np.rint(truth + g.normal(0, sigma, n))


# --- the step -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("readings", "step"),
    [
        (np.rint(WALK * 3), 1.0),
        (np.round(WALK, 1), 0.1),
        (np.round(WALK, 1) + 1e6, 0.1),
        (np.float64(np.float32(np.round(WALK, 1))), 0.1),
        (np.rint(WALK * 100) * 5 / 1023, 5 / 1023),
        (np.round(np.rint(WALK * 100) * 5 / 1023, 3), 5 / 1023),
        (np.round(np.rint(WALK * 16) / 16, 2), 1 / 16),
        (FAHRENHEIT, 1 / 1.8),
        (np.round(FAHRENHEIT, 1), 1 / 1.8),
        (OFF_GRID, 0.1),
        (MIXED, 0.01),
        (np.array([1.0, 1.0, 2.0, 1.0]), 1.0),
    ],
    ids=[
        *("counts", "decimals", "offset", "float32", "volts", "volts printed", "sixteenths printed"),
        *("converted", "converted and printed", "one in a hundred beside", "mixed", "two levels"),
    ],
)
def test_the_step_of_the_sensor_is_found(readings, step):
    assert resolution_of(readings) == pytest.approx(step, rel=2e-3)
    assert resolution_of(-3e7 * readings) == pytest.approx(3e7 * step, rel=2e-3)


@pytest.mark.parametrize(
    "readings", [WALK, np.sin(np.arange(900) / 7), np.exp(np.round(WALK, 1)), np.ones(9), np.empty(0)]
)
def test_readings_without_steps_show_none(readings):
    assert resolution_of(readings) == 0.0


# --- noise below the step -------------------------------------------------------------------------------


@pytest.mark.parametrize("sigma", [0.0, 0.05, 0.1])
@pytest.mark.parametrize("movement", [0.03, 0.1, 0.3])
def test_a_filter_below_the_resolution_is_better_than_none(movement, sigma):
    """By maximum likelihood alone r is down to a hundredth of the variance of rounding."""
    for seed in range(2):
        truth, z = walk(1500, movement, sigma, seed)
        found = estimate(z)
        if found.verdict != "below_resolution":
            assert found.r >= 1 / 12
            continue
        assert found.resolution == 1.0
        assert found.r == found.params.r == pytest.approx(1 / 12)
        assert np.mean((kalman_filter(z, found.params).x - truth) ** 2) < np.mean((z - truth) ** 2)


@pytest.mark.parametrize("momentum", ["auto", 0.0, 1e-3, 20.0])
def test_the_intervals_hold_the_filter_with_the_noise_of_rounding(momentum):
    """They were those of the smaller r, whose filters all lag less."""
    truth = 2 * np.sin(np.arange(3000) * np.pi / 50)
    found = estimate(np.rint(truth + np.random.default_rng(1).normal(0, 0.1, 3000)), momentum=momentum)
    assert found.verdict == "below_resolution"
    settled = steady_state(found.params)
    assert found.ratio_interval[0] < found.ratio < found.ratio_interval[1]
    assert found.gain_interval[0] < settled.gain < found.gain_interval[1]
    assert found.lag_interval[0] < settled.lag_samples < found.lag_interval[1]


def test_with_the_noise_of_rounding_q_is_the_most_likely_one_and_its_overshoot_is_named():
    truth = 2 * np.sin(np.arange(3000) * np.pi / 50)
    z = np.rint(truth + np.random.default_rng(1).normal(0, 0.1, 3000))
    found = estimate(z, momentum=20.0)
    assert f"goes {percent(steady_state(found.params).overshoot)} beyond a step" in found.message
    params = found.params
    best = log_likelihood(z, params)
    for factor in (0.9, 1.1):
        assert log_likelihood(z, replace(params, q=factor * params.q)) < best


def test_a_fast_signal_in_steps_keeps_its_verdict():
    """A counter, a jump: not the noise of the sensor is small, but the movement large."""
    for z in (np.arange(50.0), np.append(np.zeros(20), 1.0), np.round(1e3 * np.sin(np.arange(400.0)))):
        assert estimate(z).verdict != "below_resolution"


def test_a_switch_between_two_levels_shows_no_resolution():
    switch = np.repeat(np.arange(10.0) % 2.0, 50)
    found = estimate(switch)
    assert found.resolution == 0.0
    assert "rounds to" not in found.message
    assert estimate(np.repeat(np.arange(10.0) % 3.0, 50)).resolution == 1.0
