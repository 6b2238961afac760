"""Published diagnostics, false-alarm rates, detection, and whether following the advice mends the filter."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from tests.support.signals import moving

from kalscope import BadSetting, FilterParams, kalman_filter
from kalscope.analysis.diagnostics import diagnose, diagnose_held_out, residual_rows
from kalscope.analysis.findings import NO_FAULT
from kalscope.analysis.residuals import nis_band


def noisy_walk(n=1000, q=0.01, r=1.0, seed=0, missing=0.0):
    g = np.random.default_rng(seed)
    z = np.cumsum(g.normal(0, math.sqrt(q), n)) + g.normal(0, math.sqrt(r), n)
    z[g.random(n) < missing] = np.nan
    return z


def judge(z, q, r=1.0, dt=None, **kwargs):
    found = diagnose(kalman_filter(z, FilterParams(q, r, **kwargs), dt))
    for field in dataclasses.fields(found):
        if field.name not in ("e", "advice", "evidence"):
            assert np.all(np.isfinite(getattr(found, field.name))), field.name
    assert found.advice
    return found


def test_channels_are_judged_each_by_itself():
    z, params = np.column_stack([noisy_walk(seed=1), noisy_walk(q=1.0, seed=2)]), FilterParams(0.01, 1.0)
    found = diagnose(kalman_filter(z, params))
    assert [one.nis for one in found] == [diagnose(kalman_filter(z[:, c], params)).nis for c in range(2)]


def normal(found):
    """N (S²/6 + K²/24) and its p value from χ²₂ (Bowman & Shenton 1975)."""
    statistic = found.n * (found.skewness**2 / 6.0 + found.excess_kurtosis**2 / 24.0)
    return statistic, math.exp(-0.5 * statistic)


# --- published tables -----------------------------------------------------------------------------------


def test_nile_diagnostics_are_those_of_durbin_and_koopman(nile):
    """Durbin & Koopman (2012), section 2.12.3: H(33), Q(9), N, skewness, kurtosis at r 15099, q 1469.1."""
    found = diagnose(kalman_filter(nile, FilterParams(q=1469.1, r=15099.0)), lags=9)
    numbers = found.ljung_box, found.variance_ratio, normal(found)[0], found.skewness, found.excess_kurtosis
    assert numbers == pytest.approx((8.84, 0.61, 0.05, -0.03, 0.09), abs=0.005)
    assert found.nis == pytest.approx(1.0, abs=1e-4)  # by construction at the maximum of the likelihood
    assert found.advice == NO_FAULT


def test_norwegian_diagnostics_are_those_of_commandeur_and_koopman(norway):
    """Commandeur & Koopman (2007), table 2.3, to its printed digits."""
    found = diagnose(kalman_filter(np.log(norway), FilterParams(0.0047026, 0.00326838)), lags=10, fitted=True)
    numbers = found.ljung_box, found.r1, found.correlation[3], found.variance_ratio, normal(found)[0]
    assert numbers == pytest.approx((6.228, -0.127, -0.105, 1.746, 1.191), abs=0.0005)
    assert found.ljung_box_p == pytest.approx(0.717, abs=0.001)  # χ²(9), 5 % limit 16.92 in the table
    assert found.advice == NO_FAULT


@pytest.mark.parametrize(("n", "low", "high"), [(30, 0.560, 1.566), (100, 0.742, 1.296), (1000, 0.914, 1.090)])
def test_nis_bands_are_the_published_ones(n, low, high):
    """Bar-Shalom, Li & Kirubarajan (2001), section 5.4, as kept in the project's notes."""
    assert nis_band(n) == pytest.approx((low, high), abs=0.0006)


# --- false alarms ---------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("n", "ratio", "missing"), [(100, 0.1, 0.0), (300, 0.001, 0.0), (300, 5.0, 0.3)])
def test_false_alarm_rates_are_near_their_nominal_levels(n, ratio, missing):
    """200 well-specified records, each test at 5 %: the rate's own standard error is 1.5 %."""
    runs = 200
    alarms = []
    for seed in range(runs):
        found = judge(noisy_walk(n, ratio, seed=seed, missing=missing), ratio)
        p = found.ljung_box_p, found.variance_ratio_p, normal(found)[1], found.slow_p
        outside = abs(found.r1) > found.r1_bound, not found.nis_low <= found.nis <= found.nis_high
        alarms.append([*(one < 0.05 for one in p), *outside, found.advice != NO_FAULT])
    *rates, advice = np.mean(alarms, axis=0)
    assert min(rates) >= 0.01, rates
    assert max(rates) <= 0.09, rates
    assert advice <= 0.10


