"""Second opinions: whether chance explains how far they lie from maximum likelihood, and when they do not count."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kalscope.analysis.alternatives.agreement import simulation
from kalscope.analysis.alternatives.agreement.comparison import compare_methods
from kalscope.analysis.alternatives.agreement.weighing import Opinion, spikes_in, weigh
from kalscope.analysis.alternatives.agreement.words import comparison, disagreement, worth_showing
from kalscope.common.progress import Progress
from kalscope.errors import Cancelled
from kalscope.estimation.likelihood.profile import Differences, differences
from kalscope.estimation.methods import maximum_likelihood as ml
from kalscope.estimation.methods.by_name import QUICK

UK_DRIVERS = """
1687 1508 1507 1385 1632 1511 1559 1630 1579 1653 2152 2148 1752 1765 1717 1558
1575 1520 1805 1800 1719 2008 2242 2478 2030 1655 1693 1623 1805 1746 1795 1926
1619 1992 2233 2192 2080 1768 1835 1569 1976 1853 1965 1689 1778 1976 2397 2654
2097 1963 1677 1941 2003 1813 2012 1912 2084 2080 2118 2150 1608 1503 1548 1382
1731 1798 1779 1887 2004 2077 2092 2051 1577 1356 1652 1382 1519 1421 1442 1543
1656 1561 1905 2199 1473 1655 1407 1395 1530 1309 1526 1327 1627 1748 1958 2274
1648 1401 1411 1403 1394 1520 1528 1643 1515 1685 2000 2215 1956 1462 1563 1459
1446 1622 1657 1638 1643 1683 2050 2262 1813 1445 1762 1461 1556 1431 1427 1554
1645 1653 2016 2207 1665 1361 1506 1360 1453 1522 1460 1552 1548 1827 1737 1941
1474 1458 1542 1404 1522 1385 1641 1510 1681 1938 1868 1726 1456 1445 1456 1365
1487 1558 1488 1684 1594 1850 1998 2079 1494 1057 1218 1168 1236 1076 1174 1139
1427 1487 1483 1513 1357 1165 1282 1110 1297 1185 1222 1284 1444 1575 1737 1763
"""
"""Car drivers killed or seriously injured in Great Britain, a month, 1969 to 1984: Harvey & Durbin (1986)."""


@pytest.fixture(scope="module")
def drivers():
    return compare_methods(np.log(np.array(UK_DRIVERS.split(), dtype=float)))


def walk(n, ratio, seed=0, missing=0.0):
    g = np.random.default_rng(seed)
    z = np.cumsum(g.normal(0, math.sqrt(ratio), n)) + g.normal(size=n)
    z[g.random(n) < missing] = np.nan
    return z


def opinions(z):
    data = differences(z, np.empty(0))
    best = ml.fit(data, ml.search(data, Progress()))
    broken = spikes_in(data, best)
    return {name: weigh(name, data, best, fit(data), broken, Progress()) for name, fit in QUICK.items()}


# --- where the model does not hold ----------------------------------------------------------------------


@pytest.mark.slow
def test_the_seasons_of_the_uk_drivers_make_the_methods_disagree(drivers):
    """q/r is 5.34 by maximum likelihood, 0.387 by Allan variance, and no simulated record gives so little."""
    allan = drivers[-1]
    assert drivers[0].ratio == pytest.approx(5.341, abs=1e-3)
    assert allan.ratio == pytest.approx(0.3866, abs=1e-4)
    assert allan.agreement == pytest.approx(1 / (1 + simulation.SIMULATIONS))
    assert worth_showing(drivers)
    said = disagreement(drivers)
    assert said.startswith("The model does not describe this signal: maximum likelihood finds gain 0.86, the Allan")
    assert said in drivers[0].message
    assert said in comparison(drivers)


@pytest.mark.slow
def test_a_long_record_is_simulated_shorter_and_still_contradicts():
    z = np.sin(np.arange(50_000) / 40) * 5 + np.random.default_rng(0).normal(size=50_000)
    assert opinions(z)["allan"].agreement < 0.01


# --- where it does --------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("n", "ratio", "missing"), [(80, 0.1, 0.0), (400, 3.0, 0.2), (7000, 0.01, 0.0)])
def test_chance_explains_the_answers_to_records_of_the_model(n, ratio, missing):
    for seed in range(4 if n < 1000 else 1):
        table = compare_methods(walk(n, ratio, seed, missing))
        assert disagreement(table) == ""
        assert not worth_showing(table)
        assert "chance explains" in comparison(table).lower()


@pytest.mark.slow
def test_the_share_does_not_depend_on_the_unit():
    z = walk(300, 0.5)
    assert opinions(z) == opinions(2.0**40 * z)


@pytest.mark.slow
def test_a_filter_that_would_be_the_same_does_not_contradict(drivers):
    """However sure a difference is, it is not worth a word where the filter stays as it is."""
    first, allan = drivers[0], drivers[-1]
    near = type(allan)(**{**vars(allan), "q": 1.05 * first.q, "r": first.r, "ratio": 1.05 * first.ratio})
    assert disagreement([first, near]) == ""
    twice = type(allan)(**{**vars(allan), "q": 2 * first.q, "r": 2 * first.r, "ratio": first.ratio})
    assert "the same gain from 2.0 times the variances" in disagreement([first, twice])


# --- when they do not count -----------------------------------------------------------------------------


@pytest.mark.slow
def test_spikes_silence_the_methods_that_cannot_bear_them():
    z = walk(2000, 0.1)
    z[::100] += 20.0
    assert {one.not_counted for one in opinions(z).values()} == {"20 samples are spikes or jumps, beyond 4 σ"}
    table = compare_methods(z)
    assert not worth_showing(table)
    assert comparison(table) == (
        "The moments of the differences, the innovations and the Allan variance do not count: "
        "20 samples are spikes or jumps, beyond 4 σ."
    )


@pytest.mark.slow
@pytest.mark.parametrize("at", [0, 1000, -1])
def test_one_large_spike_silences_them_wherever_it_is(at):
    """At the end it makes a single large innovation, in the middle several."""
    z = walk(2000, 0.01)
    z[at] += 200.0
    assert all("beyond 4 σ" in one.not_counted for one in opinions(z).values())
    assert not worth_showing(compare_methods(z))


def test_gaps_silence_the_method_that_needs_samples_in_a_row():
    found = opinions(walk(600, 0.1, missing=0.4))
    assert {name for name, one in found.items() if one.not_counted} == {"als"}


@pytest.mark.slow
def test_second_opinions_do_not_count_beside_momentum(drivers):
    assert not worth_showing(drivers, momentum=20.0)
    assert comparison(drivers, momentum=20.0).startswith("They need not agree here")


@pytest.mark.parametrize("z", [[1.0, 2.0], [3.0] * 50])
def test_no_agreement_is_claimed_for_a_record_that_says_nothing(z):
    table = compare_methods(z)
    assert comparison(table) == ""
    assert not worth_showing(table)


# --- manners --------------------------------------------------------------------------------------------


def test_the_law_is_simulated_once_and_always_the_same():
    data, told = Differences(np.ones(50), np.empty(0), 1.0), []
    progress = Progress(lambda _done, text: told.append(text))
    first = simulation.law("moments", data, 0.7, 30, progress)
    assert told
    told.clear()
    assert np.array_equal(simulation.law("moments", data, 0.7, 30, progress), first)
    assert not told
    longer = simulation.law("moments", data, 0.7, 45, progress)
    assert np.array_equal(longer[:30], first)


def test_simulated_records_have_the_variance_that_was_asked_for():
    data = Differences(np.ones(4000), np.full(4000, 2.0), 1.0)
    q, r = simulation.law("moments", data, 0.3, 20, Progress()).mean(axis=0)
    assert (q, r) == pytest.approx((0.3, 1.0), rel=0.08)


def test_a_simulation_can_be_cancelled():
    with pytest.raises(Cancelled):
        simulation.law("als", Differences(np.ones(77), np.empty(0), 1.0), 0.3, 9, Progress(None, lambda: True))


def test_em_climbs_the_same_likelihood_and_does_not_count():
    data = differences(walk(100, 1.0), np.empty(0))
    best = ml.fit(data, ml.search(data, Progress()))
    assert weigh("em", data, best, best, "", Progress()) == Opinion(1.0, "it maximises the same likelihood")
