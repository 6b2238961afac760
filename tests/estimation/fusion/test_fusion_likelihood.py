"""The likelihood of several sensors: equal to that of the fused filter, with exact slopes and the best offsets."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope import FilterParams, fuse
from kalscope.estimation.climb import Coordinates, Readings, place_at

GAINS = np.array([1.0, 1.3, -0.7])


def record(momentum: bool = False):
    rng = np.random.default_rng(5)
    n = 120
    x = np.cumsum(np.cumsum(rng.normal(0.0, 0.1, n)) if momentum else rng.normal(0.0, 0.4, n))
    z = 50.0 + x[:, None] * GAINS + [3.0, -1.0, 0.0] + rng.normal(0.0, 1.0, (n, 3)) * [0.5, 1.0, 0.8]
    z[rng.random(z.shape) < 0.3] = np.nan
    z[40:43] = np.nan
    return z, rng.choice([1.0, 1.0, 2.5, 0.0], n)


def place(data: Readings, tau: float):
    unit = data.scale * data.scale
    return place_at(data, 0.2 / unit, tau, np.array([0.3, 1.1, 0.6]) / unit, GAINS)


@pytest.mark.parametrize("tau", [0.0, 4.0])
def test_it_is_that_of_the_fused_filter(tau):
    z, dt = record()
    data = Readings.of(z, dt)
    one = place(data, tau)
    params = FilterParams(
        q=one.q * data.scale**2,
        r=one.r * data.scale**2,
        offset=one.offset * data.scale + data.centre,
        gain=one.c,
        momentum=tau,
    )
    result = fuse(z, params, dt)
    assert one.loglik == pytest.approx(result.loglik, rel=1e-12)
    assert data.m == result.m


@pytest.mark.parametrize("tau", [0.0, 4.0])
def test_slopes_are_those_of_the_heights(tau):
    z, dt = record(momentum=tau > 0.0)
    data = Readings.of(z, dt)
    whole = Coordinates(data, place(data, tau), np.array([0, *([1] if tau else []), 2, 3, 4, 6, 7]))
    at = whole.start()
    beside = [whole.place(at + side).loglik - whole.place(at - side).loglik for side in 1e-5 * np.eye(len(at))]
    assert whole.slope(whole.place(at)) == pytest.approx(np.array(beside) / 2e-5, rel=1e-5, abs=1e-4)


def test_no_other_offsets_are_more_likely():
    z, dt = record()
    data = Readings.of(z, dt)
    one = place(data, 0.0)
    scale = data.scale
    for side in ([0.0, 0.01, 0.0], [0.0, -0.01, 0.0], [0.0, 0.0, 0.01], [0.0, 0.0, -0.01]):
        offset = (one.offset + side) * scale + data.centre
        other = fuse(z, FilterParams(one.q * scale**2, one.r * scale**2, offset=offset, gain=one.c), dt)
        assert other.loglik < one.loglik
        # and by as much as their covariance says: a parabola
        assert one.loglik - other.loglik == pytest.approx(
            0.5 * float(np.array(side)[1:] @ np.linalg.solve(one.spread[1:, 1:], np.array(side)[1:])), rel=1e-6
        )
