"""q, r and momentum from a record: the maximum of the dense likelihood, in any unit, chosen by evidence."""

from __future__ import annotations

import math
import runpy
from pathlib import Path

import numpy as np
import pytest
from tests.support.effort import FUZZ
from tests.support.signals import moving

from kalscope import BadSetting, FilterParams, estimate, kalman_filter
from kalscope.errors import Cancelled
from kalscope.estimation.likelihood import log_likelihood


@pytest.fixture(scope="module")
def record():
    return moving(1500, 20.0)


def dense_loglik(z, times, q, r, tau):
    """The Gaussian likelihood of the differences of z; their covariance is an integral of that of the velocity."""
    lag = np.abs(times[:, None] - times[None, :])
    # The mean square of x(t) − x(s) is q (h − τ (1 − exp(−h/τ))).
    spread = q * (lag + tau * np.expm1(-lag / tau))
    covariance = 0.5 * (spread[1:, :-1] + spread[:-1, 1:] - spread[1:, 1:] - spread[:-1, :-1])
    covariance += r * (2.0 * np.eye(len(z) - 1) - np.eye(len(z) - 1, k=1) - np.eye(len(z) - 1, k=-1))
    _, logdet = np.linalg.slogdet(covariance)
    d = np.diff(z)
    return -0.5 * (len(d) * math.log(2.0 * math.pi) + logdet + d @ np.linalg.solve(covariance, d))


# --- the maximum ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_it_is_the_maximum_of_the_dense_likelihood():
    """With missing samples and uneven steps, on which no recursion relies."""
    g = np.random.default_rng(4)
    z = moving(400, 15.0, seed=4)
    dt = g.choice([1.0, 2.0], 400)
    z[g.random(400) < 0.1] = np.nan
    found = estimate(z, dt=dt)
    seen = np.isfinite(z)
    record, times = z[seen], np.cumsum(dt)[seen]
    best = dense_loglik(record, times, found.q, found.r, found.momentum)
    assert found.momentum > 0.0
    assert best == pytest.approx(found.loglik, abs=1e-6)
    assert log_likelihood(z, found.params, dt) == pytest.approx(found.loglik, abs=1e-6)
    for q, r, tau in ((1.02, 1.0, 1.0), (1.0, 1.02, 1.0), (1.0, 1.0, 1.02)):
        for sign in (1.0, -1.0):
            beside = dense_loglik(record, times, found.q * q**sign, found.r * r**sign, found.momentum * tau**sign)
            assert beside < best


def test_the_interval_ends_where_twice_the_likelihood_is_3_84_lower(record):
    found = estimate(record)
    for end in found.momentum_interval:
        assert 2.0 * (found.loglik - estimate(record, momentum=end).loglik) == pytest.approx(3.8415, abs=0.02)


# --- laws -----------------------------------------------------------------------------------------------


def test_a_given_momentum_leaves_only_the_ratio_to_find(record):
    best = estimate(record)
    for tau in (1.0, best.momentum, 500.0):
        found = estimate(record, momentum=tau)
        assert found.momentum == tau
        assert found.momentum_interval == (tau, tau)
        assert found.loglik <= best.loglik + 1e-6
        assert found.loglik == pytest.approx(log_likelihood(record, found.params), abs=1e-6)
        for dq, dr in ((1.01, 1.0), (0.99, 1.0), (1.0, 1.01), (1.0, 0.99)):
            assert log_likelihood(record, FilterParams(found.q * dq, found.r * dr, momentum=tau)) < found.loglik
    assert estimate(record, momentum=best.momentum).loglik == pytest.approx(best.loglik, abs=1e-5)


# --- the choice ------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_promised_gain_is_kept_on_samples_to_come():
    z = moving(6000, 20.0, seed=6)
    found, plain = estimate(z[:3000]), estimate(z[:3000], momentum=0)
    after, before = (np.nanstd(kalman_filter(z[3000:], one.params).innovation) for one in (found, plain))
    assert found.prediction_gain > 0.05
    assert 1.0 - after / before == pytest.approx(found.prediction_gain, abs=0.02)


NOISE = np.random.default_rng(1).normal(0.0, 1.0, 400)
SHORT = 20.0 * np.sin(np.arange(64) / 8.0) + np.random.default_rng(0).normal(0.0, 1.0, 64)
"""Momentum raises twice its log-likelihood by 52, which is no chance, but less than so short a record needs."""
EDGES = [(np.sin(np.arange(400) / 20.0), "no_noise", "also with momentum"), (NOISE, "no_movement", "No momentum")]
EDGES += [(moving(50, 10.0), "ok", "too short"), (SHORT, "no_noise", "it raises the likelihood, but not by enough")]


@pytest.mark.parametrize(("z", "verdict", "word"), EDGES)
def test_every_edge_has_its_words(z, verdict, word):
    found = estimate(z)
    assert (found.verdict, word in found.message) == (verdict, True)
    assert (found.params is None) == (verdict != "ok")
    assert not np.isnan([found.q, found.r, found.momentum, *found.momentum_interval, *found.lag_interval]).any()


def test_a_momentum_longer_than_the_record_is_not_claimed():
    z = 0.05 * np.arange(300.0) + np.random.default_rng(7).normal(0.0, 1.0, 300)
    found = estimate(z)
    assert found.momentum_interval[1] == math.inf
    assert 0.0 < found.momentum <= max(300.0, found.momentum_interval[0])


# --- refusals, progress ------------------------------------------------------------------------------------


def test_progress_rises_a_cancel_stops_and_a_momentum_out_of_range_is_refused(record):
    for momentum in (-1.0, 1e6, math.nan, "some", None):
        with pytest.raises(BadSetting, match="momentum must be"):
            estimate(record, momentum=momentum)
    seen = []
    estimate(record, progress=lambda *told: seen.append(told[0]))
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    calls = iter(range(12))
    with pytest.raises(Cancelled):
        estimate(record, cancelled=lambda: next(calls, 99) == 99)


# --- coverage on simulated truth, and walks without momentum; benchmarks/ has the full runs --------------

RUNS = 20 * FUZZ
UNLIKELY = 1e-3
"""Chance at which a count outside the promised shares is taken for a fault and not for luck."""


@pytest.fixture(scope="module")
def benchmark():
    return runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "momentum_coverage.py"))


@pytest.mark.slow
@pytest.mark.parametrize("n", [300, 1500])
def test_the_intervals_cover_the_truth(benchmark, n):
    """Over all τ together: 60 runs can tell 95 % from 67 %, a single τ hardly; 98 % only `make soak` can."""
    from scipy.stats import binom

    rows = [benchmark["coverage"](truth, n, RUNS) for truth in benchmark["TRUTHS"]]
    count = RUNS * len(rows)
    for name in ("q", "r", "tau"):
        covered = round(sum(RUNS * getattr(row, name) for row in rows))
        assert binom.cdf(covered, count, 0.92) > UNLIKELY, (name, covered, count)
        assert binom.sf(covered - 1, count, 0.98) > UNLIKELY, (name, covered, count)


@pytest.mark.slow
def test_the_intervals_cover_the_truth_where_the_choice_is_uncertain_and_random_walks_get_no_momentum(benchmark):
    from scipy.stats import binom

    chosen, *shares = benchmark["uncertain_choice"](RUNS)
    assert 0.0 < chosen < 1.0
    for share in shares:
        assert binom.cdf(round(RUNS * share), RUNS, 0.92) > UNLIKELY
    found = round(RUNS * benchmark["false_momentum"](RUNS))
    assert binom.sf(found - 1, RUNS, 0.02) > UNLIKELY
