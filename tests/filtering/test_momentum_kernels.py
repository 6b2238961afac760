"""Laws and oracles of the loops with momentum: dense matrices, Van Loan's transition, statsmodels."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalscope.filtering.momentum import kernels
from kalscope.filtering.momentum.smoothing_kernels import smooth_channel

REGULAR = np.empty(0)


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


def dense_model(q, r, tau, dt, x0=None, p0=None):
    """Mean and covariance of all states (x1, v1, x2, v2, …) as one Gaussian vector; without p0, those around x0."""
    mean = np.array([0.0 if x0 is None else x0, 0.0])
    cov = np.diag([0.0 if p0 is None else p0, q / (2 * tau)])
    n = len(dt)
    means, whole = np.empty(2 * n), np.empty((2 * n, 2 * n))
    moves = [van_loan(step, q, tau) for step in dt]
    for i, (f, noise) in enumerate(moves):
        mean, cov = f @ mean, f @ cov @ f.T + noise
        means[2 * i : 2 * i + 2] = mean
        whole[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = piece = cov
        for j in range(i + 1, n):
            piece = moves[j][0] @ piece
            whole[2 * j : 2 * j + 2, 2 * i : 2 * i + 2] = piece
            whole[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] = piece.T
    return means, whole


def dense_posterior(z, mean, cov, r, upto, diffuse):
    """Mean and covariance of all states given the finite samples before `upto`; x0 by least squares if diffuse."""
    seen = 2 * np.flatnonzero(np.isfinite(z[:upto]))
    s = cov[np.ix_(seen, seen)] + r * np.eye(len(seen))
    gain = np.linalg.solve(s, cov[seen]).T
    posterior = cov - gain @ cov[seen]
    level = np.tile([1.0, 0.0], len(z))
    rest = z[seen // 2] - mean[seen]
    if not diffuse:
        return mean + gain @ rest, posterior
    weight = np.linalg.solve(s, level[seen])
    variance = 1.0 / (weight @ level[seen])
    x0 = variance * (weight @ rest)
    unseen = level - gain @ level[seen]
    return mean + gain @ rest + x0 * unseen, posterior + variance * np.outer(unseen, unseen)


def run(z, q, r, tau, dt=REGULAR, x0=math.nan, p0=math.inf, gate=math.inf):
    out = tuple(np.empty(len(z)) for _ in range(7))
    state = (x0, 0.0, p0, 0.0, q / (2 * tau))
    _, loglik, m, rejected, _ = kernels.filter_channel(z, dt, q, r, tau, gate, state, 0, out)
    return (*out, loglik, m, rejected)


def signal(n=60, seed=0, missing=0.15):
    g = np.random.default_rng(seed)
    z = np.cumsum(np.cumsum(g.normal(0, 0.1, n))) + g.normal(0, 1, n)
    z[g.random(n) < missing] = np.nan
    return z, g.choice([0.0, 0.3, 1.0, 1.0, 2.5, 7.0], n)


@given(st.floats(1e-3, 1e3), st.floats(1e-2, 1e5), st.floats(1e-6, 1e3))
def test_the_transition_is_that_of_the_stochastic_equation(dt, tau, q):
    e, f, a, b, c = kernels.transition(dt, q, tau)
    oracle_f, oracle_q = van_loan(dt, q, tau)
    np.testing.assert_allclose([[1.0, f], [0.0, e]], oracle_f, rtol=1e-10, atol=1e-30)
    np.testing.assert_allclose([[a, b], [b, c]], oracle_q, rtol=1e-9)


@given(st.floats(0.05, 0.2), st.floats(0.1, 1e4))
def test_the_series_meets_the_closed_form(h, tau):
    def exact(h):
        terms, power, factorial = Fraction(0), Fraction(h) ** 2, 2
        for n in range(3, 40):
            power *= Fraction(h)
            factorial *= n
            terms += (-1) ** (n + 1) * Fraction(2 ** (n - 1) - 2, factorial) * power
        return float(terms)

    assert kernels.transition(h * tau, 1.0, tau)[2] == pytest.approx(tau * exact((h * tau) / tau), rel=1e-12)


@pytest.mark.parametrize("tau", [0.05, 1.0, 20.0, 3e4])
@pytest.mark.parametrize(("x0", "p0"), [(None, None), (0.7, 2.0)], ids=["diffuse", "given"])
@pytest.mark.parametrize("irregular", [False, True])
def test_filter_and_smoother_are_the_posterior_of_the_dense_model(tau, x0, p0, irregular):
    z, dt = signal()
    dt = dt if irregular else np.ones(len(z))
    q, r = 0.05, 0.8
    state = (math.nan if x0 is None else x0, 0.0, math.inf if p0 is None else p0, 0.0, q / (2 * tau))
    steps = dt if irregular else REGULAR
    x, p, _, _, _, v, w, *_ = run(z, q, r, tau, steps, state[0], state[2])
    smoothed = tuple(np.empty(len(z)) for _ in range(4))
    smooth_channel(z, steps, q, r, tau, math.inf, state, smoothed)
    mean, cov = dense_model(q, r, tau, dt, x0, p0)

    def compare(values, upto, at):
        m, c = dense_posterior(z, mean, cov, r, upto, x0 is None)
        at = np.array(at)
        np.testing.assert_allclose(values[0][at], m[2 * at], rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(values[1][at], c[2 * at, 2 * at], rtol=1e-8)
        np.testing.assert_allclose(values[2][at], m[2 * at + 1], rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(values[3][at], c[2 * at + 1, 2 * at + 1], rtol=1e-8)

    first = 0 if x0 is not None else int(np.flatnonzero(np.isfinite(z))[0])
    for i in range(first, len(z), 7):
        compare((x, p, v, w), i + 1, [i])
    compare(smoothed, len(z), range(len(z)))


def test_the_likelihood_is_the_density_of_the_dense_model():
    z, dt = signal(seed=5)
    q, r, tau = 0.05, 0.8, 12.0
    *_, loglik, m, _ = run(z, q, r, tau, dt, 0.7, 2.0)
    mean, cov = dense_model(q, r, tau, dt, 0.7, 2.0)
    seen = np.flatnonzero(np.isfinite(z))
    s = cov[np.ix_(2 * seen, 2 * seen)] + r * np.eye(len(seen))
    rest = z[seen] - mean[2 * seen]
    density = -0.5 * (len(seen) * math.log(2 * math.pi) + np.linalg.slogdet(s)[1] + rest @ np.linalg.solve(s, rest))
    assert m == len(seen)
    assert loglik == pytest.approx(density, rel=1e-10)


@pytest.mark.parametrize("tau", [0.3, 5.0, 200.0, 1e5])
def test_the_fast_path_agrees_with_the_filter(tau):
    g = np.random.default_rng(7)
    z = np.cumsum(g.normal(0, 0.1, 20_000)) + g.normal(0, 1, 20_000)
    z[[5_000, 12_345]] = np.nan
    q, r = 0.01, 1.0
    out = np.empty_like(z)
    state = (math.nan, 0.0, math.inf, 0.0, q / (2 * tau))
    assert kernels.denoise_channel(z, REGULAR, q, r, tau, math.inf, state, out) == -1
    np.testing.assert_allclose(out, run(z, q, r, tau)[0], rtol=0, atol=1e-12 * np.nanmax(np.abs(z)) * 10)


def test_a_long_momentum_is_constant_velocity():
    """τ → ∞ at a fixed q/τ²: the alpha-beta filter of white-noise acceleration, written out with matrices."""
    z, _ = signal(n=400, seed=9, missing=0.1)
    tau, r = 1e5, 1.0
    acceleration = 1e-4
    q = acceleration * tau**2
    x, _, _, _, _, v, *_ = run(z, q, r, tau, REGULAR, 0.0, 4.0)
    f = np.array([[1.0, 1.0], [0.0, 1.0]])
    noise = acceleration * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]])
    state, cov = np.array([0.0, 0.0]), np.diag([4.0, q / (2 * tau)])
    for i, sample in enumerate(z):
        state, cov = f @ state, f @ cov @ f.T + noise
        if np.isfinite(sample):
            gain = cov[:, 0] / (cov[0, 0] + r)
            state, cov = state + gain * (sample - state[0]), cov - np.outer(gain, cov[0])
        if i > 20:
            np.testing.assert_allclose((x[i], v[i]), state, rtol=1e-3, atol=1e-3)


def test_units_scale_with_the_signal():
    z, dt = signal(seed=11)
    small, large = run(z, 0.05, 0.8, 9.0, dt), run(1e3 * z, 0.05e6, 0.8e6, 9.0, dt)
    for i, power in enumerate((1, 2, 0, 1, 2, 1, 2)):
        np.testing.assert_allclose(large[i], small[i] * 1e3**power, rtol=1e-12)


def test_a_gate_sets_a_spike_aside_and_never_locks_out():
    z, _ = signal(n=200, seed=13, missing=0.0)
    z[50] += 1e3
    *_, rejected = run(z, 0.05, 0.8, 9.0, gate=25.0)
    assert rejected >= 1
    z[120:] += 1e3
    x = run(z, 0.05, 0.8, 9.0, gate=25.0)[0]
    assert abs(x[-1] - z[-1]) < 50


def test_the_loops_release_the_interpreter():
    for loop in (kernels.filter_channel, kernels.denoise_channel, smooth_channel):
        assert loop.targetoptions["nogil"]
