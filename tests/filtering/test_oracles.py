"""Filter, smoother and likelihood against one Gaussian vector, constant velocity and statsmodels."""

from __future__ import annotations

import math

import numpy as np
import pytest
from dense_momentum import all_states, constant_velocity, dense_model
from hypothesis import given
from hypothesis import strategies as st

from kalscope import FilterParams, kalman_filter, smooth
from kalscope.filtering import kernels, steady
from kalscope.filtering.filter import FilterResult, SmootherResult, empty_rows


def states_of(params, dt):
    """Mean and covariance of (x, velocity) at every row; x is around the unknown first value if diffuse."""
    if params.momentum:
        return dense_model(params.q, 1.0, params.momentum, dt, params.x0, params.p0)
    moved = params.q * np.cumsum(dt)
    n = len(dt)
    mean, cov = np.zeros(2 * n), np.zeros((2 * n, 2 * n))
    mean[::2] = 0.0 if params.x0 is None else params.x0
    cov[::2, ::2] = np.minimum.outer(moved, moved) + (0.0 if params.p0 is None else params.p0)
    return mean, cov


def seen_readings(z, params, upto):
    """The finite readings before row `upto` in the order in which they are taken: rows of H, noise, z − offset."""
    row, sensor = np.nonzero(np.isfinite(z[:upto]))
    h = np.zeros((len(row), 2 * len(z)))
    h[np.arange(len(row)), 2 * row] = params.gain[sensor]
    return h, np.diag(params.sensor_r[sensor]), z[row, sensor] - params.offset[sensor]


def dense_posterior(z, params, states, upto):
    """Mean and covariance of all states, `states` before any reading, given the readings before row `upto`."""
    mean, cov = states
    h, noise, rest = seen_readings(z, params, upto)
    s = h @ cov @ h.T + noise
    gain = np.linalg.solve(s, h @ cov).T
    rest = rest - h @ mean
    posterior, moved = cov - gain @ h @ cov, mean + gain @ rest
    if params.p0 is not None:
        return moved, posterior
    level = np.tile([1.0, 0.0], len(z))
    weight = np.linalg.solve(s, h @ level)
    variance = 1.0 / (weight @ h @ level)
    unseen = level - gain @ h @ level
    return moved + variance * (weight @ rest) * unseen, posterior + variance * np.outer(unseen, unseen)


def dense_loglik(z, params, states):
    """Log-density of the readings; with a diffuse start given the first, whose own density is not known."""
    mean, cov = states
    h, noise, rest = seen_readings(z, params, len(z))
    s = h @ cov @ h.T + noise
    rest = rest - h @ mean
    if params.p0 is None:  # what the unknown level leaves out: z_i − (gain_i/gain_1) z_1
        level = h @ np.tile([1.0, 0.0], len(z))
        contrast = np.eye(len(rest))[1:] - np.outer(level[1:] / level[0], np.eye(len(rest))[0])
        s, rest = contrast @ s @ contrast.T, contrast @ rest
    return -0.5 * (len(rest) * math.log(2 * math.pi) + np.linalg.slogdet(s)[1] + rest @ np.linalg.solve(s, rest))


ROUNDING = 1e-14
"""Of the variance before any reading: the digits that the dense solution itself loses."""


def record(rng, n, params, missing=0.2):
    x = np.cumsum(np.cumsum(rng.normal(0, 0.1, n)) if params.momentum else rng.normal(size=n))
    noise = rng.normal(size=(n, params.sensors)) * np.sqrt(params.sensor_r)
    z = params.offset + np.outer(x, params.gain) + noise
    z[rng.random(z.shape) < missing] = np.nan
    z[rng.integers(n), rng.integers(params.sensors)] = params.offset[0]
    return z if params.fuses else z[:, 0]


