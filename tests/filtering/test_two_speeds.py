"""The filter with two speeds: its laws, and an independent calculation of its mixture."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope import BadSetting, FilterParams, denoise, estimate, kalman_filter, smooth
from kalscope.filtering.filter import KalmanFilter
from kalscope.filtering.two_speeds import SPIKE, START_MOVING, STOP_MOVING

PARAMS = FilterParams(q=1e-4, r=1.0, fast=2e6, spikes=0.01)


@pytest.fixture
def record():
    """Steps, noise, spikes, missing samples and uneven periods."""
    rng = np.random.default_rng(4)
    z = np.cumsum((rng.random(600) < 0.01) * rng.normal(0, 15, 600)) + rng.normal(size=600)
    z[::97] += 30.0
    z[200:230] = np.nan
    return z, rng.choice([0.5, 1.0, 3.0], 600)


def mixture(z, dt, params):
    """X, p, probability of moving and log-likelihood, hypothesis by hypothesis with the densities of scipy."""
    chain = np.array([[1 - START_MOVING, START_MOVING], [STOP_MOVING, 1 - STOP_MOVING]])
    values, vectors = np.linalg.eig(chain)
    share = START_MOVING / (START_MOVING + STOP_MOVING)
    x, p, speeds, total, rows = z[0], params.r, np.array([1 - share, share]), 0.0, []
    rows.append((x, p, speeds[1]))
    for reading, period in zip(z[1:], dt[1:], strict=True):
        speeds = speeds @ (vectors @ np.diag(values**period) @ np.linalg.inv(vectors))
        grown = p + params.q * period * np.array([1.0, params.fast])
        if np.isnan(reading):
            p = float(speeds @ grown)
        else:
            good = 1 - params.spikes
            before = np.array([*grown, speeds @ grown])
            noise = params.r * np.array([1.0, 1.0, SPIKE])
            joint = np.array([*(good * speeds), params.spikes]) / np.sqrt(2 * np.pi * (before + noise))
            joint = joint * np.exp(-0.5 * (reading - x) ** 2 / (before + noise))
            total += np.log(joint.sum())
            joint /= joint.sum()
            each = x + before / (before + noise) * (reading - x)
            x = float(joint @ each)
            p = float(joint @ (before * noise / (before + noise) + (each - x) ** 2))
            speeds = joint[:2] + joint[2] * speeds
        rows.append((x, p, speeds[1]))
    return np.array(rows).T, total


def test_it_is_the_mixture_of_three_hypotheses(record):
    z, dt = record
    got = kalman_filter(z, PARAMS, dt)
    (x, p, moving), loglik = mixture(z, dt, PARAMS)
    assert got.x == pytest.approx(x, rel=1e-4, abs=1e-4)
    assert got.p == pytest.approx(p, rel=1e-3)
    assert got.moving == pytest.approx(moving, abs=1e-4)
    assert (got.loglik, got.m) == (pytest.approx(loglik, rel=1e-5), np.isfinite(z).sum() - 1)


def test_a_factor_of_1_is_one_speed(record):
    z, dt = record
    one, two = (kalman_filter(z, FilterParams(0.1, 1.0, fast=fast), dt) for fast in (None, 1.0))
    for name in ("x", "p", "k", "innovation", "s"):
        assert np.array_equal(getattr(two, name), getattr(one, name), equal_nan=True)
    assert (two.loglik, two.moving) == (one.loglik, None)


def test_stream_pieces_and_denoise_give_the_same_bits(record):
    z, dt = record
    whole, one, pieces = kalman_filter(z, PARAMS, dt), KalmanFilter(PARAMS), KalmanFilter(PARAMS)
    streamed = [one.update(float(reading), float(period)) for reading, period in zip(z, dt, strict=True)]
    np.testing.assert_array_equal([streamed, denoise(z, PARAMS, dt)], [whole.x, whole.x])
    assert one.moving == whole.moving[-1]
    parts = [pieces.run(z[i : i + 150], dt[i : i + 150]) for i in range(0, 600, 150)]
    assert np.array_equal(np.concatenate([part.moving for part in parts]), whole.moving)


def test_the_smoother_is_closer_to_the_truth():
    rng = np.random.default_rng(2)
    x = np.cumsum((rng.random(2000) < 0.005) * rng.normal(0, 15, 2000))
    z = x + rng.normal(size=2000)
    filtered, smoothed = (np.sqrt(np.mean((one - x) ** 2)) for one in (denoise(z, PARAMS), smooth(z, PARAMS).x))
    assert smoothed < filtered < 0.5


@pytest.mark.parametrize(
    "refused",
    [{"fast": 0.5}, {"fast": np.nan}, {"fast": 10.0, "momentum": 3.0}, {"fast": 10.0, "gate": 9.0},
     {"spikes": 0.1}, {"fast": 10.0, "spikes": 0.6}, {"fast": 10.0, "r": 0.0}, {"fast": 10.0, "r": [1.0, 2.0]}],
)  # fmt: skip
def test_what_two_speeds_cannot_be_is_refused(refused):
    with pytest.raises(BadSetting):
        FilterParams(**{"q": 1.0, "r": 1.0, **refused})


def spiky(rng):
    spikes = 30.0 * (rng.random(1000) < 0.04) * rng.choice([-1, 1], 1000)
    return np.cumsum(0.17 * rng.normal(size=1000)) + rng.normal(size=1000) + spikes


def rounded(rng):
    return 4.0 * np.round((np.cumsum(0.2 * rng.normal(size=3000)) + rng.normal(size=3000)) / 4.0)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), [(spiky, 34), (rounded, 7), (rounded, 10)])
def test_large_spikes_and_coarse_readings_do_not_pass_for_movement(kind, seed):
    assert estimate(kind(np.random.default_rng(seed)), two_speeds=True).params.fast is None
