"""Which devices are unlike the others: the stated false-alarm rate, and those that are found."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fleets import fleet

from kalscope import BadSetting
from kalscope.estimation.many import estimate_many
from kalscope.estimation.pool import outliers


def logs(values, interval):
    with np.errstate(divide="ignore"):
        return np.log(values), tuple(np.log(end) for end in interval)


@pytest.mark.slow
@pytest.mark.parametrize(("samples", "q"), [(1000, 0.01), (300, 0.01), (200, 0.001), (400, 1.0), (400, 30.0)])
def test_a_fleet_of_like_devices_names_as_many_by_chance_as_it_says(samples, q):
    named = {"q": 0, "r": 0, "ratio": 0}
    for seed in range(6):
        table = estimate_many(fleet(500, samples, q, seed=seed))
        for name in named:
            scores = outliers(*logs(getattr(table, name), getattr(table, f"{name}_interval")), expected=1.0)
            named[name] += len(scores.devices)
    assert all(count <= 14 for count in named.values()), named  # 6 expected; more than 14 once in 1000


def test_an_uncertain_value_is_less_unlike():
    values = np.append(np.random.default_rng(3).standard_normal(100), [9.0, 9.0])
    wide = np.append(np.full(101, 0.1), 20.0)
    scores = outliers(values, (values - wide, values + wide))
    assert scores.devices.tolist() == [100]
    assert 0.0 < scores.z[101] < 1.0 < scores.z[100]


def test_an_estimate_of_zero_is_unlike_only_where_its_interval_is():
    values = np.append(np.random.default_rng(4).standard_normal(50), [-math.inf] * 2)
    low = np.append(values[:50] - 1.0, [-math.inf] * 2)
    high = np.append(values[:50] + 1.0, [2.0, -30.0])
    scores = outliers(values, (low, high))
    assert scores.devices.tolist() == [51]
    assert scores.z[50] == pytest.approx(-1.96, abs=0.01)
    assert outliers(values).z[50] == -math.inf  # without intervals they are what they are


def test_equal_missing_few_and_mostly_zero_values_are_no_alarm():
    assert outliers(np.full(20, 3.0)).devices.size == 0
    assert outliers(np.append(np.full(20, 3.0), 4.0)).devices.tolist() == [20]
    assert np.isnan(outliers([1.0, 2.0, math.nan]).z).all()
    scores = outliers(np.append(np.arange(20.0), math.nan))
    assert math.isnan(scores.z[20])
    assert scores.devices.size == 0
    assert outliers([-math.inf] * 20 + [1.0] * 5).devices.size == 0
    assert outliers([]).devices.size == 0


@pytest.mark.parametrize(
    "options",
    [
        {"values": [[1.0]]},
        {"values": np.arange(9.0), "interval": (np.zeros(9), np.zeros(8))},
        {"values": np.arange(9.0), "interval": (np.arange(9.0) + 1.0, np.arange(9.0) + 2.0)},
        {"values": np.arange(9.0), "expected": 0.0},
        {"values": np.arange(9.0), "expected": 5.0},
    ],
)
def test_wrong_arguments_are_refused(options):
    with pytest.raises(BadSetting, match="must"):
        outliers(**options)
