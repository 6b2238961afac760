"""The fused filter, its smoother and its likelihood against one Gaussian vector of all readings."""

from __future__ import annotations

import math

import numpy as np
import pytest
from dense_fusion import dense_loglik, dense_posterior
from hypothesis import given
from hypothesis import strategies as st

from kalscope import FilterParams, fuse, smooth


def record(rng, n, params, missing=0.3):
    x = np.cumsum(rng.normal(0.0, 1.0, n)) + 20.0
    z = params.offset + np.outer(x, params.gain) + rng.normal(size=(n, params.sensors)) * np.sqrt(params.r)
    z[rng.random(z.shape) < missing] = np.nan
    z[rng.integers(n), rng.integers(params.sensors)] = params.offset[0]
    return z


def random_case(seed, sensors, momentum, start, spread, n=24):
    rng = np.random.default_rng(seed)
    params = FilterParams(
        10.0 ** rng.uniform(-3, 1),
        10.0 ** rng.uniform(-1, 2, sensors),
        rng.normal(0.0, 5.0, sensors),
        rng.choice([-1.0, 1.0], sensors) * 10.0 ** rng.uniform(-1, 1, sensors),
        x0=start[0],
        p0=start[1],
        momentum=momentum,
    )
    dt = {"regular": np.ones(n), "any": rng.exponential(1.5, n) * (rng.random(n) > 0.1)}[spread]
    return record(rng, n, params), params, dt


def must_agree(found, mean, cov, rel):
    """State i of `found` is element 2 i of the dense vector, to `rel` of the size of each."""
    for i in range(len(found.x)):
        for k, (value, variance) in enumerate((("x", "p"), ("velocity", "velocity_p"))):
            if getattr(found, value) is not None:
                m, c = mean[2 * i + k], cov[2 * i + k, 2 * i + k]
                assert getattr(found, variance)[i] == pytest.approx(c, rel=rel, abs=1e-13), (variance, i)
                assert getattr(found, value)[i] == pytest.approx(m, abs=rel * (abs(m) + math.sqrt(c) + 20.0)), i


@pytest.mark.slow
@given(
    seed=st.integers(0, 10**6),
    sensors=st.integers(1, 4),
    momentum=st.sampled_from([0.0, 0.5, 4.0, 50.0]),
    start=st.sampled_from([(None, None), (0.7, 2.0), (-3.0, 0.0)]),
    spread=st.sampled_from(["regular", "any"]),
)
def test_filter_smoother_and_likelihood_are_those_of_one_gaussian_vector(seed, sensors, momentum, start, spread):
    z, params, dt = random_case(seed, sensors, momentum, start, spread)
    found = fuse(z, params, dt)
    known = int(np.flatnonzero(np.isfinite(z).any(axis=1))[0]) if params.p0 is None else 0
    for i in range(known, len(z), 6):
        mean, cov = dense_posterior(z, params, dt, i + 1)
        assert found.p[i] == pytest.approx(cov[2 * i, 2 * i], rel=1e-10, abs=1e-13)
        assert found.x[i] == pytest.approx(mean[2 * i], rel=1e-10, abs=1e-10 * (math.sqrt(found.p[i]) + 20.0))
    must_agree(smooth(z, params, dt), *dense_posterior(z, params, dt, len(z)), 1e-10)
    assert found.loglik == pytest.approx(dense_loglik(z, params, dt), rel=1e-10, abs=1e-9)
    assert found.m == np.isfinite(z).sum() - (params.p0 is None)


@pytest.mark.slow
def test_a_state_space_of_statsmodels_agrees():
    from statsmodels.tsa.statespace.kalman_smoother import KalmanSmoother

    params = FilterParams(0.4, np.array([1.0, 9.0]), np.array([0.5, -2.0]), np.array([1.0, 3.0]), p0=4.0, x0=1.0)
    z = record(np.random.default_rng(5), 200, params)
    theirs = KalmanSmoother(2, 1)
    theirs.bind(z.copy())
    theirs["design"], theirs["obs_intercept"] = params.gain[:, None], params.offset[:, None]
    theirs["obs_cov"], theirs["transition"] = np.diag(params.r), np.eye(1)
    theirs["selection"], theirs["state_cov"] = np.eye(1), np.array([[params.q]])
    theirs.initialize_known(np.array([params.x0]), np.array([[params.p0 + params.q]]))
    run, found, smoothed = theirs.smooth(), fuse(z, params), smooth(z, params)
    np.testing.assert_allclose(found.x, run.filtered_state[0], rtol=1e-10)
    np.testing.assert_allclose(found.p, run.filtered_state_cov[0, 0], rtol=1e-10)
    np.testing.assert_allclose(smoothed.x, run.smoothed_state[0], rtol=1e-9)
    np.testing.assert_allclose(smoothed.p, run.smoothed_state_cov[0, 0], rtol=1e-9)
    assert found.loglik == pytest.approx(run.llf_obs.sum(), rel=1e-10)
