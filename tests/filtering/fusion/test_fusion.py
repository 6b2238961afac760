"""Laws of the fused filter: one sensor, streams, gaps, weights, and sensors that add nothing."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope import FilterParams, FusionFilter, FusionParams, fuse, kalman_filter, smooth, smooth_fusion

STARTS = ({}, {"p0": 2.0}, {"p0": 2.0, "x0": 0.7}, {"p0": 0.0, "x0": -3.0})
MODELS = [
    {"gate": gate, "momentum": tau, **start} for gate in (None, 4.0) for tau in (0.0, 8.0) for start in STARTS
]


def readings(n=300, sensors=3, missing=0.1, seed=1):
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.normal(0.0, 0.3, n))
    z = x[:, None] + rng.normal(size=(n, sensors))
    z[rng.random(z.shape) < 0.02] += 30.0
    z[rng.random(z.shape) < missing] = np.nan
    z[:3] = np.nan
    return z


def same(a, b):
    np.testing.assert_array_equal(np.asarray(a), np.asarray(b), strict=False)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("missing", [0.0, 0.1])
def test_one_sensor_is_the_scalar_filter_to_the_last_bit(model, missing):
    z = readings(sensors=1, missing=missing)
    dt = np.random.default_rng(2).exponential(1.0, len(z))
    for steps in (None, dt):
        alone = kalman_filter(z[:, 0], FilterParams(0.09, 1.0, **model), steps)
        fused = fuse(z, FusionParams(0.09, np.array([1.0]), **model), steps)
        for name in ("x", "p", "velocity", "velocity_p", "loglik", "m"):
            same(getattr(fused, name), getattr(alone, name))
        for name in ("k", "innovation", "s"):
            same(getattr(fused, name)[:, 0], getattr(alone, name))
        assert fused.rejected.tolist() == [alone.rejected]
        smoothed = smooth_fusion(z, FusionParams(0.09, np.array([1.0]), **model), steps)
        for name in ("x", "p", "velocity", "velocity_p"):
            same(getattr(smoothed, name), getattr(smooth(z[:, 0], FilterParams(0.09, 1.0, **model), steps), name))


@pytest.mark.parametrize("model", MODELS)
def test_a_stream_is_the_batch_to_the_last_bit(model):
    z = readings()
    params = FusionParams(
        0.09, np.array([1.0, 4.0, 0.3]), np.array([0.0, 1.0, -2.0]), np.array([1.0, 2.0, -0.5]), **model
    )
    dt = np.random.default_rng(2).exponential(1.0, len(z))
    for steps in (None, dt):
        whole, stream = fuse(z, params, steps), FusionFilter(params)
        for i, row in enumerate(z):
            stream.update(row, None if steps is None else steps[i])
            same([stream.x, stream.p], [whole.x[i], whole.p[i]])
            same(stream.k, whole.k[i])
            if whole.velocity is not None:
                same(stream.velocity, whole.velocity[i])
