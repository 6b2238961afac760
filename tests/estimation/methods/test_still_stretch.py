"""The still stretch that a record shows by itself."""

from __future__ import annotations

import math

import numpy as np
import pytest
from signals import walk

from kalscope import BadSetting
from kalscope.estimation.noise import noise_from_still
from kalscope.estimation.request import Noise, Request, find_parameters
from kalscope.estimation.still import MIN_SAMPLES, find_still_stretch

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


@pytest.mark.slow
def test_spikes_and_missing_samples_do_not_hide_it():
    g = np.random.default_rng(3)
    z = record("walk")
    z[::37] += 30.0
    z[g.random(len(z)) < 0.2] = np.nan
    first, last = find_still_stretch(z)
    assert abs(first - STILL.start) < 80
    assert abs(last - STILL.stop) < 80
    assert noise_from_still(z[first:last]).r == pytest.approx(1.0, rel=0.25)


def test_a_record_of_noise_alone_is_still_all_over():
    z = np.random.default_rng(0).normal(size=500)
    first, last = find_still_stretch(z)
    assert (first, last) == (0, 500 - 500 % 13)


def test_the_stretch_does_not_depend_on_unit_and_level():
    z = record("sine")
    found = find_still_stretch(z)
    assert find_still_stretch(1e5 + z) == found
    for unit in (-1e-6, 1e200, 1e-200):
        assert find_still_stretch(unit * z) == found


def test_a_burst_of_white_movement_is_not_still():
    z = walk(1500, 0.2, 1)
    z[600:900] += np.random.default_rng(2).normal(0, 20, 300)
    found = find_still_stretch(z)
    assert found is None or found[1] <= 610 or found[0] >= 890


# --- none -----------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.1, 1e6])
def test_a_random_walk_has_none(ratio):
    found = [find_still_stretch(walk(800, ratio, seed)) for seed in range(60)]
    assert sum(one is not None for one in found) <= 1


@pytest.mark.parametrize(
    "z",
    [
        np.sin(np.arange(2000) / 20),
        5 * np.sin(np.arange(2000) / 30) + np.random.default_rng(0).normal(size=2000),
        np.ones(500),
        np.arange(500.0),
        np.random.default_rng(0).normal(size=MIN_SAMPLES - 1),
        np.full(100, np.nan),
        [],
    ],
    ids=["sine", "sine and noise", "constant", "ramp", "short", "missing", "empty"],
)
def test_what_never_pauses_has_none(z):
    assert find_still_stretch(z) is None


def test_a_record_must_be_one_channel_and_finite():
    for z in (np.ones((9, 2)), [1.0, np.inf] * 30):
        with pytest.raises(BadSetting):
            find_still_stretch(z)


# --- in use ---------------------------------------------------------------------------------------------


def test_the_parameters_follow_from_the_stretch_that_is_found():
    z = record("walk")
    first, last = find_still_stretch(z)
    found = find_parameters(z, Request(noise=Noise(still="auto")))
    assert found.params == find_parameters(z, Request(noise=Noise(still=(first, last)))).params
    assert f"still stretch, samples {first} to 1\u202f{last - 1001:03d}." in found.message


def test_a_record_without_a_still_stretch_is_refused_with_what_to_do():
    with pytest.raises(BadSetting, match=r"must show a still stretch, 52 samples or more .* \(got none\): give"):
        find_parameters(walk(500, 1.0, 0), Request(noise=Noise(still="auto")))
