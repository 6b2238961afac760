"""One filter for a fleet: the maximum of the summed likelihood, from sums over batches."""

from __future__ import annotations

import math

import numpy as np
import pytest
from each import each
from fleets import fleet

from kalscope import BadSetting, estimate, estimate_fixed_ratio
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


@each("seed", range(6))
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


def test_units_of_the_devices_change_only_r_where_each_has_its_own():
    series = uneven()
    sizes = 10.0 ** np.random.default_rng(1).uniform(-6, 6, len(series))
    found, scaled = (
        fit_pool(pool_of(some)) for some in (series, [z * c for z, c in zip(series, sizes, strict=True)])
    )
    assert scaled.ratio == pytest.approx(found.ratio, rel=1e-9)
    assert scaled.r == pytest.approx(found.r * math.exp(2.0 * np.log(sizes).mean()), rel=1e-9)


@pytest.mark.slow
def test_the_truth_lies_in_the_interval_as_often_as_it_says():
    held = 0
    for seed in range(60):
        low, high = fit_pool(pool_of(fleet(20, 200, 0.05, seed=seed))).ratio_interval
        held += low <= 0.05 <= high
    assert 51 <= held <= 60  # 57 expected; fewer than 51 once in 150


def test_the_pair_of_five_hundred_devices_is_close_to_the_truth():
    found = fit_pool(pool_of(fleet(500, 1000)))
    assert found.ratio_interval[0] < 0.01 < found.ratio_interval[1] < 0.0105
    assert found.r == pytest.approx(1.0, rel=0.01)


def test_edges_are_verdicts():
    noise = np.random.default_rng(1).standard_normal((40, 301))
    still = fit_pool(pool_of(np.diff(noise)))  # what rises falls back: less than no movement
    assert (still.verdict, still.q, still.params) == ("no_movement", 0.0, None)
    assert still.r == pytest.approx(2.0, rel=0.05)
    smooth = np.cumsum(noise[:, 1:] + noise[:, :-1], axis=1)  # what rises goes on: less than no noise
    free = fit_pool(pool_of(smooth))
    assert (free.verdict, free.r, free.ratio, free.params) == ("no_noise", 0.0, math.inf, None)
    assert free.q == pytest.approx(2.0, rel=0.05)


def test_irregular_steps_count():
    rng = np.random.default_rng(4)
    steps = rng.integers(1, 4, (30, 300)).astype(float)
    z = np.cumsum(rng.standard_normal((30, 300)) * np.sqrt(0.05 * steps), axis=1) + rng.standard_normal((30, 300))
    low, high = fit_pool(pool_of(z, steps)).ratio_interval
    assert low < 0.05 < high


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


def test_the_slopes_are_those_of_each_device():
    series, at, h = uneven(5), math.log(0.03), 1e-3
    parts = [differences(np.asarray(z), np.empty(0)) for z in series]
    ends = [one.concentrated(np.array([at - h, at + h])) for one in parts]
    exact = sum(((high - low) / (2.0 * h)) ** 2 for low, high in ends)
    assert pool_of(series).slopes(at) == pytest.approx(exact, rel=0.05)