def must_be_posterior(z, params, states, filtered, smoothed, rel):
    """Filter, smoother and likelihood are those of one Gaussian vector, to `rel` of the size of each."""
    rows = z.reshape(len(z), -1)
    lost = ROUNDING * np.diag(states[1]).reshape(-1, 2).max(axis=0) + 1e-14

    def compare(found, i, mean, cov):
        for k, (value, variance) in enumerate((("x", "p"), ("velocity", "velocity_p"))):
            if getattr(found, value) is not None:
                m, c = mean[2 * i + k], cov[2 * i + k, 2 * i + k]
                assert getattr(found, variance)[i] == pytest.approx(c, rel=rel, abs=lost[k]), (variance, i)
                assert getattr(found, value)[i] == pytest.approx(
                    m, abs=rel * (abs(m) + math.sqrt(c + lost[k]) + 1)
                ), i

    known = int(np.flatnonzero(np.isfinite(rows).any(axis=1))[0]) if params.p0 is None else 0
    for i in range(known, len(z), 5):
        compare(filtered, i, *dense_posterior(rows, params, states, i + 1))
    whole = dense_posterior(rows, params, states, len(z))
    for i in range(len(z)):
        compare(smoothed, i, *whole)
    assert filtered.loglik == pytest.approx(dense_loglik(rows, params, states), rel=rel, abs=10 * rel)
    assert filtered.m == np.isfinite(z).sum() - (params.p0 is None)


@pytest.mark.slow
@given(
    seed=st.integers(0, 10**6),
    sensors=st.integers(0, 4),  # 0: one number
    tau=st.just(0.0) | st.floats(-2, 5).map(lambda x: 10**x),
    q=st.floats(-4, 1).map(lambda x: 10**x),
    r=st.floats(-1, 2).map(lambda x: 10**x),  # for q/r above 1,000 the dense solution is the less exact one
    start=st.sampled_from([(None, None), (2.0, 0.7), (0.0, -3.0)]),
    spread=st.sampled_from(["regular", "any", "gaps"]),
)
def test_random_steps_and_gaps_are_the_posterior_of_the_dense_model(seed, sensors, tau, q, r, start, spread):
    rng, n = np.random.default_rng(seed), 30
    dt = {
        "regular": np.ones(n),
        "any": rng.exponential(1.5, n) * (rng.random(n) > 0.05),
        "gaps": rng.choice([0.0, 0.3, 1.0, 1.0, 2.5, 40.0], n),
    }[spread]
    several = {
        "r": r * 10.0 ** rng.uniform(0, 2, sensors),
        "offset": rng.normal(0.0, 5.0, sensors),
        "gain": rng.choice([-1.0, 1.0], sensors) * 10.0 ** rng.uniform(-0.5, 0.5, sensors),
    }
    params = FilterParams(q, p0=start[0], x0=start[1], momentum=tau, **(several if sensors else {"r": r}))
    z = record(rng, n, params)
    must_be_posterior(z, params, states_of(params, dt), kalman_filter(z, params, dt), smooth(z, params, dt), 1e-10)


