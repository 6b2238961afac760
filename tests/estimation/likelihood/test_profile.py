"""The likelihood against a dense oracle without Kalman code, against published numbers, and against itself."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from signals import walk

from kalscope import BadSetting, FilterParams, kalman_filter
from kalscope.estimation.likelihood import log_likelihood, loglik_map
from kalscope.estimation.momentum import likelihood_profile

NILE_Q, NILE_R = 1469.1, 15099.0


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


def test_nile_at_the_published_pair(nile):
    """KFAS, R arima(0,1,1), MARSS user guide: −632.5456 over n − 1 terms (Durbin & Koopman 2012, p. 37)."""
    assert log_likelihood(nile, FilterParams(1469.163, 15098.65)) == pytest.approx(-632.5456, abs=5e-5)


@pytest.mark.parametrize(
    ("log_ratio", "printed"),
    [(0.0, -495.68), (-3.32, -492.53), (-2.60, -492.10), (-2.32, -492.07), (-2.33, -492.07)],
)
def test_nile_profile_is_durbin_and_koopmans_table_2_1(nile, log_ratio, printed):
    """Table 2.1 gives ln(q/r) and the concentrated log-likelihood without −½(m ln 2π + m)."""
    profile = likelihood_profile(nile, [log_ratio, log_ratio + 1])
    dropped = 0.5 * profile.m * (math.log(2 * math.pi) + 1)
    assert round(profile.loglik[0] + dropped, 1) == pytest.approx(round(printed, 1))
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


@pytest.mark.parametrize("missing", [0.0, 0.001, 0.2])
@pytest.mark.parametrize("n", [2, 9, 500, 20_000])
def test_every_lane_of_a_profile_equals_the_filter_run_alone(n, missing):
    """From lags far beyond the record to no filtering; settled, unsettled and regained lanes."""
    z = walk(n, 0.01, missing=missing) + 1e3
    z[:2] = [1001.0, 1002.0]
    profile = likelihood_profile(z)
    for j in range(0, 121, 8):
        params = FilterParams(math.exp(profile.log_ratios[j]) * profile.r[j], profile.r[j])
        assert profile.loglik[j] == pytest.approx(log_likelihood(z, params), rel=1e-10, abs=1e-9)


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


def test_log_likelihood_is_the_one_that_the_filter_reports():
    z = np.stack([walk(200, 0.1), walk(200, 1.0, seed=1, missing=0.3)], axis=1)
    params = FilterParams(q=0.1, r=2.0, p0=3.0, x0=0.5, gate=9.0)
    assert log_likelihood(z, params).shape == (2,)
    np.testing.assert_array_equal(log_likelihood(z, params), kalman_filter(z, params).loglik)
    assert isinstance(log_likelihood(z[:, 0], FilterParams(1, 1)), float)


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