# --- detection, and the amount of the advice ------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.003, 0.1, 1.0])
@pytest.mark.parametrize(("wrong", "word"), [(0.1, "too slow: raise q about"), (10.0, "too fast: lower q about")])
def test_wrong_q_is_named_and_the_factor_is_about_right(ratio, wrong, word):
    factors = []
    for seed in range(20):
        found = judge(noisy_walk(2000, ratio, seed=seed), ratio * wrong)
        assert word in found.advice
        factors.append(found.q_factor * wrong)
        assert 0.3 < found.q_factor * wrong < 3.0
        assert found.r_factor == pytest.approx(1.0, abs=0.4)
    assert math.exp(np.mean(np.log(factors))) == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize(("q_wrong", "r_wrong"), [(0.1, 2.0), (10.0, 0.5), (2.0, 20.0), (30.0, 30.0), (1e-5, 1.0)])
def test_following_the_advice_raises_the_likelihood_and_ends_in_no_fault(q_wrong, r_wrong):
    z = noisy_walk(3000, 0.02, seed=8)
    q, r = 0.02 * q_wrong, r_wrong
    likelihood, pace = -math.inf, judge(z, q, r).advice[:8]
    assert q_wrong == r_wrong or pace == ("too slow" if q_wrong < r_wrong else "too fast")
    for _ in range(4):
        result = kalman_filter(z, FilterParams(q, r))
        found = judge(z, q, r)
        assert float(result.loglik) > likelihood
        likelihood = float(result.loglik)
        if found.advice == NO_FAULT:
            break
        q, r = q * found.q_factor, r * found.r_factor
    assert found.advice == NO_FAULT
    assert 0.5 < q / 0.02 < 2.0
    assert 0.8 < r < 1.25


def test_spikes_are_counted_located_and_sent_to_the_gate():
    z = noisy_walk(2000)
    where = np.array([200, 555, 901, 1300, 1999])
    z[where] += np.array([30.0, -20.0, 15.0, -12.0, 25.0])
    found = judge(z, 0.01)
    assert (found.spikes, found.jumps) == (5, 0)
    assert found.spike_indices.tolist() == [200, 1999, 555, 901, 1300]
    assert found.advice == "spikes: 5 beyond 4 σ: switch the outlier gate on"
    gated = judge(z, 0.01, gate=16.0)
    assert (gated.advice, gated.n) == (NO_FAULT, found.n - 5)
    narrow = "spikes: 3 beyond 4 σ pass the outlier gate: narrow it to 4 σ"
    assert judge(z, 0.01, gate=400.0).advice == narrow
    assert judge(z, 1e-4, gate=400.0).advice == "too slow: raise q about 100 ×"  # which explains the spikes


def test_the_mean_nis_has_a_band_unless_the_samples_are_too_few():
    found = [judge(noisy_walk(n), 0.01) for n in (6, 401)]
    assert [residual_rows(one)[0][2] for one in found] == ["any value: too few samples", "0.866 to 1.14"]


# --- gaps, irregular time, long records ----------------------------------------------------------------


def test_gaps_neither_raise_alarms_nor_hide_faults():
    z = noisy_walk(3000, 0.02, missing=0.4)
    assert judge(z, 0.02).advice == NO_FAULT
    assert judge(z, 0.002).q_factor == pytest.approx(10.0, rel=0.6)
    assert judge(z, 0.02).n == np.isfinite(z).sum() - 1


@pytest.mark.parametrize("r", [1.0, 1e-6])
def test_irregular_time_is_taken_from_the_result(r):
    g = np.random.default_rng(10)
    dt = g.exponential(1.0, 4000)
    z = np.cumsum(g.normal(size=4000) * np.sqrt(0.05 * dt)) + g.normal(0, math.sqrt(r), 4000)
    assert judge(z, 0.05, r, dt).advice == NO_FAULT
    assert judge(z, 0.005, r, dt).q_factor == pytest.approx(10.0, rel=0.4)


