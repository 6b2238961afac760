"""The filter with momentum against statsmodels: state space with trend, ARIMA(1, 1, 2) and damped trend."""

from __future__ import annotations

import math

import numpy as np
import pytest
from dense_momentum import van_loan

from kalscope import FilterParams, kalman_filter, smooth, steady_state

PAIRS = ((0.05, 0.8, 20.0), (4.0, 1.0, 3.0), (0.5, 2.0, 0.7), (30.0, 1.0, 400.0))


def record(n=300, seed=3, missing=0.0):
    rng = np.random.default_rng(seed)
    z = np.cumsum(np.cumsum(rng.normal(0, 0.1, n))) + rng.normal(size=n)
    z[rng.random(n) < missing] = np.nan
    return z


def statsmodels():
    """Their models; imported where they are used, because every worker collects this file."""
    import statsmodels.api as sm

    return sm.tsa


def trend_model(z, move, r, start):
    """The local linear trend of statsmodels with the transition of the model with momentum."""
    f, noise = move
    model = statsmodels().UnobservedComponents(z, "lltrend")
    model.ssm["transition"], model.ssm["state_cov"] = f, noise
    model.ssm["selection"], model.ssm["obs_cov"] = np.eye(2), np.array([[r]])
    mean, cov = start
    model.ssm.initialize_known(f @ mean, f @ cov @ f.T + noise)  # theirs is the state of the first sample
    model.ssm.loglikelihood_burn = 0
    return model.ssm


@pytest.mark.slow
@pytest.mark.parametrize(("q", "r", "momentum"), PAIRS)
def test_filter_smoother_and_likelihood_are_those_of_a_local_linear_trend(q, r, momentum):
    z = record(missing=0.1)
    start = np.array([0.7, 0.0]), np.diag([2.0, q / (2 * momentum)])
    theirs = trend_model(z, van_loan(1.0, q, momentum), r, start).smooth()
    params = FilterParams(q, r, p0=2.0, x0=0.7, momentum=momentum)
    filtered, smoothed = kalman_filter(z, params), smooth(z, params)
    for state, cov, found in (
        (theirs.filtered_state, theirs.filtered_state_cov, filtered),
        (theirs.smoothed_state, theirs.smoothed_state_cov, smoothed),
    ):
        np.testing.assert_allclose(found.x, state[0], rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(found.velocity, state[1], rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(found.p, cov[0, 0], rtol=1e-8)
        np.testing.assert_allclose(found.velocity_p, cov[1, 1], rtol=1e-8)
    assert filtered.loglik == pytest.approx(theirs.llf_obs.sum(), rel=1e-10)


def settled(params):
    """K, L, e and f of the settled filter."""
    found = steady_state(params)
    kept = math.exp(-1.0 / params.momentum)
    return found.gain, found.velocity_gain, kept, params.momentum * (1.0 - kept)


@pytest.mark.slow
@pytest.mark.parametrize(("q", "r", "momentum"), PAIRS)
def test_the_likelihood_is_that_of_an_arima(q, r, momentum):
    """Its differences are an ARMA(1, 2), whose moving average has the poles of the settled filter."""
    z = record()
    params = FilterParams(q, r, momentum=momentum)
    gain, velocity_gain, e, f = settled(params)
    turns = [1.0 - gain + e - velocity_gain * f, (1.0 - gain) * e]  # sum and product of the poles
    differences = statsmodels().SARIMAX(np.diff(z), order=(1, 0, 2), tolerance=0)
    theirs = differences.loglike([e, -turns[0], turns[1], r / (1.0 - gain)])
    assert kalman_filter(z, params).loglik == pytest.approx(theirs, rel=1e-8)


@pytest.mark.parametrize(("q", "r", "momentum"), [(0.05, 0.8, 20.0), (4.0, 1.0, 30.0), (0.01, 1.0, 6.0)])
def test_the_settled_filter_predicts_as_a_damped_trend(q, r, momentum):
    """Level and slope of the damped trend are x and f v / e: α = K, β = f L / e, φ = e."""
    z = record(2000)
    params = FilterParams(q, r, momentum=momentum)
    gain, velocity_gain, e, f = settled(params)
    model = statsmodels().ETSModel(
        z, trend="add", damped_trend=True, initialization_method="known", initial_level=z[0], initial_trend=0.0
    )
    theirs = model.smooth([gain, f * velocity_gain / e, e])
    ours = kalman_filter(z, params)
    late = slice(1500, None)
    np.testing.assert_allclose((z - ours.innovation)[late], theirs.fittedvalues[late], rtol=1e-9, atol=1e-9)
