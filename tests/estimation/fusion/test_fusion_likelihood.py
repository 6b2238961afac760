"""The likelihood of several sensors: equal to that of the fused filter, with exact slopes and the best offsets."""

from __future__ import annotations

import numpy as np
import pytest

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
def test_slopes_are_those_of_the_heights(tau):
    z, dt = record(momentum=tau > 0.0)
    data = Readings.of(z, dt)
    whole = Coordinates(data, place(data, tau), np.array([0, *([1] if tau else []), 2, 3, 4, 6, 7]))
    at = whole.start()
    beside = [whole.place(at + side).loglik - whole.place(at - side).loglik for side in 1e-5 * np.eye(len(at))]
    assert whole.slope(whole.place(at)) == pytest.approx(np.array(beside) / 2e-5, rel=1e-5, abs=1e-4)