@pytest.mark.parametrize("q", [0.05, 1.0])
def test_an_exact_start_that_takes_no_time_leaves_the_velocity_to_later_samples(q):
    """x0 with p0 = 0 and two samples at its moment: x has no variance there, but its velocity has."""
    params, dt = FilterParams(q, 1.0, 0.0, -3.0, momentum=5.0), np.array([0.0, 0.0, *[1.0] * 38])
    z = record(np.random.default_rng(189), 40, params)
    must_be_posterior(z, params, states_of(params, dt), kalman_filter(z, params, dt), smooth(z, params, dt), 1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("acceleration", [1e-4, 0.01, 1.0])
def test_an_endless_momentum_is_constant_velocity(seed, acceleration):
    """τ → ∞ at a fixed q/τ²: white-noise acceleration, from a variance of the velocity before the start."""
    rng, tau = np.random.default_rng(seed), 1e14
    dt, params = rng.choice([0.5, 1.0, 1.0, 3.0], 60), FilterParams(1.0, 0.8, 2.0, 0.7, momentum=1e5)
    z = record(rng, 60, params)
    (states, readings), tally = empty_rows(params, 60), tuple(np.zeros(1, dtype=np.int64) for _ in range(3))
    model = acceleration * tau**2, tau, None, params.sensor_r, math.inf, (0.7, -0.1, 2.0, 0.1, 0.05)
    _, loglik = kernels.filter_rows(z[:, None], dt, *model, tally, states, readings, np.empty(1), True)
    x, v, p, _, w = (row.copy() for row in states)
    filtered = FilterResult(x, p, *readings, loglik, int(tally[2][0]), 0, v, w)
    kernels.smooth_states(dt, *model[:2], 0.7, states)
    x, v, p, _, w = states
    smoothed = SmootherResult(x, p, v, w)
    before = np.array([0.7, -0.1]), np.array([[2.0, 0.1], [0.1, 0.05]])
    moments = all_states([constant_velocity(step, acceleration) for step in dt], before)
    must_be_posterior(z, params, moments, filtered, smoothed, 1e-9)


@pytest.mark.parametrize("acceleration", [1e-8, 1e-4, 0.01, 1.0, 100.0])
def test_the_settled_filter_of_a_long_momentum_is_alpha_beta(acceleration):
    """Gains by the Riccati equation of constant velocity; α and β of the tracking index (Kalata 1984 form)."""
    from scipy.linalg import solve_discrete_are

    f, noise = constant_velocity(1.0, acceleration)
    p = solve_discrete_are(f.T, np.array([[1.0], [0.0]]), noise, np.eye(1))
    alpha, beta = p[:, 0] / (p[0, 0] + 1.0)
    tau = 1e12
    found = steady._with_momentum(acceleration * tau**2, 1.0, tau)  # beyond the longest momentum
    assert (found.gain, found.velocity_gain) == pytest.approx((alpha, beta), rel=1e-9)
    noise_of_alpha_beta = (2 * alpha**2 + beta * (2 - 3 * alpha)) / (alpha * (4 - 2 * alpha - beta))
    assert 10.0 ** (-found.noise_reduction_db / 10.0) == pytest.approx(noise_of_alpha_beta, rel=1e-9)
    assert found.lag_samples == pytest.approx((1 - alpha) / (beta * tau), rel=1e-6)  # 0 in the limit


@pytest.mark.slow
def test_a_state_space_of_statsmodels_agrees():
    from statsmodels.tsa.statespace.kalman_smoother import KalmanSmoother

    params = FilterParams(0.4, [1.0, 9.0], 4.0, 1.0, offset=[0.5, -2.0], gain=[1.0, 3.0])
    z = record(np.random.default_rng(5), 200, params)
    theirs = KalmanSmoother(2, 1)
    theirs.bind(z.copy())
    theirs["design"], theirs["obs_intercept"] = params.gain[:, None], params.offset[:, None]
    theirs["obs_cov"], theirs["transition"] = np.diag(params.r), np.eye(1)
    theirs["selection"], theirs["state_cov"] = np.eye(1), np.array([[params.q]])
    theirs.initialize_known(np.array([params.x0]), np.array([[params.p0 + params.q]]))
    run, found, smoothed = theirs.smooth(), kalman_filter(z, params), smooth(z, params)
    np.testing.assert_allclose(found.x, run.filtered_state[0], rtol=1e-10)
    np.testing.assert_allclose(found.p, run.filtered_state_cov[0, 0], rtol=1e-9)
    np.testing.assert_allclose(smoothed.x, run.smoothed_state[0], rtol=1e-9)
    np.testing.assert_allclose(smoothed.p, run.smoothed_state_cov[0, 0], rtol=1e-9)
    assert found.loglik == pytest.approx(run.llf_obs.sum(), rel=1e-10)
