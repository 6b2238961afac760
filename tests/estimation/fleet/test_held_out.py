"""Prediction errors on unseen samples at any shared λ, from one pass."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fleets import fleet

from kalscope import BadSetting, FilterParams, estimate, kalman_filter
from kalscope.estimation.pool import LOG_RATIOS, held_out, held_out_at, share_served


def prediction_error(z, ratio, dt=None):
    """The oracle: root mean square of the innovations of the filter on the second half."""
    params = FilterParams(ratio, 1.0) if ratio < math.inf else FilterParams(1.0, 0.0)
    return math.sqrt(np.nanmean(kalman_filter(z, params, dt).innovation[len(z) // 2 :] ** 2))


def test_the_errors_are_those_of_the_filter_itself():
    rows = fleet(6, 300, [1e-6, 0.001, 0.03, 0.3, 5.0, 1e6])
    rows[2, 100:110] = np.nan
    growth = held_out(rows)
    for i, z in enumerate(rows):
        own = estimate(z[:150], momentum=0.0, robust=False).ratio
        own_error = prediction_error(z, max(own, 1e-300))
        wanted = [prediction_error(z, math.exp(at)) / own_error for at in LOG_RATIOS]
        np.testing.assert_allclose(growth[i], wanted, rtol=1e-9)


@pytest.mark.parametrize("ratio", [1e-5, 0.002, 0.03, 0.7, 40.0])
def test_between_its_places_it_is_good_to_a_thousandth(ratio):
    rows = fleet(24, 600, 10.0 ** np.linspace(-5, 2, 24))
    own = [estimate(z[:300], momentum=0.0, robust=False).ratio for z in rows]
    exact = [
        prediction_error(z, ratio) / prediction_error(z, max(best, 1e-300))
        for z, best in zip(rows, own, strict=True)
    ]
    np.testing.assert_allclose(held_out_at(held_out(rows), ratio), exact, rtol=1e-3)
    np.testing.assert_allclose(held_out_at(held_out(rows).astype(np.float32), ratio), exact, rtol=1e-3)


def test_a_filter_of_its_own_may_have_momentum():
    t, rng = np.arange(600.0), np.random.default_rng(6)
    turning = np.sin(t / 15.0) + 0.05 * rng.standard_normal(600)
    rows, dt = [turning, turning, fleet(1, 600, 0.1)[0]], np.ones(600)
    growth = held_out(rows, [dt] * 3, np.array([True, False, True]))
    own = estimate(turning[:300], robust=False).params
    wanted = math.sqrt(np.mean(kalman_filter(turning, own).innovation[300:] ** 2))
    assert held_out_at(growth, 0.5)[0] == pytest.approx(prediction_error(turning, 0.5) / wanted, rel=1e-3)
    assert held_out_at(growth, 0.5)[0] > 1.2 * held_out_at(growth, 0.5)[1]  # without it less is lost
    assert growth[2].tolist() == held_out([rows[2]])[0].tolist()  # no momentum was found


def test_devices_like_the_fleet_are_served_and_others_are_not():
    rows = fleet(100, 600, np.append(np.full(90, 0.01), np.full(10, 10.0)))
    growth = held_out_at(held_out(rows), 0.01) - 1.0
    assert set(np.flatnonzero(growth > 0.1)) == set(range(90, 100))
    assert share_served(growth) == 0.9
    assert share_served(growth, within=100.0) == 1.0
    assert share_served([math.nan]) == 1.0


def test_what_cannot_be_judged_is_nan():
    growth = held_out([fleet(1, 100, 0.1)[0], np.zeros(50), np.arange(4.0), [], [1.0, np.inf] * 20])
    assert np.isfinite(growth).all(axis=1).tolist() == [True, False, False, False, False]
    assert np.isnan(held_out_at(growth, 0.1)).tolist() == [False, True, True, True, True]
    assert held_out([]).shape == (0, len(LOG_RATIOS))
    assert held_out_at(held_out([]), 0.1).shape == (0,)


def test_wrong_arguments_are_refused():
    with pytest.raises(BadSetting, match="growth must"):
        held_out_at(np.ones((3, 4)), 0.1)
    with pytest.raises(BadSetting, match="ratio must"):
        held_out_at(np.ones((3, len(LOG_RATIOS))), -1.0)
