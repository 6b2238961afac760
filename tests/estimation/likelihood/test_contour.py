"""The contour of the likelihood: every point on it falls short by what was asked, by the filter's own account."""

from __future__ import annotations

import numpy as np
import pytest
from signals import walk

from kalscope import FilterParams, estimate, open_source
from kalscope.estimation.likelihood import DROP_95, likelihood_contour, log_likelihood


def drops(z, contour, best, dt=None):
    pairs = zip(np.exp(contour.log_q), np.exp(contour.log_r), strict=True)
    return np.array([2 * (best.loglik - log_likelihood(z, FilterParams(q=q, r=r), dt)) for q, r in pairs])


@pytest.mark.parametrize("drop", [1.0, DROP_95])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_every_point_falls_short_by_what_was_asked(seed, unit, drop):
    z = unit * walk(800, 0.02, seed)
    best = estimate(z)
    contour = likelihood_contour(z, best, drop=drop)
    assert contour.closed
    assert drops(z, contour, best) == pytest.approx(np.full(122, drop), abs=0.02)


def test_the_nile_and_a_record_with_gaps():
    nile = open_source("sample:nile").values[:, 0]
    best = estimate(nile)
    assert drops(nile, likelihood_contour(nile, best), best) == pytest.approx(np.full(122, DROP_95), abs=0.02)
    z = walk(600, 0.05, 3)
    z[100:140] = np.nan
    dt = np.random.default_rng(4).uniform(0.2, 3.0, 600)
    best = estimate(z, dt=dt)
    assert drops(z, likelihood_contour(z, best, dt), best, dt) == pytest.approx(np.full(122, DROP_95), abs=0.03)


def test_white_noise_allows_no_movement_at_all_so_its_contour_is_open():
    z = np.random.default_rng(6).normal(size=400)
    best = estimate(z)
    contour = likelihood_contour(z, best)
    assert not contour.closed
    assert contour.log_q.min() < np.log(best.r) - 15


def test_a_constant_record_has_none():
    z = np.full(50, 2.5)
    assert likelihood_contour(z, estimate(z)) is None
