"""What a device loses by a filter that it shares with others."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fleets import fleet

from kalscope import (
    BadSetting,
    FilterParams,
    estimate,
    estimate_fixed_ratio,
    kalman_filter,
    log_likelihood,
    steady_state,
)
from kalscope.estimation.fleet.loss import fleet_loss, share_served
from kalscope.estimation.fleet.pool import pool_of
from kalscope.estimation.fleet.pooled import fit_pool


def prediction_error(z, ratio, since):
    """The oracle: root mean square of the innovations of the filter from one sample on."""
    innovation = kalman_filter(z, FilterParams(ratio, 1.0)).innovation[since:]
    return math.sqrt(np.mean(innovation**2))


def test_each_number_is_that_of_the_single_functions():
    rows = fleet(6, 301, [0.001, 0.01, 0.03, 0.1, 1.0, 5.0])
    loss = fleet_loss(rows, 0.05)
    for i, z in enumerate(rows):
        own, fixed = estimate(z, momentum=0.0, robust=False), estimate_fixed_ratio(z, 0.05, robust=False)
        half = estimate(z[:150], momentum=0.0, robust=False)
        assert loss.own_ratio[i] == pytest.approx(own.ratio, rel=1e-9)
        assert loss.r[i] == pytest.approx(fixed.r, rel=1e-12)
        assert loss.loglik_loss[i] == pytest.approx(own.loglik - fixed.loglik, abs=1e-9)
        assert loss.error[i] == pytest.approx(prediction_error(z, 0.05, 150), rel=1e-9)
        if 0.0 < half.ratio < math.inf:
            assert loss.own_error[i] == pytest.approx(prediction_error(z, half.ratio, 150), rel=1e-9)
        lags = [steady_state(FilterParams(ratio, 1.0)) for ratio in (0.05, own.ratio)]
        assert loss.lag_loss[i] == pytest.approx(lags[0].lag_samples - lags[1].lag_samples)
        assert loss.noise_loss_db[i] == pytest.approx(lags[1].noise_reduction_db - lags[0].noise_reduction_db)


def test_a_common_noise_costs_more():
    rows = fleet(5, 300, r=[0.2, 0.5, 1.0, 2.0, 5.0], q=0.05)
    alone, common = fleet_loss(rows, 0.05), fleet_loss(rows, 0.05, r=1.0)
    assert np.all(common.loglik_loss >= alone.loglik_loss)
    for z, loss in zip(rows, common.loglik_loss, strict=True):
        own = estimate(z, momentum=0.0, robust=False).loglik
        assert loss == pytest.approx(own - log_likelihood(z, FilterParams(0.05, 1.0)), abs=1e-8)


def test_its_own_filter_costs_nothing_and_any_other_something():
    rows = fleet(20, 400, 0.05)
    own = fleet_loss(rows, 0.05).own_ratio
    assert fleet_loss(rows, own).loglik_loss == pytest.approx(0.0, abs=1e-9)
    assert np.all(fleet_loss(rows, own * 1.3).loglik_loss > 0.0)


def test_at_the_pooled_ratio_the_slopes_cancel():
    rows = fleet(20, 400, 0.05, seed=2)
    found = fit_pool(pool_of(rows))
    slopes = fleet_loss(rows, found.ratio).slope
    assert abs(slopes.sum()) < 1e-4 * np.abs(slopes).sum()


def test_devices_like_the_fleet_are_served_and_others_are_not():
    rows = fleet(100, 600, np.append(np.full(90, 0.01), np.full(10, 10.0)))
    loss = fleet_loss(rows, 0.01)
    badly = np.flatnonzero(loss.error_ratio > 1.1)
    assert set(badly) == set(range(90, 100))
    assert share_served(loss.error_ratio) == 0.9
    assert share_served(loss.error_ratio, within=100.0) == 1.0
    assert share_served([math.nan]) == 1.0


def test_series_that_cannot_be_judged_are_nan():
    z = fleet(1, 12, 0.1)[0]
    loss = fleet_loss([z, np.zeros(20), [1.0, 2.0], []], 0.1)
    assert loss.counted.tolist() == [True, False, False, False]
    assert np.isnan(loss.error_ratio).all()  # half of twelve samples is too short to be fitted
    assert np.isnan(loss.loglik_loss).tolist() == [False, True, True, True]
    assert len(fleet_loss([], 0.1).r) == 0


@pytest.mark.parametrize(
    "options", [{"ratio": 0.0}, {"ratio": math.nan}, {"ratio": 1.0, "r": -1.0}, {"ratio": "a"}]
)
def test_wrong_arguments_are_refused(options):
    with pytest.raises(BadSetting, match="must be"):
        fleet_loss([np.zeros(9)], **options)
