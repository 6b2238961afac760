"""Many series: each as `estimate` finds it, one filter for all of them, and the devices unlike the others."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kalscope import BadSetting, FilterParams, estimate, kalman_filter
from kalscope.estimation import pool
from kalscope.estimation.fit import estimate_fixed_r, estimate_fixed_ratio
from kalscope.estimation.likelihood import DROP, differences, log_likelihood
from kalscope.estimation.many import estimate_many, pair_intervals, series_of
from kalscope.estimation.pool import fit_pool, held_out, held_out_at, pool_at, pool_of

NAN = np.nan


def walk(seed, n, ratio, size=1.0):
    """A random walk in noise: r = size², q = ratio · size²."""
    rng = np.random.default_rng(seed)
    return size * (np.cumsum(rng.standard_normal(n)) * np.sqrt(ratio) + rng.standard_normal(n))


EDGES = {
    "empty": [],
    "eight": walk(1, 8, 1.0),
    "all missing": [NAN] * 50,
    "constant": [2.5] * 50,
    "one step": [0.0] * 20 + [1.0] * 20,
    "a straight line": np.arange(60.0),
    "noise alone": walk(3, 300, 0.0),
    "alternating": [1.0, -1.0] * 40,
    "too huge": 1e200 * walk(5, 200, 0.1),
    "too tiny": 1e-200 * walk(5, 200, 0.1),
    "far from zero": 1e9 + walk(6, 400, 0.05),
    "rounded": np.round(0.3 * np.cumsum(np.random.default_rng(7).standard_normal(500))),
    "first missing": np.append([NAN] * 9, walk(8, 90, 0.3)),
    "long": walk(9, 20_000, 0.01),
}


def assert_same(table, row, one, named=""):
    assert table.verdict[row] == one.verdict, named
    for name in ("q", "r", "ratio"):
        assert getattr(table, name)[row] == pytest.approx(getattr(one, name), rel=1e-9, abs=0.0), (named, name)


def test_edge_series_give_the_verdicts_of_estimate():
    table = estimate_many(series_of(EDGES.values()), robust=False)
    assert {"too_few", "constant", "no_noise", "no_movement", "bad_unit", "below_resolution"} <= set(table.verdict)
    for row, (name, z) in enumerate(EDGES.items()):
        assert_same(table, row, estimate(np.asarray(z, float), momentum=0.0, robust=False), name)


def simulated(count):
    """Series with and without spikes, steps of the level, rounding and gaps."""
    rng = np.random.default_rng(19)
    for seed in range(count):
        z = walk(seed, int(rng.integers(8, 1500)), 10.0 ** rng.uniform(-6, 3), 10.0 ** rng.uniform(-4, 4))
        size = np.nanstd(np.diff(z))
        if seed % 3 == 0:
            z[rng.integers(0, len(z), 3)] += size * rng.uniform(2.0, 30.0)
        if seed % 5 == 0:
            z[rng.random(len(z)) < 0.2] = NAN
        if seed % 7 == 0:
            z = np.round(4.0 * z / np.nanstd(z))
        if seed % 11 == 0:
            z[len(z) // 2 :] += 10.0 * size
        yield z


@pytest.mark.slow
def test_spikes_are_set_aside_and_intervals_are_found_as_by_estimate():
    series = list(simulated(60))
    table, singles = estimate_many(series_of(series)), [estimate(z, momentum=0.0) for z in series]
    assert 7 < np.count_nonzero(table.spikes) < 40
    assert len(table.set_aside) == table.spikes.sum()
    starts = np.cumsum([0, *map(len, series)])
    for row, one in enumerate(singles):
        assert_same(table, row, one, row)
        away = np.empty(0) if one.outliers is None else np.flatnonzero(one.outliers)
        assert table.spikes[row] == len(away)
        first = np.searchsorted(table.set_aside, starts[row])
        assert table.set_aside[first : first + len(away)].tolist() == [*(starts[row] + away)]
        assert table.gate[row] == (np.inf if one.gate is None else one.gate)

    assert "ok" in table.verdict
    for row in np.flatnonzero(table.verdict == "ok"):  # intervals are of one kind alone or in a table
        one, z = singles[row], series[row]
        ends = [float(end[row]) for end in (*table.q_interval, *table.r_interval)]
        assert pair_intervals(one, z, np.empty(0)) == pytest.approx(ends, rel=1e-9), row
        assert ends[0] <= one.q <= ends[1]
        assert ends[2] <= one.r <= ends[3]


def test_a_series_that_cannot_be_fitted_is_a_row_and_hurts_no_other():
    good = walk(1, 100, 0.1)
    bad = good.copy()
    bad[40] = np.inf
    table = estimate_many(series_of([good, bad, good[:3], good]))
    assert table.verdict.tolist() == ["ok", "infinite", "too_few", "ok"]
    assert table.q[0] == table.q[3] > 0.0 == table.q[1]
    steps = [np.ones(100), np.full(100, -1.0)]
    assert estimate_many(series_of([good, good], steps)).verdict.tolist() == ["ok", "bad_steps"]
    assert len(estimate_many(series_of([]))) == 0


@pytest.mark.parametrize(("known", "value"), [(estimate_fixed_r, 1.0), (estimate_fixed_ratio, 0.05)])
def test_what_is_known_bounds_the_intervals(known, value):
    z = walk(1, 400, 0.1)
    one = known(z, value)
    q_low, q_high, r_low, r_high = pair_intervals(one, z, np.empty(0))
    if known is estimate_fixed_r:
        assert (r_low, r_high) == (1.0, 1.0)
        ends = [log_likelihood(z, FilterParams(q, 1.0)) for q in (q_low, q_high)]
        assert one.loglik - np.array(ends) == pytest.approx([DROP, DROP], abs=1e-4)
    else:
        assert (q_low / r_low, q_high / r_high) == pytest.approx((value, value))
        assert r_high / r_low == pytest.approx(np.exp(2.0 * 1.96 * np.sqrt(2.0 / 399)), rel=1e-3)


def fleet(devices, samples, q=0.01, r=1.0, seed=1):
    """Records of shape (devices, samples); q and r are numbers, or one a device."""
    rng = np.random.default_rng(seed)
    steps, noise = rng.standard_normal((2, devices, samples))
    q, r = (np.broadcast_to(np.asarray(value, float), (devices,))[:, None] for value in (q, r))
    return np.cumsum(steps, axis=1) * np.sqrt(q) + noise * np.sqrt(r)


def uneven(devices=40, seed=3):
    """Devices of different lengths, noises and movements."""
    rng = np.random.default_rng(seed)
    q = 0.02 * np.exp(0.4 * rng.standard_normal(devices))
    rows = fleet(devices, 400, q, rng.uniform(0.5, 2.0, devices), seed)
    return [row[: int(rng.integers(60, 400))] for row in rows]


def summed(series, log_ratios):
    """The oracle: the log-likelihoods of all devices, added."""
    return sum(differences(np.asarray(z), np.empty(0)).concentrated(log_ratios) for z in series)


@pytest.mark.parametrize("seed", [0, 2, 4, 5])
def test_the_ratio_is_that_of_a_direct_search_to_a_millionth(seed):
    series = fleet(30, 100 + 60 * seed, 10.0 ** (2 - seed), seed=seed)
    found = fit_pool(pool_of(series_of(series)))
    h = 1e-3
    low, here, high = summed(series, math.log(found.ratio) + h * np.array([-1.0, 0.0, 1.0]))
    newton = 0.5 * h * (high - low) / (2.0 * here - low - high)  # what is left to the top of the exact sum
    assert abs(newton) < 1e-6
    assert found.loglik == pytest.approx(here, abs=1e-6)


def test_a_fleet_of_one_is_estimated_as_that_one():
    z = uneven(1)[0]
    found, one = fit_pool(pool_of(series_of([z]))), estimate(z, momentum=0.0, robust=False)
    numbers = [(fit.q, fit.r, fit.ratio, *fit.ratio_interval) for fit in (found, one)]
    assert numbers[0] == pytest.approx(numbers[1], rel=1e-6)
    assert found.loglik == pytest.approx(one.loglik, abs=1e-6)


def test_edges_are_verdicts():
    noise = np.random.default_rng(1).standard_normal((40, 301))
    still = fit_pool(pool_of(series_of(np.diff(noise))))  # what rises falls back: less than no movement
    assert (still.verdict, still.q, still.params) == ("no_movement", 0.0, None)
    assert still.r == pytest.approx(2.0, rel=0.05)
    smooth = np.cumsum(noise[:, 1:] + noise[:, :-1], axis=1)  # what rises goes on: less than no noise
    free = fit_pool(pool_of(series_of(smooth)))
    assert (free.verdict, free.r, free.ratio, free.params) == ("no_noise", 0.0, math.inf, None)
    assert free.q == pytest.approx(2.0, rel=0.05)


def test_series_that_cannot_be_fitted_do_not_count():
    series = uneven(5)
    more = [*series, np.full(50, 2.0), np.full(50, np.nan), np.array([1.0, np.inf]), np.zeros(3), np.empty(0)]
    assert pool_of(series_of(more)).devices == 5
    assert pool_of(series_of(more)).sums.tolist() == pool_of(series_of(series)).sums.tolist()


def test_a_chosen_ratio_gets_the_noise_that_fits_it_and_what_has_none_is_refused():
    series = uneven(9)
    each = [estimate_fixed_ratio(z, 0.3, robust=False) for z in series]
    found = pool_at(pool_of(series_of(series)), 0.3)
    assert (found.ratio, found.verdict) == (0.3, "given")
    assert found.r == pytest.approx(math.exp(np.mean([math.log(one.r) for one in each])), rel=1e-7)
    assert found.loglik == pytest.approx(sum(one.loglik for one in each), rel=1e-8)
    with pytest.raises(BadSetting, match="at least one"):
        fit_pool(pool.Pool.empty())
    with pytest.raises(BadSetting, match="ratio must be"):
        pool_at(pool_of(series_of(uneven(2))), 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(("spread", "least"), [(0.0, 52), (1.0, 50)])
def test_the_interval_holds_the_best_ratio_of_a_fleet_of_such_devices_whether_they_differ_or_not(spread, least):
    rng = np.random.default_rng(8)

    def fit(devices, seed):
        q = 0.05 * np.exp(spread * rng.standard_normal(devices))
        return fit_pool(pool_of(series_of(fleet(devices, 200, q, seed=seed))))

    truth = fit(6000, 99).ratio
    found = [fit(40, seed) for seed in range(60)]
    assert least <= sum(one.ratio_interval[0] < truth < one.ratio_interval[1] for one in found) < 60


def prediction_error(z, ratio, dt=None):
    """The oracle: root mean square of the innovations of the filter on the second half."""
    params = FilterParams(ratio, 1.0) if ratio < math.inf else FilterParams(1.0, 0.0)
    return math.sqrt(np.nanmean(kalman_filter(z, params, dt).innovation[len(z) // 2 :] ** 2))


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [1e-5, 0.03, 40.0])
def test_the_errors_are_those_of_the_filter_itself_to_a_thousandth(ratio):
    rows = fleet(24, 600, 10.0 ** np.linspace(-5, 2, 24))
    rows[2, 400:410] = np.nan
    own = [estimate(z[:300], momentum=0.0, robust=False).ratio for z in rows]
    best = [prediction_error(z, max(one, 1e-300)) for z, one in zip(rows, own, strict=True)]
    exact = [prediction_error(z, ratio) for z in rows] / np.array(best)
    growth = held_out(series_of(rows))
    for kind in (np.float64, np.float32):
        np.testing.assert_allclose(held_out_at(growth.astype(kind), ratio), exact, rtol=1e-3)


@pytest.mark.slow
def test_a_filter_of_its_own_may_have_momentum():
    t, rng = np.arange(600.0), np.random.default_rng(6)
    turning = np.sin(t / 15.0) + 0.05 * rng.standard_normal(600)
    rows, dt = [turning, turning, fleet(1, 600, 0.1)[0]], np.ones(600)
    growth = held_out(series_of(rows, [dt] * 3), np.array([True, False, True]))
    own = estimate(turning[:300], robust=False).params
    wanted = math.sqrt(np.mean(kalman_filter(turning, own).innovation[300:] ** 2))
    assert held_out_at(growth, 0.5)[0] == pytest.approx(prediction_error(turning, 0.5) / wanted, rel=1e-3)
    assert held_out_at(growth, 0.5)[0] > 1.2 * held_out_at(growth, 0.5)[1]  # without it less is lost
    assert growth[2].tolist() == held_out(series_of([rows[2]]))[0].tolist()  # no momentum was found


def test_devices_like_the_fleet_are_served_and_others_are_not():
    rows = fleet(100, 600, np.append(np.full(90, 0.01), np.full(10, 10.0)))
    growth = held_out_at(held_out(series_of(rows)), 0.01) - 1.0
    assert set(np.flatnonzero(growth > 0.1)) == set(range(90, 100))
    assert pool.share_served(growth) == 0.9
    assert pool.share_served(growth, within=100.0) == 1.0
    assert pool.share_served([math.nan]) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("samples", "q"), [(1000, 0.01), (300, 0.01), (200, 0.001), (400, 1.0), (400, 30.0)])
def test_a_fleet_of_like_devices_names_as_many_by_chance_as_it_says(samples, q):
    named = {"q": 0, "r": 0}
    for seed in range(6):
        table = estimate_many(series_of(fleet(500, samples, q, seed=seed)))
        for name in named:
            low, high = getattr(table, f"{name}_interval")
            with np.errstate(divide="ignore"):
                value, *ends = np.log(
                    [np.where(getattr(table, name) > 0.0, getattr(table, name), np.nan), low, high]
                )
            scores = pool.outliers(value, tuple(ends), expected=1.0)
            named[name] += len(scores.devices)
    assert all(count <= 14 for count in named.values()), named  # 6 expected; more than 14 once in 1000


def test_an_uncertain_value_is_less_unlike():
    values = np.append(np.random.default_rng(3).standard_normal(100), [9.0, 9.0])
    wide = np.append(np.full(101, 0.1), 20.0)
    scores = pool.outliers(values, (values - wide, values + wide), 0.05)
    assert scores.devices.tolist() == [100]
    assert 0.0 < scores.z[101] < 1.0 < scores.z[100]


def test_equal_missing_and_few_values_are_no_alarm():
    def exact(*values):
        return pool.outliers(np.array(values), (np.array(values), np.array(values)), 0.05)

    assert exact(*[3.0] * 20, 4.0).devices.tolist() == [20]
    for same in (exact(*[3.0] * 20), exact(*range(20), math.nan), exact()):
        assert same.devices.size == 0
    assert np.isnan([*exact(1.0, 2.0, math.nan).z, exact(*range(20), math.nan).z[20]]).all()
