"""Laws of the fused filter: one sensor, streams, gaps, weights, and sensors that add nothing."""

from __future__ import annotations

import numpy as np
import pytest
from each import each

from kalscope import (
    BadSetting,
    FilterParams,
    KalmanFilter,
    FilterParams,
    fuse,
    kalman_filter,
    smooth,
    smooth,
)

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


@each("model", MODELS)
@each("missing", [0.0, 0.1])
def test_one_sensor_is_the_scalar_filter_to_the_last_bit(model, missing):
    z = readings(sensors=1, missing=missing)
    dt = np.random.default_rng(2).exponential(1.0, len(z))
    for steps in (None, dt):
        alone = kalman_filter(z[:, 0], FilterParams(0.09, 1.0, **model), steps)
        fused = fuse(z, FilterParams(0.09, np.array([1.0]), **model), steps)
        for name in ("x", "p", "velocity", "velocity_p", "loglik", "m"):
            same(getattr(fused, name), getattr(alone, name))
        for name in ("k", "innovation", "s"):
            same(getattr(fused, name)[:, 0], getattr(alone, name))
        assert fused.rejected.tolist() == [alone.rejected]
        smoothed = smooth(z, FilterParams(0.09, np.array([1.0]), **model), steps)
        for name in ("x", "p", "velocity", "velocity_p"):
            same(getattr(smoothed, name), getattr(smooth(z[:, 0], FilterParams(0.09, 1.0, **model), steps), name))


@pytest.mark.parametrize("model", MODELS)
def test_a_stream_is_the_batch_to_the_last_bit(model):
    z = readings()
    params = FilterParams(
        0.09, np.array([1.0, 4.0, 0.3]), np.array([0.0, 1.0, -2.0]), np.array([1.0, 2.0, -0.5]), **model
    )
    dt = np.random.default_rng(2).exponential(1.0, len(z))
    for steps in (None, dt):
        whole, stream = fuse(z, params, steps), KalmanFilter(params)
        for i, row in enumerate(z):
            stream.update(row, None if steps is None else steps[i])
            same([stream.x, stream.p], [whole.x[i], whole.p[i]])
            same(stream.k, whole.k[i])
            if whole.velocity is not None:
                same(stream.velocity, whole.velocity[i])


