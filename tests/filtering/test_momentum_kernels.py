"""Laws and oracles of the loops with momentum: dense matrices and Van Loan's transition."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from dense_momentum import van_loan
from each import each
from hypothesis import given
from hypothesis import strategies as st

from kalscope.filtering.momentum import kernels
from kalscope.filtering.momentum.smoothing_kernels import smooth_channel

REGULAR = np.empty(0)


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


@each("tau", [0.3, 5.0, 200.0, 1e5])
def test_the_fast_path_agrees_with_the_filter(tau):
    g = np.random.default_rng(7)
    z = np.cumsum(g.normal(0, 0.1, 20_000)) + g.normal(0, 1, 20_000)
    z[[5_000, 12_345]] = np.nan
    q, r = 0.01, 1.0
    out = np.empty_like(z)
    state = (math.nan, 0.0, math.inf, 0.0, q / (2 * tau))
    assert kernels.denoise_channel(z, REGULAR, q, r, tau, math.inf, state, out) == -1
    np.testing.assert_allclose(out, run(z, q, r, tau)[0], rtol=0, atol=1e-12 * np.nanmax(np.abs(z)) * 10)


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


@each(("missing", "begin"), [((), 256), ((0,), 1), ((200,), 201), ((200, 210), 201), ((300,), 256)])
def test_a_chunk_that_failed_is_not_tried_again_before_its_missing_sample(missing, begin):
    z = np.zeros(600)
    z[list(missing)] = math.nan
    assert kernels.after_missing(z, 0) == begin
    assert kernels.after_missing(z, 500) == 756


def test_missing_samples_between_chunks_do_not_change_what_is_filtered():
    z = np.random.default_rng(3).normal(0.0, 1.0, 5000).cumsum()
    z[[700, 1300, 1301, 2100, 4990]] = math.nan
    out, state = np.empty(5000), (math.nan, 0.0, math.inf, 0.0, 0.025)
    assert kernels.denoise_channel(z, REGULAR, 1.0, 10.0, 20.0, math.inf, state, out) == -1
    np.testing.assert_allclose(out, run(z, 1.0, 10.0, 20.0)[0], rtol=0, atol=1e-10)
