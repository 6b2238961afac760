"""The estimators side by side, and which lie within the 95 % interval of maximum likelihood."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kalscope.errors import Cancelled
from kalscope_app.studies.comparisons import compare_methods, comparison, is_within

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


def walk(n, ratio, seed=0):
    g = np.random.default_rng(seed)
    return np.cumsum(g.normal(0, math.sqrt(ratio), n)) + g.normal(size=n)


def test_the_seasons_of_the_uk_drivers_take_the_allan_variance_out_of_the_interval():
    table = compare_methods(np.log(np.array(UK_DRIVERS.split(), dtype=float)))
    best, allan = table[0], table[-1]
    assert best.ratio == pytest.approx(5.341, abs=1e-3)
    assert allan.ratio == pytest.approx(0.3866, abs=1e-4)
    assert [is_within(one, best) for one in (best, allan)] == [True, False]
    assert comparison(table).startswith("Outside the 95 % interval of maximum likelihood: ")
    assert "Allan variance" in comparison(table)
    assert comparison(table, momentum=20.0).startswith("They need not agree here")


def test_the_methods_lie_within_the_interval_where_the_model_holds():
    table = compare_methods(walk(400, 3.0))
    assert [is_within(one, table[0]) for one in table] == [True] * len(table)
    assert comparison(table) == "The q/r of every method lies within the 95 % interval of maximum likelihood."


@pytest.mark.parametrize("z", [[1.0, 2.0], [3.0] * 50])
def test_a_record_that_says_nothing_is_not_compared(z):
    table = compare_methods(z)
    assert comparison(table) == ""
    assert {is_within(one, table[0]) for one in table} == {None}


def test_the_comparison_reports_its_progress_and_can_be_cancelled():
    seen = []
    compare_methods(walk(100, 1.0), progress=lambda done, _text: seen.append(done))
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    with pytest.raises(Cancelled):
        compare_methods(walk(100, 1.0), cancelled=lambda: True)
