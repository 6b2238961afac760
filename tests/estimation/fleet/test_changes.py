"""Which device has changed between its files."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fleets import fleet

from kalscope import BadSetting, estimate_many
from kalscope.estimation.pool import changes, holm


def files_of(devices, files, samples, r=1.0, q=0.02, seed=1):
    """ln r and ln q of each file with their intervals, device after device; r and q one a file."""
    table = estimate_many(fleet(devices * files, samples, q, r, seed))
    with np.errstate(divide="ignore"):
        return [
            (np.log(value), (np.log(ends[0]), np.log(ends[1])))
            for value, ends in ((table.r, table.r_interval), (table.q, table.q_interval))
        ]


def order_of(devices, files):
    return np.repeat(np.arange(devices), files), np.tile(np.arange(files), devices)


def test_the_statistic_is_the_textbook_one():
    from scipy import stats

    values, errors = np.array([1.0, 1.5, 0.7, 4.0, 4.2]), np.array([0.2, 0.3, 0.1, 0.2, 0.1])
    found = changes(
        values, (values - 1.959964 * errors, values + 1.959964 * errors), list("aaabb"), [3, 1, 2, 1, 2]
    )
    weights = 1.0 / errors[:3] ** 2
    mean = np.average(values[:3], weights=weights)
    chi2 = np.sum(weights * (values[:3] - mean) ** 2)
    assert found.device.tolist() == ["a", "b"]
    assert found.files.tolist() == [3, 2]
    assert found.mean[0] == pytest.approx(mean)
    assert found.chi2[0] == pytest.approx(chi2, rel=1e-6)
    assert found.p[0] == pytest.approx(stats.chi2.sf(chi2, 2), rel=1e-5)
    assert found.expected == pytest.approx(0.1)


@pytest.mark.slow
def test_devices_that_do_not_change_are_left_alone():
    alarms, share = 0, []
    for seed in range(10):
        for values, interval in files_of(60, 5, 400, seed=seed):
            found = changes(values, interval, *order_of(60, 5))
            alarms += len(found.changed) > 0
            share.append(np.mean(found.p < 0.05))
    assert alarms <= 4  # 1 expected of 20 fleets
    assert 0.02 < np.mean(share) < 0.09


@pytest.mark.slow
def test_a_device_that_grows_noisier_is_named_with_the_file_and_the_size():
    r = np.ones(60 * 5)
    r[7 * 5 + 3 : 8 * 5] = 2.0  # device 7 from its fourth file on
    (noise, interval), _ = files_of(60, 5, 600, r=r)
    found = changes(noise, interval, *order_of(60, 5))
    assert found.changed.tolist() == [7]
    assert found.step_at[7] == 7 * 5 + 3
    assert found.step[7] == pytest.approx(math.log(2.0), abs=0.2)


def test_files_that_say_nothing_do_not_count():
    values = np.array([1.0, math.nan, 1.1, 1.0, 5.0])
    low, high = np.array([0.5, math.nan, 0.6, -math.inf, 4.5]), np.array([1.5, math.nan, 1.6, math.inf, 5.5])
    found = changes(values, (low, high), list("aaaab"), range(5))
    assert found.files.tolist() == [2, 1]
    assert found.p[1] == found.adjusted_p[1] == 1.0
    assert (found.step_at[1], found.step[1]) == (-1, 0.0)


def test_an_estimate_of_zero_counts_where_it_contradicts_the_others():
    values = np.array([0.0, 0.1, -math.inf, 0.0, 0.1, -math.inf])
    low, high = values - 0.5, np.array([0.5, 0.6, 1.0, 0.5, 0.6, -9.0])
    found = changes(values, (low, high), list("aaabbb"), range(6))
    assert found.changed.tolist() == [1]


@pytest.mark.slow
def test_holm_is_that_of_statsmodels():
    from statsmodels.stats.multitest import multipletests

    p = np.random.default_rng(1).uniform(0.0, 1.0, 40) ** 3
    np.testing.assert_allclose(holm(p), multipletests(p, method="holm")[1])
    assert holm(np.empty(0)).size == 0


def test_wrong_arguments_are_refused():
    with pytest.raises(BadSetting, match="one entry a file"):
        changes([1.0, 2.0], ([0.0, 0.0], [3.0, 3.0]), [1], [1, 2])
    with pytest.raises(BadSetting, match="interval must"):
        changes([1.0, 2.0], ([0.0, 0.0], [3.0]), [1, 1], [1, 2])
