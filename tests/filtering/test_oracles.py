"""Filter, smoother and likelihood against one Gaussian vector, constant velocity and statsmodels."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope import FilterParams, kalman_filter, smooth, steady_state


def van_loan(dt, q, tau):
    """F and Q of dx = v dt, dv = -v/τ dt + noise, by the exponential of a block matrix (Van Loan 1978)."""
    doublings = max(0, math.ceil(math.log2(max(dt / tau, dt, 1e-300)))) + 4
    drift = np.array([[0.0, 1.0], [0.0, -1.0 / tau]])
    noise = np.diag([0.0, q / tau**2])
    block = np.block([[-drift, noise], [np.zeros((2, 2)), drift.T]]) * dt / 2.0**doublings
    power = total = np.eye(4)
    for k in range(1, 20):
        power = power @ block / k
        total = total + power
    f = total[2:, 2:].T
    cov = f @ total[:2, 2:]
    for _ in range(doublings):
        f, cov = f @ f, f @ cov @ f.T + cov
    return f, cov


def dense_model(q, tau, dt, x0, p0):
    """Mean and covariance of (x1, v1, x2, v2, …); without x0 and p0, around the unknown first value."""
    mean, cov = np.array([0.0 if x0 is None else x0, 0.0]), np.diag([0.0 if p0 is None else p0, q / (2 * tau)])
    moves, n = [van_loan(step, q, tau) for step in dt], len(dt)
    means, whole = np.empty(2 * n), np.empty((2 * n, 2 * n))
    for i, (f, noise) in enumerate(moves):
        mean, cov = f @ mean, f @ cov @ f.T + noise
        means[2 * i : 2 * i + 2] = mean
        whole[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = piece = cov
        for j in range(i + 1, n):
            piece = moves[j][0] @ piece
            whole[2 * j : 2 * j + 2, 2 * i : 2 * i + 2] = piece
            whole[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] = piece.T
    return means, whole


def states_of(params, dt):
    """Mean and covariance of (x, velocity) at every row; x is around the unknown first value if diffuse."""
    if params.momentum:
        return dense_model(params.q, params.momentum, dt, params.x0, params.p0)
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
        for k, (value, variance) in enumerate(((found.x, found.p), (found.velocity, found.velocity_p))):
            if value is not None:
                m, c = mean[2 * i + k], cov[2 * i + k, 2 * i + k]
                assert variance[i] == pytest.approx(c, rel=rel, abs=lost[k]), (k, i)
                assert value[i] == pytest.approx(m, abs=rel * (abs(m) + math.sqrt(c + lost[k]) + 1)), (k, i)

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
    uneven = {"any": rng.exponential(1.5, n) * (rng.random(n) > 0.05), "regular": np.ones(n)}
    dt = uneven.get(spread, rng.choice([0.0, 0.3, 1.0, 1.0, 2.5, 40.0], n))
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


def rough(n=300, missing=0.0):
    rng = np.random.default_rng(3)
    z = np.cumsum(np.cumsum(rng.normal(0, 0.1, n))) + rng.normal(size=n)
    z[rng.random(n) < missing] = np.nan
    return z


@pytest.mark.slow
@pytest.mark.parametrize(("q", "r", "momentum"), [(0.05, 0.8, 20.0), (4.0, 1.0, 3.0), (30.0, 1.0, 400.0)])
def test_filter_smoother_and_likelihood_are_those_of_a_local_linear_trend(q, r, momentum):
    from statsmodels.tsa.api import UnobservedComponents  # every worker collects this file

    z, (f, noise) = rough(missing=0.1), van_loan(1.0, q, momentum)
    model = UnobservedComponents(z, "lltrend").ssm
    model["transition"], model["state_cov"] = f, noise
    model["selection"], model["obs_cov"] = np.eye(2), np.array([[r]])
    start = f @ np.diag([2.0, q / (2 * momentum)]) @ f.T + noise  # theirs is the state of the first sample
    model.initialize_known(f @ [0.7, 0.0], start)
    model.loglikelihood_burn = 0
    theirs = model.smooth()
    params = FilterParams(q, r, p0=2.0, x0=0.7, momentum=momentum)
    filtered, smoothed = kalman_filter(z, params), smooth(z, params)
    for state, cov, found in (
        (theirs.filtered_state, theirs.filtered_state_cov, filtered),
        (theirs.smoothed_state, theirs.smoothed_state_cov, smoothed),
    ):
        np.testing.assert_allclose([found.x, found.velocity], state, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose([found.p, found.velocity_p], [cov[0, 0], cov[1, 1]], rtol=1e-8)
    assert filtered.loglik == pytest.approx(theirs.llf_obs.sum(), rel=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(("q", "r", "momentum"), [(0.05, 0.8, 20.0), (4.0, 1.0, 30.0), (0.01, 1.0, 6.0)])
def test_the_settled_filter_predicts_as_a_damped_trend(q, r, momentum):
    """Level and slope of the damped trend are x and f v / e: α = K, β = f L / e, φ = e."""
    from statsmodels.tsa.api import ETSModel

    z, params = rough(2000), FilterParams(q, r, momentum=momentum)
    settled, e = steady_state(params), math.exp(-1.0 / momentum)
    known = {"initialization_method": "known", "initial_level": z[0], "initial_trend": 0.0}
    model = ETSModel(z, trend="add", damped_trend=True, **known)
    theirs = model.smooth([settled.gain, momentum * (1.0 - e) * settled.velocity_gain / e, e]).fittedvalues
    ours = z - kalman_filter(z, params).innovation
    np.testing.assert_allclose(ours[1500:], theirs[1500:], rtol=1e-9, atol=1e-9)