def test_verdict_does_not_depend_on_the_unit():
    z = noisy_walk(1000, 0.01)
    plain = judge(z, 0.001, 2.0)
    for unit in (1e-9, 1e9, 1e140, 1e-140):
        scaled = judge(z * unit, 0.001 * unit**2, 2.0 * unit**2)
        assert scaled.advice == plain.advice
        assert (scaled.q_factor, scaled.ljung_box) == pytest.approx((plain.q_factor, plain.ljung_box), rel=1e-6)


# --- held-out half --------------------------------------------------------------------------------------


def test_nis_of_the_held_out_half_tells_what_the_fitted_half_cannot():
    g = np.random.default_rng(11)
    z = np.r_[np.cumsum(g.normal(size=400)), np.cumsum(3.0 * g.normal(size=400))]

    def overfit(z, dt):
        """The best q of white noise by eye: the worst thing one can do to a record, r = 0 and q = var(Δz)."""
        return FilterParams(q=float(np.nanvar(np.diff(z))), r=0.0)

    inside = judge(z[:400], overfit(z[:400], None).q, 0.0)
    outside = diagnose_held_out(z, overfit)
    assert inside.nis == pytest.approx(1.0, abs=0.01)
    assert outside.nis > outside.nis_high
    assert outside.nis == pytest.approx(9.0, rel=0.2)


# --- edge cases -----------------------------------------------------------------------------------------


def test_record_with_nothing_to_judge_says_so_and_wrong_arguments_are_refused():
    assert all("the signal is constant" in judge(np.full(100, 20.1), q).advice for q in (0.0, 0.01))
    assert all("too few samples to judge" in judge(z, 0.01).advice for z in (np.full(100, np.nan), np.zeros(0)))
    assert "too few samples to judge (19 scored, 20 needed)" in judge(noisy_walk(20), 0.01).advice
    with pytest.raises(BadSetting, match="lags must be a whole number of at least 1"):
        diagnose(kalman_filter(noisy_walk(), FilterParams(0.01, 1.0)), lags=0)
    with pytest.raises(BadSetting, match="z must have shape"):
        diagnose_held_out(np.zeros((10, 2)), FilterParams(1.0, 1.0))


@pytest.mark.slow
@pytest.mark.parametrize("q", [0.0, 1e-300, 1e-9, 1.0, 1e9, 1e300])
@pytest.mark.parametrize("r", [0.0, 1e-300, 1.0, 1e300])
@pytest.mark.parametrize("p0", [None, 0.0, 1.0])
def test_no_parameters_make_it_fail(q, r, p0):
    if q == r == 0.0:
        return
    g = np.random.default_rng(12)
    z = g.normal(size=200)
    odd = np.round(z), np.arange(60.0), np.r_[np.zeros(59), 1e6], np.repeat([0.0, 1.0], 30)
    with np.errstate(all="ignore"):
        for one in (z, *odd, np.where(g.random(200) < 0.8, np.nan, 1e9 + z)):
            judge(one, q, r, p0=p0)


# ---- momentum


@pytest.mark.slow
@pytest.mark.parametrize(("tau", "r"), [(10.0, 0.1), (30.0, 1.0), (30.0, 1e-3), (100.0, 1.0), (700.0, 0.01)])
@pytest.mark.parametrize("ratio", [0.01, 1.0])
def test_where_momentum_describes_what_is_left_it_is_what_to_try(tau, r, ratio):
    z = moving(6000, tau, q=1.0, r=r, seed=2)
    said = diagnose(kalman_filter(z, FilterParams(ratio, r))).advice
    assert said.endswith("; estimate q, r and momentum together")
    tried = diagnose(kalman_filter(z, FilterParams(1.0, r, momentum=tau)))
    assert tried.advice == NO_FAULT


@pytest.mark.parametrize(("q", "r"), [(1e-3, 1.0), (1.0, 1e-4), (0.0, 1.0), (1.0, 0.0)])
def test_with_momentum_the_best_pair_is_that_at_this_momentum(q, r):
    judged = diagnose(kalman_filter(moving(6000, 30.0, q=1.0, seed=3), FilterParams(q, r, momentum=30.0)))
    if q * r:
        assert (q * judged.q_factor, r * judged.r_factor) == pytest.approx((1.0, 1.0), rel=0.05)
    else:
        assert judged.evidence.correction.leaves_edge
