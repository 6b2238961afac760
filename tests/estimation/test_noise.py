"""The noise of a sensor from a still stretch and a data sheet; the step of the readings."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.support.signals import walk

from kalscope import BadSetting, estimate, kalman_filter, steady_state
from kalscope.common.text import percent
from kalscope.estimation.likelihood import log_likelihood
from kalscope.estimation.noise import noise_from_datasheet, noise_from_still, resolution_of
from kalscope.estimation.request import Noise, Request, find_parameters
from kalscope.estimation.still import MIN_SAMPLES, find_still_stretch

# --- a still stretch ------------------------------------------------------------------------------------


def test_still_noise_is_the_variance_about_a_straight_line():
    g = np.random.default_rng(0)
    z = 20 + 0.3 * np.arange(4000) + g.normal(0, 0.5, 4000)
    z[100:150] = np.nan
    found = noise_from_still(z)
    i = np.flatnonzero(np.isfinite(z))
    residual = z[i] - np.polyval(np.polyfit(i, z[i], 1), i)
    assert found.r == found.variance == pytest.approx(residual @ residual / (len(i) - 2), rel=1e-9)
    assert (found.drift, found.samples) == (pytest.approx(0.3, rel=1e-3), len(i))


def test_still_noise_is_at_least_that_of_the_steps():
    """A 10-bit converter that toggles once in 200 readings: the floor Δ²/12 is more than its variance."""
    step = 0.0049
    z = np.full(200, 3 * step)
    z[77] = 4 * step
    found = noise_from_still(z)
    assert (found.quantum, found.r, "steps" in found.message) == (pytest.approx(step), found.floor, True)
    assert found.variance < found.floor == pytest.approx(step**2 / 12)


def test_spikes_do_not_belong_to_the_noise_of_a_still_stretch():
    g = np.random.default_rng(1)
    good = 3 + 0.01 * np.arange(400) + g.normal(0, 0.5, 400)
    z = good.copy()
    z[::40] += 30.0
    found = noise_from_still(z)
    kept = np.where(np.arange(400) % 40 == 0, np.nan, good)
    assert (found.r, found.samples) == (pytest.approx(noise_from_still(kept).r, rel=1e-12), 390)
    assert found.message.endswith("10 spikes beyond 6 σ left out.")


def test_noise_from_a_data_sheet_and_what_is_refused():
    assert noise_from_datasheet(sigma=0.03) == pytest.approx(9e-4)
    assert noise_from_datasheet(density=400e-6, bandwidth_hz=50.0) == pytest.approx(400e-6**2 * 50)
    for values in ({}, {"sigma": 1.0, "density": 1.0}, {"density": 1.0}, {"sigma": 0.0}):
        with pytest.raises(BadSetting):
            noise_from_datasheet(**values)
    for z, quantum in (([5.0] * 20, None), ([1.0, 2.0, 3.0], None), ([np.inf] * 9, None), ([1.0] * 9, -1.0)):
        with pytest.raises(BadSetting):
            noise_from_still(z, quantum)


STILL = slice(700, 1200)
"""Where the records of this test do not move."""


def record(kind, seed=0, n=2000):
    """Movement with a pause, noise of variance 1."""
    g = np.random.default_rng(seed)
    moving = np.ones(n)
    moving[STILL] = 0.0
    truth = {
        "walk": lambda: np.cumsum(moving * g.normal(0, 0.5, n)),
        "sine": lambda: 20 * np.sin(np.cumsum(moving) / 40),
        "levels": lambda: np.where(moving > 0, np.repeat(g.normal(0, 10, n // 10), 10), 5.0),
        "shaken": lambda: moving * g.normal(0, 5, n),
    }[kind]()
    return truth + g.normal(size=n)


# --- found ----------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["walk", "sine", "levels", "shaken"])
def test_the_pause_of_a_movement_is_found_and_gives_r(kind):
    inside = 0
    for seed in range(10):
        z = record(kind, seed)
        first, last = find_still_stretch(z)
        assert abs(first - STILL.start) < 80
        assert abs(last - STILL.stop) < 80
        inside += abs(noise_from_still(z[first:last]).r - 1.0) < 1.96 * math.sqrt(2.0 / (last - first))
    assert inside >= 8  # of 10 at 95 %: fewer come once in a hundred times


def test_the_stretch_does_not_depend_on_unit_and_level_and_noise_alone_is_still_all_over():
    assert find_still_stretch(np.random.default_rng(0).normal(size=500)) == (0, 500 - 500 % 13)
    z = record("sine")
    found = find_still_stretch(z)
    assert find_still_stretch(1e5 + z) == found
    for unit in (-1e-6, 1e200, 1e-200):
        assert find_still_stretch(unit * z) == found


# --- none -----------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.1, 1e6])
def test_a_random_walk_has_none(ratio):
    found = [find_still_stretch(walk(800, ratio, seed)) for seed in range(60)]
    assert sum(one is not None for one in found) <= 1


NEVER_STILL = {
    "sine": np.sin(np.arange(2000) / 20),
    "sine and noise": 5 * np.sin(np.arange(2000) / 30) + np.random.default_rng(0).normal(size=2000),
    "constant": np.ones(500),
    "ramp": np.arange(500.0),
    "short": np.random.default_rng(0).normal(size=MIN_SAMPLES - 1),
    "missing": np.full(100, np.nan),
}


@pytest.mark.parametrize("z", NEVER_STILL.values(), ids=NEVER_STILL)
def test_what_never_pauses_has_none(z):
    assert find_still_stretch(z) is None


def test_a_record_without_a_still_stretch_is_refused_with_what_to_do():
    with pytest.raises(BadSetting, match=r"must show a still stretch, 52 samples or more .* \(got none\): give"):
        find_parameters(walk(500, 1.0, 0), Request(noise=Noise(still="auto")))


WALK = np.cumsum(np.random.default_rng(0).normal(0, 0.1, 3000))
FAHRENHEIT = (np.rint(1.8 * WALK + 70) - 32) / 1.8


# --- the step -------------------------------------------------------------------------------------------


STEPS = {
    "counts": (np.rint(WALK * 3), 1.0),
    "decimals": (np.round(WALK, 1), 0.1),
    "float32": (np.float64(np.float32(np.round(WALK, 1))), 0.1),
    "volts": (np.rint(WALK * 100) * 5 / 1023, 5 / 1023),
    "volts printed": (np.round(np.rint(WALK * 100) * 5 / 1023, 3), 5 / 1023),
    "converted and printed": (np.round(FAHRENHEIT, 1), 1 / 1.8),
    "one in a hundred beside": (np.where(np.arange(3000) % 100 == 0, WALK, np.round(WALK, 1)), 0.1),
    "mixed": (np.where(np.arange(3000) < 1500, np.round(WALK, 1), np.round(WALK, 2)), 0.01),
    "two levels": (np.array([1.0, 1.0, 2.0, 1.0]), 1.0),
}


@pytest.mark.parametrize(("readings", "step"), STEPS.values(), ids=STEPS)
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
        g = np.random.default_rng(seed)
        truth = np.cumsum(g.normal(0, movement, 1500)) + g.uniform()
        z = np.rint(truth + g.normal(0, sigma, 1500))
        found = estimate(z)
        if found.verdict != "below_resolution":
            assert found.r >= 1 / 12
            continue
        assert found.resolution == 1.0
        assert found.r == found.params.r == pytest.approx(1 / 12)
        assert np.mean((kalman_filter(z, found.params).x - truth) ** 2) < np.mean((z - truth) ** 2)


@pytest.mark.slow
@pytest.mark.parametrize("momentum", ["auto", 0.0, 1e-3, 20.0])
def test_the_intervals_hold_the_filter_with_the_noise_of_rounding(momentum):
    """They were those of the smaller r, whose filters all lag less."""
    truth = 2 * np.sin(np.arange(3000) * np.pi / 50)
    z = np.rint(truth + np.random.default_rng(1).normal(0, 0.1, 3000))
    found = estimate(z, momentum=momentum)
    assert found.verdict == "below_resolution"
    params, settled = found.params, steady_state(found.params)
    assert found.ratio_interval[0] < found.ratio < found.ratio_interval[1]
    assert found.gain_interval[0] < settled.gain < found.gain_interval[1]
    assert found.lag_interval[0] < settled.lag_samples < found.lag_interval[1]
    likelihoods = [log_likelihood(z, replace(params, q=factor * params.q)) for factor in (0.9, 1.0, 1.1)]
    assert max(likelihoods) == likelihoods[1]  # q is the most likely one beside this r
    overshoot = f"goes {percent(settled.overshoot)} beyond a step"
    assert (overshoot in found.message) == (settled.overshoot > 0.0)


@pytest.mark.slow
def test_a_fast_signal_in_steps_keeps_its_verdict_and_a_switch_shows_no_resolution():
    """A counter, a jump: not the noise of the sensor is small, but the movement large."""
    for z in (np.arange(50.0), np.append(np.zeros(20), 1.0), np.round(1e3 * np.sin(np.arange(400.0)))):
        assert estimate(z).verdict != "below_resolution"
    switch = estimate(np.repeat(np.arange(10.0) % 2.0, 50))
    assert (switch.resolution, "rounds to" in switch.message) == (0.0, False)
    assert estimate(np.repeat(np.arange(10.0) % 3.0, 50)).resolution == 1.0
