"""Momentum through the public functions: batch, stream, pieces and smoother agree, and τ = 0 is the five lines."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from each import each
from five_lines import assert_same_bits, five_lines
from hypothesis import given
from hypothesis import strategies as st

from kalscope import BadSetting, FilterParams, KalmanFilter, denoise, diagnose, kalman_filter, smooth
from kalscope.filtering.filter import GrowingRun

PARAMS = (
    FilterParams(0.05, 1.0, momentum=20.0),
    FilterParams(0.05, 1.0, p0=4.0, momentum=3.0),
    FilterParams(0.0, 1.0, p0=0.5, x0=2.0, momentum=50.0),
    FilterParams(0.05, 0.0, momentum=1e5),
    FilterParams(0.05, 1.0, gate=9.0, momentum=0.2),
)


def record(n=600, seed=1):
    rng = np.random.default_rng(seed)
    z = np.cumsum(np.cumsum(rng.normal(0, 0.02, n))) + rng.normal(size=n)
    z[rng.random(n) < 0.05] = np.nan
    z[rng.random(n) < 0.02] += 30.0
    return z, rng.choice([0.0, 0.5, 1.0, 1.0, 3.0], n)


@each("params", PARAMS, ids=repr)
@each("timed", [False, True])
def test_the_stream_equals_the_batch_bit_for_bit(params, timed):
    z, dt = record()
    whole = kalman_filter(z, params, dt if timed else None)
    stream = KalmanFilter(params)
    seen = []
    for sample, step in zip(z, dt, strict=True):
        stream.update(float(sample), float(step) if timed else None)
        seen.append((stream.x, stream.p, stream.k, stream.velocity))
    for column, name in zip(np.array(seen).T, ("x", "p", "k", "velocity"), strict=True):
        np.testing.assert_array_equal(column, getattr(whole, name), err_msg=name)


@pytest.mark.parametrize("params", PARAMS, ids=repr)
@given(cuts=st.lists(st.integers(0, 600), max_size=6), timed=st.booleans())
def test_pieces_equal_the_whole(params, cuts, timed):
    z, dt = record()
    whole, running = kalman_filter(z, params, dt if timed else None), GrowingRun(params)
    edges = [0, *sorted(cuts), len(z)]
    for start, end in itertools.pairwise(edges):
        running.extend(z[start:end], dt[start:end] if timed else None)
    for name in ("x", "p", "k", "innovation", "s", "velocity", "velocity_p"):
        np.testing.assert_array_equal(getattr(running.result, name), getattr(whole, name), err_msg=name)
    assert (running.result.m, running.result.rejected) == (whole.m, whole.rejected)


@each("params", PARAMS, ids=repr)
def test_denoise_is_the_filter(params):
    z, _ = record(5000)
    np.testing.assert_allclose(
        denoise(z, params), kalman_filter(z, params).x, rtol=0, atol=1e-11 * np.nanmax(np.abs(z))
    )


@each("timed", [False, True])
@each("momentum", [0.0, -0.0, np.array([0.0]), np.array([0.0, 20.0])], ids=repr)
def test_no_momentum_is_the_five_lines_to_the_last_bit(momentum, timed):
    """The lines as they are printed, alone and beside a channel that has momentum."""
    z, dt = record()
    steps = dt if timed else None
    expected = five_lines(z, 0.05, 1.0, 4.0, math.nan, steps)
    columns = z if np.ndim(momentum) == 0 else np.column_stack([z] * len(momentum))
    params = FilterParams(0.05, 1.0, p0=4.0, momentum=momentum)
    found = kalman_filter(columns, params, steps)
    for name, lines in zip(("x", "p", "k", "innovation", "s"), expected, strict=True):
        assert_same_bits(getattr(found, name).reshape(600, -1)[:, 0], lines)
    plain = FilterParams(0.05, 1.0, p0=4.0)
    for function in (denoise, lambda *given: smooth(*given).x, lambda *given: smooth(*given).p):
        assert_same_bits(function(columns, params, steps).reshape(600, -1)[:, 0], function(z, plain, steps))


@each("params", PARAMS[:3], ids=repr)
@each(("unit", "pace"), [(8.0, 1.0), (1.0, 4.0), (0.5, 0.25)])
@each("function", [kalman_filter, smooth])
def test_another_unit_of_the_signal_or_of_time_is_the_same_filter(params, unit, pace, function):
    """Powers of two, which cost no digit."""
    z, dt = record()
    p0, x0 = params.p0, params.x0
    scaled = FilterParams(
        unit**2 / pace * params.q,
        unit**2 * params.r,
        p0 if p0 is None else unit**2 * p0,
        x0 if x0 is None else unit * x0,
        momentum=pace * params.momentum,
    )
    before, after = function(z, params, dt), function(unit * z, scaled, pace * dt)
    assert_same_bits(after.x, unit * before.x)
    assert_same_bits(after.p, unit**2 * before.p)
    assert_same_bits(after.velocity, unit / pace * before.velocity)
    assert_same_bits(after.velocity_p, (unit / pace) ** 2 * before.velocity_p)


def test_no_momentum_is_the_five_lines_and_has_no_velocity():
    z, dt = record()
    plain, zero = FilterParams(0.05, 1.0), FilterParams(0.05, 1.0, momentum=0.0)
    assert plain == zero
    result = kalman_filter(z, zero, dt)
    assert result.velocity is None
    assert result.velocity_p is None
    assert math.isnan(KalmanFilter(zero).velocity)
    assert smooth(z, zero).velocity is None


def test_a_short_momentum_tends_to_the_five_lines():
    z, _ = record()
    plain = kalman_filter(z, FilterParams(0.05, 1.0))
    short = kalman_filter(z, FilterParams(0.05, 1.0, momentum=1e-4))
    np.testing.assert_allclose(short.x, plain.x, atol=1e-3)
    assert short.loglik == pytest.approx(plain.loglik, rel=1e-3)


def test_each_channel_has_its_own_momentum():
    z = np.column_stack([record(seed=1)[0], record(seed=2)[0]])
    both = FilterParams(0.05, 1.0, momentum=np.array([0.0, 20.0]))
    result, smoothed = kalman_filter(z, both), smooth(z, both)
    for c, momentum in enumerate((0.0, 20.0)):
        alone = FilterParams(0.05, 1.0, momentum=momentum)
        np.testing.assert_array_equal(result.x[:, c], kalman_filter(z[:, c], alone).x)
        np.testing.assert_array_equal(smoothed.x[:, c], smooth(z[:, c], alone).x)
    assert np.isnan(result.velocity[:, 0]).all()
    np.testing.assert_array_equal(result.velocity[:, 1], kalman_filter(z[:, 1], alone).velocity)


def test_a_ramp_is_followed_without_lag_once_the_momentum_is_long():
    ramp = 0.3 * np.arange(4000.0)
    slow, fast = (kalman_filter(ramp, FilterParams(q, 1.0, momentum=tau)) for q, tau in ((0.01, 0.0), (1e4, 1e5)))
    assert ramp[-1] - slow.x[-1] > 1.0
    assert abs(ramp[-1] - fast.x[-1]) < 0.01
    assert fast.velocity[-1] == pytest.approx(0.3, rel=1e-2)


def test_the_smoother_is_never_less_sure_than_the_filter():
    z, dt = record()
    for params in PARAMS:
        filtered, smoothed = kalman_filter(z, params, dt), smooth(z, params, dt)
        assert np.all(smoothed.p <= filtered.p * (1 + 1e-9))
        assert np.all(smoothed.p >= 0.0)
        assert np.all(smoothed.velocity_p >= 0.0)


@each("momentum", [-1.0, math.nan, math.inf, 1.1e5, "long"])
def test_a_momentum_out_of_range_is_refused(momentum):
    with pytest.raises(BadSetting, match="momentum must be a number of sample periods from 0 to 1e5"):
        FilterParams(1.0, 1.0, momentum=momentum)


def test_a_filter_of_the_right_momentum_leaves_white_residuals():
    rng = np.random.default_rng(4)
    tau, q = 30.0, 4.0
    fade = math.exp(-1 / tau)
    v = lfilter_ar1(rng.normal(0, math.sqrt(q / (2 * tau) * (1 - fade**2)), 4000), fade)
    z = np.cumsum(v) + rng.normal(size=4000)
    right = diagnose(kalman_filter(z, FilterParams(q, 1.0, momentum=tau)))
    wrong = diagnose(kalman_filter(z, FilterParams(q, 1.0)))
    assert right.ljung_box_p > 0.01
    assert wrong.ljung_box_p < 1e-6
    assert (right.q_factor, right.r_factor) == (1.0, 1.0)
    assert right.nis == pytest.approx(1.0, abs=0.1)


def lfilter_ar1(noise, fade):
    out = np.empty_like(noise)
    last = 0.0
    for i, one in enumerate(noise):
        out[i] = last = fade * last + one
    return out


@pytest.mark.parametrize("momentum", [5e-324, 1e-300, 9e-13])
def test_a_momentum_too_short_to_change_a_digit_is_none(momentum):
    assert FilterParams(1.0, 1.0, momentum=momentum) == FilterParams(1.0, 1.0)
    assert FilterParams(1.0, 1.0, momentum=np.array([momentum, 2e-12])).momentum.tolist() == [0.0, 2e-12]
