"""The likelihood over λ for a given momentum: against the filter run alone, and against the random walk."""

from __future__ import annotations

import math

import numpy as np
import pytest
from each import each

from kalscope import BadSetting, FilterParams, estimate, log_likelihood
from kalscope.estimation.likelihood import DROP_95, likelihood_contour, loglik_map
from kalscope.estimation.momentum import likelihood_profile


def moving(n, momentum=20.0, ratio=0.3, seed=0, missing=0.0):
    """A signal that keeps its direction, with noise of variance 1."""
    g = np.random.default_rng(seed)
    e = math.exp(-1.0 / momentum)
    velocity = np.empty(n)
    velocity[0] = g.normal(0, math.sqrt(ratio / 2 / momentum))
    for i in range(1, n):
        velocity[i] = e * velocity[i - 1] + g.normal(0, math.sqrt(ratio / 2 / momentum * (1 - e * e)))
    z = np.cumsum(velocity) + g.normal(size=n)
    z[g.random(n) < missing] = np.nan
    return z


def uneven(n, seed=1):
    return np.random.default_rng(seed).choice([0.5, 1.0, 7.0], n)


@each("momentum", [0.01, 3.0, 200.0, 1e5])
@each(("missing", "dt"), [(0.0, None), (0.1, None), (0.1, uneven(700))])
def test_every_point_of_a_profile_equals_the_filter_run_alone(momentum, missing, dt):
    z = moving(700, missing=missing)
    profile = likelihood_profile(z, dt=dt, momentum=momentum)
    for j in range(0, len(profile.loglik), 10):
        r = profile.r[j]
        params = FilterParams(math.exp(profile.log_ratios[j]) * r, r, momentum=momentum)
        assert profile.loglik[j] == pytest.approx(log_likelihood(z, params, dt), rel=1e-7, abs=1e-5)


def test_without_momentum_it_is_that_of_the_random_walk_and_the_limit_of_a_short_one():
    z = moving(700)
    plain, none, short = (likelihood_profile(z, momentum=m) for m in (0.0, 0, 1e-5))
    np.testing.assert_array_equal(plain.loglik, none.loglik)
    np.testing.assert_allclose(short.loglik_at(0.3, 1.0), plain.loglik_at(0.3, 1.0), rtol=1e-4)


@pytest.mark.parametrize("momentum", [3.0, 200.0, 1e5])
def test_the_whole_map_comes_from_one_profile(momentum):
    z = 1e-3 * moving(3000)
    log_q, log_r = np.linspace(-25, 0, 7), np.linspace(-18, -8, 5)
    found = loglik_map(likelihood_profile(z, momentum=momentum), log_q, log_r)
    for j, r in enumerate(np.exp(log_r)):
        for i, q in enumerate(np.exp(log_q)):
            exact = log_likelihood(z, FilterParams(q, r, momentum=momentum))
            assert found[j, i] == pytest.approx(exact, rel=1e-4, abs=0.05)


@pytest.mark.parametrize("momentum", [5.0, 60.0])
def test_the_line_around_the_pairs_is_where_the_likelihood_falls_by_its_drop(momentum):
    z = moving(1500)
    best = estimate(z, momentum=momentum)

    def scan(z, log_ratios, dt):
        return likelihood_profile(z, log_ratios, dt, momentum)

    line = likelihood_contour(z, best, scan=scan)
    assert line is not None
    assert line.closed
    pairs = zip(np.exp(line.log_q)[::10], np.exp(line.log_r)[::10], strict=True)
    drops = [2 * (best.loglik - log_likelihood(z, FilterParams(q, r, momentum=momentum))) for q, r in pairs]
    assert drops == pytest.approx(np.full(len(drops), DROP_95), abs=0.03)


@pytest.mark.parametrize("momentum", [-1.0, 2e5, math.nan])
def test_a_momentum_out_of_its_range_is_refused(momentum):
    with pytest.raises(BadSetting, match="momentum must be"):
        likelihood_profile(np.arange(9.0), momentum=momentum)
