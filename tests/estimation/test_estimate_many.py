"""`estimate_many` finds, row for row, what `estimate` finds one by one."""

from __future__ import annotations

import numpy as np
import pytest

from kalscope import FilterParams, estimate
from kalscope.estimation.fit import estimate_fixed_r, estimate_fixed_ratio
from kalscope.estimation.likelihood import DROP, log_likelihood
from kalscope.estimation.many import estimate_many, pair_intervals, series_of

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
