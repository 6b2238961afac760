"""The filter with momentum against dense Gaussian vectors, constant velocity, and statsmodels."""

from __future__ import annotations

import math

import numpy as np
import pytest
from dense_momentum import all_states, constant_velocity, dense_loglik, dense_model, dense_posterior
from each import each
from hypothesis import given
from hypothesis import strategies as st

from kalscope import FilterParams, kalman_filter, smooth
from kalscope.filtering.filter import FilterResult, SmootherResult
from kalscope.filtering.momentum import kernels
from kalscope.filtering.momentum.settled import settle
from kalscope.filtering.momentum.smoothing_kernels import smooth_channel


def record(n, seed, missing=0.15):
    rng = np.random.default_rng(seed)
    z = np.cumsum(np.cumsum(rng.normal(0, 0.1, n))) + rng.normal(size=n)
    z[rng.random(n) < missing] = np.nan
    z[rng.integers(n)] = 0.5
    return z, rng


ROUNDING = 1e-14
"""Of the variance before any sample: the digits that the dense solution itself loses."""


def must_be_posterior(z, r, model, diffuse, filtered, smoothed, rel):
    """Filter, smoother and likelihood are those of one Gaussian vector, to `rel` of the size of each."""
    lost = ROUNDING * np.diag(model[1]).reshape(-1, 2).max(axis=0)

    def compare(found, i, mean, cov):
        for k, (value, variance) in enumerate((("x", "p"), ("velocity", "velocity_p"))):
            m, c = mean[2 * i + k], cov[2 * i + k, 2 * i + k]
            assert getattr(found, variance)[i] == pytest.approx(c, rel=rel, abs=lost[k]), (variance, i)
            assert getattr(found, value)[i] == pytest.approx(m, abs=rel * (abs(m) + math.sqrt(c + lost[k]))), i

    known = int(np.flatnonzero(np.isfinite(z))[0]) if diffuse else 0
    for i in range(known, len(z), 5):
        compare(filtered, i, *dense_posterior(z, *model, r, i + 1, diffuse))
    whole = dense_posterior(z, *model, r, len(z), diffuse)
    for i in range(len(z)):
        compare(smoothed, i, *whole)
    assert filtered.loglik == pytest.approx(dense_loglik(z, *model, r, diffuse), rel=rel, abs=rel)


@pytest.mark.slow
@given(
    seed=st.integers(0, 10**6),
    tau=st.floats(-2, 5).map(lambda x: 10**x),
    q=st.floats(-4, 1).map(lambda x: 10**x),
    r=st.floats(-1, 2).map(lambda x: 10**x),  # for q/r above 1,000 the dense solution is the less exact one
    start=st.sampled_from([(None, None), (0.7, 2.0), (-3.0, 0.0)]),
    spread=st.sampled_from(["regular", "any", "gaps"]),
)
def test_random_steps_and_gaps_are_the_posterior_of_the_dense_model(seed, tau, q, r, start, spread):
    z, rng = record(40, seed)
    dt = {
        "regular": np.ones(40),
        "any": rng.exponential(1.5, 40) * (rng.random(40) > 0.05),
        "gaps": rng.choice([0.0, 0.3, 1.0, 1.0, 2.5, 40.0], 40),
    }[spread]
    x0, p0 = start
    params, model = FilterParams(q, r, p0, x0, momentum=tau), dense_model(q, r, tau, dt, x0, p0)
    filtered, smoothed = kalman_filter(z, params, dt), smooth(z, params, dt)
    must_be_posterior(z, r, model, p0 is None, filtered, smoothed, 1e-10)


@pytest.mark.parametrize("q", [0.05, 1.0])
def test_an_exact_start_that_takes_no_time_leaves_the_velocity_to_later_samples(q):
    """x0 with p0 = 0 and two samples at its moment: x has no variance there, but its velocity has."""
    z, _ = record(40, 189)
    dt = np.array([0.0, 0.0, *[1.0] * 38])
    params, model = FilterParams(q, 1.0, 0.0, -3.0, momentum=5.0), dense_model(q, 1.0, 5.0, dt, -3.0, 0.0)
    must_be_posterior(z, 1.0, model, False, kalman_filter(z, params, dt), smooth(z, params, dt), 1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("acceleration", [1e-4, 0.01, 1.0])
def test_an_endless_momentum_is_constant_velocity(seed, acceleration):
    """τ → ∞ at a fixed q/τ²: white-noise acceleration, from the same variance of the velocity before the start."""
    z, rng = record(60, seed)
    dt, tau, r = rng.choice([0.5, 1.0, 1.0, 3.0], 60), 1e14, 0.8
    out, smoothed = tuple(np.empty(60) for _ in range(7)), tuple(np.empty(60) for _ in range(4))
    start = (0.7, -0.1, 2.0, 0.1, 0.05)
    loop = z, dt, acceleration * tau**2, r, tau, math.inf, start
    _, loglik, *_ = kernels.filter_channel(*loop, 0, out)
    smooth_channel(*loop, smoothed)
    x, p, _, _, _, v, w = out
    filtered = FilterResult(x, p, *out[2:5], loglik, 0, 0, v, w)
    before = np.array([0.7, -0.1]), np.array([[2.0, 0.1], [0.1, 0.05]])
    model = all_states([constant_velocity(step, acceleration) for step in dt], before)
    must_be_posterior(z, r, model, False, filtered, SmootherResult(*smoothed), 1e-9)


def test_a_long_momentum_tends_to_constant_velocity():
    """Ten times the momentum, a tenth of the distance: the longest that is accepted is constant velocity."""
    z, _ = record(400, 9, missing=0.1)
    f, noise = constant_velocity(1.0, 1e-4)
    distances: list[float] = []
    for tau in (1e3, 1e4, 1e5):
        params = FilterParams(1e-4 * tau**2, 1.0, 4.0, 0.0, momentum=tau)
        state, cov = np.zeros(2), np.diag([4.0, params.q / (2 * tau)])
        for sample in z:
            state, cov = f @ state, f @ cov @ f.T + noise
            if np.isfinite(sample):
                gain = cov[:, 0] / (cov[0, 0] + 1.0)
                state, cov = state + gain * (sample - state[0]), cov - np.outer(gain, cov[0])
        found = kalman_filter(z, params)
        distances.append(abs(found.x[-1] - state[0]) + abs(found.velocity[-1] - state[1]))
    assert distances[0] > distances[1] > distances[2]
    assert distances[1] / distances[2] == pytest.approx(10.0, rel=0.05)


@each("acceleration", [1e-8, 1e-4, 0.01, 1.0, 100.0])
def test_the_settled_filter_of_a_long_momentum_is_alpha_beta(acceleration):
    """Gains by the Riccati equation of constant velocity; α and β of the tracking index (Kalata 1984 form)."""
    from scipy.linalg import solve_discrete_are

    f, noise = constant_velocity(1.0, acceleration)
    p = solve_discrete_are(f.T, np.array([[1.0], [0.0]]), noise, np.eye(1))
    alpha, beta = p[:, 0] / (p[0, 0] + 1.0)
    tau = 1e12
    found = settle(acceleration * tau**2, 1.0, tau, 0.01)
    assert (found.gain, found.velocity_gain) == pytest.approx((alpha, beta), rel=1e-9)
    noise_of_alpha_beta = (2 * alpha**2 + beta * (2 - 3 * alpha)) / (alpha * (4 - 2 * alpha - beta))
    assert found.noise == pytest.approx(noise_of_alpha_beta, rel=1e-9)
    assert found.lag == pytest.approx((1 - alpha) / (beta * tau), rel=1e-6)  # 0 in the limit