def test_the_order_of_the_sensors_changes_only_the_rounding():
    z = readings()
    params = FilterParams(0.09, np.array([1.0, 4.0, 0.3]), np.array([0.0, 1.0, -2.0]), np.array([1.0, 2.0, -0.5]))
    order = [2, 0, 1]
    one, other = fuse(z, params), fuse(z[:, order], params.only(order))
    np.testing.assert_allclose(other.x, one.x, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(other.weights, one.weights[:, order], rtol=1e-12)


@pytest.mark.parametrize("momentum", [0.0, 8.0])
def test_a_sensor_that_is_all_noise_adds_nothing(momentum):
    z = readings(missing=0.0)
    alone = fuse(z[:, :2], FilterParams(0.09, np.array([1.0, 4.0]), momentum=momentum))
    together = fuse(z, FilterParams(0.09, np.array([1.0, 4.0, 1e300]), momentum=momentum))
    np.testing.assert_allclose(together.x, alone.x, rtol=1e-12)
    assert np.all(together.weights[4:, 2] < 1e-290)


@pytest.mark.parametrize("momentum", [0.0, 8.0])
def test_two_sensors_in_turns_are_one(momentum):
    """The same noise: which of them has the reading does not matter, to the last bit."""
    z = readings(sensors=1, missing=0.2)[:, 0]
    turns = np.full((len(z), 2), np.nan)
    turns[::2, 0], turns[1::2, 1] = z[::2], z[1::2]
    dt = np.random.default_rng(2).exponential(1.0, len(z))
    fused = fuse(turns, FilterParams(0.09, np.array([1.0, 1.0]), momentum=momentum), dt)
    alone = kalman_filter(z, FilterParams(0.09, 1.0, momentum=momentum), dt)
    same(fused.x, alone.x)
    assert fused.loglik == alone.loglik


@pytest.mark.parametrize("momentum", [0.0, 8.0])
def test_while_all_answer_it_is_the_filter_of_the_weighted_mean(momentum):
    z = readings(missing=0.0)[3:]
    params = FilterParams(
        0.09, np.array([1.0, 4.0, 0.3]), np.array([0.0, 1.0, -2.0]), np.array([1.0, 2.0, -0.5]), momentum=momentum
    )
    mean = (z - params.offset) / params.gain @ params.shares
    found, single = fuse(z, params), kalman_filter(mean, params.as_single)
    np.testing.assert_allclose(found.x, single.x, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(found.p, single.p, rtol=1e-12)
    np.testing.assert_allclose(found.weights, np.tile(params.shares, (len(z), 1)), rtol=1e-12)
    assert FilterParams(0.09, np.array([0.7])).as_single == FilterParams(0.09, 0.7)


def test_weights_are_shares_of_the_readings_that_were_used():
    z = np.array([[np.nan, np.nan], [1.0, np.nan], [1.0, 1.0], [1.0, 500.0]])
    weights = fuse(z, FilterParams(1.0, np.array([1.0, 3.0]), gate=9.0)).weights
    np.testing.assert_allclose(weights, [[0, 0], [1, 0], [0.75, 0.25], [1, 0]], rtol=1e-15)


def test_the_gate_of_one_sensor_does_not_touch_the_others_and_lets_go():
    z = np.ones((14, 2))
    z[8:, 1] = 100.0
    found = fuse(z, FilterParams(0.01, np.array([1.0, 1.0]), gate=9.0))
    assert found.rejected.tolist() == [0, 5]  # five rows, then the jump is taken
    assert found.k[13, 1] > 0.0
    assert np.all(found.k[8:13, 1] == 0.0)
    np.testing.assert_allclose(found.x[8:13], 1.0)
    assert np.all(found.k[8:13, 0] > 0.0)


def test_an_exact_sensor_is_followed():
    z = readings(missing=0.0)
    params = FilterParams(0.09, np.array([1.0, 0.0, 2.0]))
    found = fuse(z, params)
    np.testing.assert_allclose(found.x[3:], z[3:, 1], rtol=0, atol=1e-14)
    assert params.shares.tolist() == pytest.approx([0.0, 1.0, 0.0], abs=1e-200)
    assert params.as_single.r == 0.0


def test_no_rows_and_rows_without_readings():
    params = FilterParams(1.0, np.array([1.0, 2.0]), p0=1.0, x0=5.0, momentum=3.0)
    assert fuse(np.empty((0, 2)), params).x.shape == (0,)
    assert smooth(np.empty((0, 2)), params).x.shape == (0,)
    nothing = np.full((4, 2), np.nan)
    assert fuse(nothing, params).x.tolist() == [5.0] * 4
    assert smooth(nothing, params).x.tolist() == [5.0] * 4
    assert np.isnan(smooth(nothing, FilterParams(1.0, np.array([1.0, 2.0]))).x).all()


@each("row", [[1.0], [1.0, 2.0, 3.0], [[1.0, 2.0], [1.0, 2.0]], [np.inf, 1.0], [1.0, 1e250]])
def test_a_row_that_is_refused_leaves_the_state(row):
    stream = KalmanFilter(FilterParams(1.0, np.array([1.0, 2.0]), gain=np.array([1.0, 1e-90])))
    stream.update([3.0, np.nan])
    with pytest.raises(BadSetting):
        stream.update(row)
    with pytest.raises(BadSetting, match="dt"):
        stream.update([1.0, 2.0], -1.0)
    assert (stream.x, stream.p) == (3.0, 1.0)


def test_masked_readings_are_missing():
    z = readings()
    params = FilterParams(0.09, np.ones(3))
    same(fuse(np.ma.masked_invalid(z), params).x, fuse(z, params).x)


@pytest.mark.parametrize("momentum", [0.0, 8.0])
def test_equal_sensors_are_an_interleaved_record_with_no_time_in_between(momentum):
    z = np.random.default_rng(1).normal(size=(50, 2))
    z[7, 0] = z[9, 1] = np.nan
    dt = np.tile([1.0, 0.0], 50)
    one = kalman_filter(z.ravel(), FilterParams(0.2, 1.5, momentum=momentum), dt)
    same(fuse(z, FilterParams(0.2, np.array([1.5, 1.5]), momentum=momentum)).x, one.x[1::2])


@pytest.mark.parametrize("gate", [None, 9.0])
def test_settled_gains_are_those_of_every_step(gate):
    """Regular rows keep the gains of the row before once nothing changes; steps of 1 never do."""
    z = readings(2000, missing=0.001)
    params = FilterParams(0.09, np.array([1.0, 4.0, 0.3]), gain=np.array([1.0, 2.0, -0.5]), gate=gate)
    regular, stepped = fuse(z, params), fuse(z, params, np.ones(2000))
    for name in ("x", "p", "k", "innovation", "s", "m", "rejected"):
        same(getattr(regular, name), getattr(stepped, name))
    assert regular.loglik == pytest.approx(stepped.loglik, rel=1e-12)
