"""The likelihood against a dense oracle without Kalman code, published numbers and the filter; its contour."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.signals import moving, walk

from kalscope import BadSetting, FilterParams, estimate, kalman_filter, open_source
from kalscope.estimation.likelihood import DROP_95, likelihood_contour, log_likelihood, loglik_map
from kalscope.estimation.momentum import likelihood_profile


def dense_loglik(z, q, r, dt=None):
    """Over the finite samples Δz ~ N(0, T), T tridiagonal: q·dt + 2r on the diagonal and −r beside it."""
    z = np.asarray(z, dtype=float)
    steps = np.ones(len(z)) if dt is None else np.asarray(dt)
    finite = np.flatnonzero(np.isfinite(z))
    d = np.diff(z[finite])
    gap = np.array([steps[a + 1 : b + 1].sum() for a, b in pairwise(finite)])
    T = np.diag(q * gap + 2 * r) - r * (np.eye(len(d), k=1) + np.eye(len(d), k=-1))
    sign, logdet = np.linalg.slogdet(T)
    assert sign == 1 or len(d) == 0
    return -0.5 * (len(d) * math.log(2 * math.pi) + logdet + d @ np.linalg.solve(T, d))


# --- published tables -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("log_ratio", "printed"),
    [(0.0, -495.68), (-3.32, -492.53), (-2.60, -492.10), (-2.32, -492.07), (-2.33, -492.07)],
)
def test_nile_profile_is_durbin_and_koopmans_table_2_1(nile, log_ratio, printed):
    """Table 2.1 gives ln(q/r) and the concentrated log-likelihood without −½(m ln 2π + m)."""
    profile = likelihood_profile(nile, [log_ratio, log_ratio + 1])
    dropped = 0.5 * profile.m * (math.log(2 * math.pi) + 1)
    assert profile.loglik[0] + dropped == pytest.approx(printed, abs=6e-3)


def test_nile_with_a_proper_prior_is_the_ten_column_table_of_marss_and_kfas(nile):
    """MARSS user guide, figures KFAS--Cs206 … Cs408: a1 = 0, P1 = 1000 at the first sample, hence dt[0] = 0.

    q and r are printed to 8 digits, so that the columns can be checked to about 1e-7 of themselves.
    """
    dt = np.ones(100)
    dt[0] = 0
    params = FilterParams(q=15210.195, r=33874.59, p0=1000.0, x0=0.0)
    result = kalman_filter(nile, params, dt)
    assert log_likelihood(nile, params, dt) == pytest.approx(-697.8576, abs=5e-5)
    x_pred = [0, 32.11507, 396.72378, 643.48197, 909.42338]
    np.testing.assert_allclose(nile[:5] - result.innovation[:5], x_pred, atol=5.1e-6, rtol=3e-8)
    np.testing.assert_allclose(result.x[:5], [*x_pred[1:], 1029.38565], atol=5.1e-6, rtol=3e-8)
    v = [1120, 1127.8849, 566.2762, 566.5180, 250.5766]
    np.testing.assert_allclose(result.innovation[:5], v, atol=5.1e-5, rtol=1e-7)
    s = [34874.59, 50056.11, 60035.34, 63845.84, 64986.59]
    np.testing.assert_allclose(result.s[:5], s, atol=5.1e-3, rtol=1e-7)
    p_pred = [1000, 16181.52, 26160.75, 29971.25, 31112.00]
    np.testing.assert_allclose(result.s[:5] - 33874.59, p_pred, atol=5.1e-3, rtol=1e-7)
    p = [971.3258, 10950.5590, 14761.0518, 15901.7997, 16217.2867]
    np.testing.assert_allclose(result.p[:5], p, atol=5.1e-5, rtol=1e-7)


def test_nile_with_missing_years_and_a_proper_prior(nile):
    """MARSS user guide, figure KFAS--Cs602: KFAS −433.0312, MARSS −433.0319 at its own pair."""
    z, dt = nile.copy(), np.ones(100)
    z[20:40] = z[60:80] = np.nan
    dt[0] = 0
    for q, r, printed in ((22084.75, 53400.57, -433.0312), (22133.85, 52955.30, -433.0319)):
        params = FilterParams(q, r, p0=1000.0, x0=0.0)
        assert log_likelihood(z, params, dt) == pytest.approx(printed, abs=5e-5)


def test_exact_diffuse_ten_point_table_of_kfas_and_stata():
    """statsmodels' results_exact_initial_local_level_R.csv: KFAS scores n − 1 terms, Stata's ucm all n.

    The n-th term, of the sample that sets the start, is −½ ln 2π alone.
    """
    z = [10.2394] + [1.0] * 9
    ours = log_likelihood(z, FilterParams(q=8.253, r=1.993))
    assert ours == pytest.approx(-23.0163218509366, abs=1e-12)
    assert ours - 0.5 * math.log(2 * math.pi) == pytest.approx(-23.935260, abs=5e-7)


# --- the oracle -----------------------------------------------------------------------------------------


@st.composite
def records(draw):
    n = draw(st.integers(3, 60))
    seed = draw(st.integers(0, 2**32 - 1))
    g = np.random.default_rng(seed)
    z = (
        g.normal(0, 1, n)
        + draw(st.sampled_from([0.0, 1e3]))
        + np.cumsum(g.normal(0, draw(st.sampled_from([0, 1, 30])), n))
    )
    z[g.random(n) < draw(st.sampled_from([0.0, 0.1, 0.6]))] = np.nan
    z[g.choice(n, 2, replace=False)] = g.normal(0, 1, 2)
    kind = draw(st.sampled_from(["regular", "irregular", "some", "wild"]))
    dt = {
        "regular": None,
        "irregular": g.uniform(0, 3, n),
        "some": np.where(g.random(n) < 0.1, 5.0, 1.0),
        "wild": 10 ** g.uniform(-6, 8, n),
    }[kind]
    return z, dt


@given(records(), st.floats(-12, 6))
def test_profile_and_log_likelihood_equal_the_dense_oracle(record, log_ratio):
    z, dt = record
    profile = likelihood_profile(z, [log_ratio, log_ratio + 0.5], dt)
    r = profile.r[0]
    q = math.exp(log_ratio) * r
    expected = dense_loglik(z, q, r, dt)
    assert profile.loglik[0] == pytest.approx(expected, rel=1e-10, abs=1e-9)
    # the filter's own (1 − k) p loses digits where λ dt is huge
    rounding = 1e-10 if dt is None or math.exp(log_ratio) * dt.max() < 1e3 else 1e-4
    assert log_likelihood(z, FilterParams(q, r), dt) == pytest.approx(expected, rel=rounding, abs=1e-9)


# --- the map, the unit, the shapes ----------------------------------------------------------------------


def test_the_whole_map_comes_from_one_profile():
    z = walk(3000, 0.05, seed=3, r=4.0)
    profile = likelihood_profile(z)
    log_q, log_r = np.linspace(-4, 3, 9), np.linspace(0, 3, 5)
    found = loglik_map(profile, log_q, log_r)
    exact = [[log_likelihood(z, FilterParams(math.exp(a), math.exp(b))) for a in log_q] for b in log_r]
    assert found.shape == (5, 9)
    np.testing.assert_allclose(found, exact, rtol=0, atol=3e-6 * profile.m)
    assert profile.loglik_at(1.0, 0.0) == pytest.approx(log_likelihood(z, FilterParams(1.0, 0.0)), abs=1e-5)


@pytest.mark.parametrize(
    ("z", "log_ratios"),
    [
        (np.ones((4, 2)), None),
        ([1.0, np.nan], None),
        ([], None),
        ([1.0, np.inf, 2.0], None),
        ([1.0, 2.0, 3.0], [1.0, 0.0]),
        ([1.0, 2.0, 3.0], [0.0, np.nan]),
        ([1.0, 2.0, 3.0], [0.0, 301.0]),
        ([1.0, 2.0, 3.0], [0.0]),
    ],
)
def test_what_cannot_be_scanned_is_refused(z, log_ratios):
    with pytest.raises(BadSetting):
        likelihood_profile(z, log_ratios)


def uneven(n, seed=1):
    return np.random.default_rng(seed).choice([0.5, 1.0, 7.0], n)


@pytest.mark.parametrize("momentum", [0.0, 0.01, 3.0, 200.0, 1e5])
@pytest.mark.parametrize(("missing", "n", "dt"), [(0.0, 2, None), (0.001, 9000, None), (0.1, 700, uneven(700))])
def test_every_point_of_a_profile_equals_the_filter_run_alone(momentum, missing, n, dt):
    """From lags far beyond the record to no filtering; settled, unsettled and regained lanes."""
    z = 1e3 + (moving(n, 20.0, 0.3, missing=missing) if momentum else walk(n, 0.01, missing=missing))
    profile = likelihood_profile(z, dt=dt, momentum=momentum)
    for j in range(0, len(profile.loglik), 10):
        r = profile.r[j]
        params = FilterParams(math.exp(profile.log_ratios[j]) * r, r, momentum=momentum)
        assert profile.loglik[j] == pytest.approx(log_likelihood(z, params, dt), rel=1e-7, abs=1e-5)


def drops(z, contour, best, dt=None):
    pairs = zip(np.exp(contour.log_q), np.exp(contour.log_r), strict=True)
    return np.array([2 * (best.loglik - log_likelihood(z, FilterParams(q=q, r=r), dt)) for q, r in pairs])


@pytest.mark.parametrize("drop", [1.0, DROP_95])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_every_point_falls_short_by_what_was_asked(seed, unit, drop):
    z = unit * walk(800, 0.02, seed)
    best = estimate(z)
    contour = likelihood_contour(z, best, likelihood_profile, drop=drop)
    assert contour.closed
    assert drops(z, contour, best) == pytest.approx(np.full(122, drop), abs=0.02)


def test_the_nile_and_a_record_with_gaps():
    nile = open_source("sample:nile").values[:, 0]
    best = estimate(nile)
    assert drops(nile, likelihood_contour(nile, best, likelihood_profile), best) == pytest.approx(
        np.full(122, DROP_95), abs=0.02
    )
    z = walk(600, 0.05, 3)
    z[100:140] = np.nan
    dt = np.random.default_rng(4).uniform(0.2, 3.0, 600)
    best = estimate(z, dt=dt)
    assert drops(z, likelihood_contour(z, best, likelihood_profile, dt), best, dt) == pytest.approx(
        np.full(122, DROP_95), abs=0.03
    )


def test_white_noise_allows_no_movement_at_all_so_its_contour_is_open():
    z = np.random.default_rng(6).normal(size=400)
    best = estimate(z)
    contour = likelihood_contour(z, best, likelihood_profile)
    assert not contour.closed
    assert contour.log_q.min() < np.log(best.r) - 15
