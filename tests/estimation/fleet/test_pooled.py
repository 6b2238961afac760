"""One filter for a fleet: the maximum of the summed likelihood, from sums over batches."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fleets import fleet

from kalscope import BadSetting, estimate
from kalscope.estimation.fit import estimate_fixed_ratio
from kalscope.estimation.likelihood import DEFAULT_LOG_RATIOS, differences
from kalscope.estimation.pool import Pool, fit_pool, pool_at, pool_of


def uneven(devices=40, seed=3):
    """Devices of different lengths, noises and movements."""
    rng = np.random.default_rng(seed)
    rows = fleet(
        devices, 400, 0.02 * np.exp(0.4 * rng.standard_normal(devices)), rng.uniform(0.5, 2.0, devices), seed
    )
    return [row[: int(rng.integers(60, 400))] for row in rows]


def summed(series, log_ratios):
    """The oracle: the log-likelihoods of all devices, added."""
    return sum(differences(np.asarray(z), np.empty(0)).concentrated(log_ratios) for z in series)


def test_the_pool_of_batches_is_the_pool_of_the_fleet():
    series = uneven()
    whole, parts = pool_of(series), sum((pool_of(series[i : i + 7]) for i in range(0, 40, 7)), Pool.empty())
    assert (
        (parts.devices, parts.innovations) == (whole.devices, whole.innovations) == (40, sum(map(len, series)) - 40)
    )
    np.testing.assert_allclose(parts.sums, whole.sums, rtol=1e-12)


def test_between_the_points_of_the_grid_the_pool_is_the_summed_likelihood():
    series, pool = uneven(), pool_of(uneven())
    places = np.random.default_rng(1).uniform(DEFAULT_LOG_RATIOS[0], DEFAULT_LOG_RATIOS[-1], 200)
    np.testing.assert_allclose(pool.loglik(places), summed(series, places), rtol=3e-8)


@pytest.mark.parametrize("seed", range(6))
def test_the_ratio_is_that_of_a_direct_search_to_a_millionth(seed):
    series = fleet(30, 100 + 60 * seed, 10.0 ** (2 - seed), seed=seed)
    found = fit_pool(pool_of(series))
    h = 1e-3
    low, here, high = summed(series, math.log(found.ratio) + h * np.array([-1.0, 0.0, 1.0]))
    newton = 0.5 * h * (high - low) / (2.0 * here - low - high)  # what is left to the top of the exact sum
    assert abs(newton) < 1e-6
    assert found.loglik == pytest.approx(here, abs=1e-6)


def test_a_fleet_of_one_is_estimated_as_that_one():
    z = uneven(1)[0]
    found, one = fit_pool(pool_of([z])), estimate(z, momentum=0.0, robust=False)
    assert (found.q, found.r, found.ratio) == pytest.approx((one.q, one.r, one.ratio), rel=1e-6)
    assert found.ratio_interval == pytest.approx(one.ratio_interval, rel=1e-6)
    assert found.loglik == pytest.approx(one.loglik, abs=1e-6)


def test_edges_are_verdicts():
    noise = np.random.default_rng(1).standard_normal((40, 301))
    still = fit_pool(pool_of(np.diff(noise)))  # what rises falls back: less than no movement
    assert (still.verdict, still.q, still.params) == ("no_movement", 0.0, None)
    assert still.r == pytest.approx(2.0, rel=0.05)
    smooth = np.cumsum(noise[:, 1:] + noise[:, :-1], axis=1)  # what rises goes on: less than no noise
    free = fit_pool(pool_of(smooth))
    assert (free.verdict, free.r, free.ratio, free.params) == ("no_noise", 0.0, math.inf, None)
    assert free.q == pytest.approx(2.0, rel=0.05)


def test_series_that_cannot_be_fitted_do_not_count():
    series = uneven(5)
    more = [*series, np.full(50, 2.0), np.full(50, np.nan), np.array([1.0, np.inf]), np.zeros(3), np.empty(0)]
    assert pool_of(more).devices == 5
    assert pool_of(more).sums.tolist() == pool_of(series).sums.tolist()


def test_a_chosen_ratio_gets_the_noise_that_fits_it():
    series = uneven(9)
    each = [estimate_fixed_ratio(z, 0.3, robust=False) for z in series]
    found = pool_at(pool_of(series), 0.3)
    assert (found.ratio, found.verdict) == (0.3, "given")
    assert found.r == pytest.approx(math.exp(np.mean([math.log(one.r) for one in each])), rel=1e-7)
    assert found.loglik == pytest.approx(sum(one.loglik for one in each), rel=1e-8)


def test_an_empty_fleet_and_wrong_arguments_are_refused():
    with pytest.raises(BadSetting, match="at least one"):
        fit_pool(Pool.empty())
    with pytest.raises(BadSetting, match="ratio must be"):
        pool_at(pool_of(uneven(2)), 0.0)
    assert pool_of([]).devices == 0


@pytest.mark.slow
@pytest.mark.parametrize(("spread", "least"), [(0.0, 52), (1.0, 50)])
def test_the_interval_holds_the_best_ratio_of_a_fleet_of_such_devices_whether_they_differ_or_not(spread, least):
    rng = np.random.default_rng(8)

    def fit(devices, seed):
        return fit_pool(
            pool_of(fleet(devices, 200, 0.05 * np.exp(spread * rng.standard_normal(devices)), seed=seed))
        )

    truth = fit(6000, 99).ratio
    found = [fit(40, seed) for seed in range(60)]
    assert least <= sum(one.ratio_interval[0] < truth < one.ratio_interval[1] for one in found) < 60
