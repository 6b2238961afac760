"""What several sensors cannot tell, and what makes the model wrong, is said in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from signals import moving

from kalscope import estimate, estimate_fusion, fuse
from kalscope.estimation.fusion import held_for

PLAIN = {"momentum": 0.0, "robust": False}


def walk(n=1500, seed=1, q=0.1):
    return np.cumsum(np.random.default_rng(seed).normal(0.0, np.sqrt(q), n))


def noise(*sigma, n=1500, seed=2):
    return np.random.default_rng(seed).normal(0.0, 1.0, (n, len(sigma))) * sigma


def said(found, words):
    return any(words in note for note in found.notes)


def test_r_at_nought_gives_a_filter_with_the_largest_that_the_record_allows():
    for seed in range(20):
        x = walk(n=60, seed=seed, q=4.0)
        found = estimate_fusion(np.stack([x, x + noise(1.0, n=60, seed=seed)[:, 0]], 1), **PLAIN)
        if found.verdict == "no_noise":
            break
    assert found.verdict == "no_noise"
    assert found.r[0] == 0.0
    assert found.params is not None
    assert found.params.r[0] == found.r_interval[0, 1] > 0.0
    assert "No noise can be identified in sensor 1" in found.message


def test_rounding_is_the_least_noise():
    x = walk()
    z = np.stack([np.round(2.0 * x) / 2.0, x + noise(1.0)[:, 0]], 1)
    found = estimate_fusion(z, **PLAIN)
    assert found.r[0] >= 0.25 / 12.0 * 0.999
    assert said(found, "variance of rounding") == (found.r[0] < 0.25 / 12.0 * 1.001)


@pytest.mark.parametrize(
    ("z", "verdict", "words"),
    [
        (noise(1.0, 1.0, n=7), "too_few", "at least 8 are needed"),
        (np.where([True, False], noise(1.0, 1.0, n=50), 4.0), "constant", "sensor 2 are equal"),
        (np.where([True, False], noise(1.0, 1.0, n=50), np.nan), "too_few", "sensor 2 has too few readings (0)"),
        (walk(50)[:, None] + [0.0, 3.0], "copies", "sensor 1 and sensor 2 always move exactly alike"),
        (noise(1.0, 1.0, n=50) * 1e-170, "bad_unit", "Choose a unit"),
        (noise(1.0, 1.0, n=50) * 1e170, "bad_unit", "Choose a unit"),
    ],
)
def test_where_there_is_nothing_to_fit_the_sensor_is_named(z, verdict, words):
    found = estimate_fusion(z)
    assert found.verdict == verdict
    assert words in found.message
    assert found.params is None
    assert np.isfinite(found.r).all()


def test_readings_that_a_logger_repeats_are_noticed_but_not_those_of_a_coarse_sensor():
    z = walk(n=400, q=1.0)[:, None] + noise(1.0, 3.0, n=400)
    held, coarse = z.copy(), np.round(z * [1.0, 0.2]) * [1.0, 5.0]
    held[:, 1] = z[np.arange(400) // 4 * 4, 1]
    about = "Each reading of sensor 2 fills about 4 rows"
    assert said(estimate_fusion(held, momentum=0.0, robust=False), about)
    assert not said(estimate_fusion(coarse, momentum=0.0, robust=False), "Each reading of")
    ramp = np.round(0.3 * np.arange(400.0))
    assert held_for(ramp) == held_for(z[:, 1]) == 1


@pytest.mark.slow
def test_a_drifting_offset_is_noticed():
    z = walk()[:, None] + noise(0.5, 0.5, 0.5)
    assert not said(estimate_fusion(z, **PLAIN), "changes slowly")
    z[:, 1] += walk(seed=7, q=0.02)
    assert said(estimate_fusion(z, names=["a", "b", "c"], **PLAIN), "fused value and b changes slowly")


@pytest.mark.slow
def test_spikes_of_each_sensor_are_set_aside_but_not_what_all_see():
    z = walk()[:, None] + noise(1.0, 2.0)
    rng = np.random.default_rng(5)
    rows = np.sort(rng.choice(np.arange(20, 1480), 15, replace=False))
    z[rows, 0] += 60.0
    found = estimate_fusion(z, momentum=0.0)
    assert set(rows) <= set(found.spikes[0])
    assert len(found.spikes[1]) < 3
    assert found.r == pytest.approx([1.0, 4.0], rel=0.15)
    assert found.params is not None
    assert found.params.gate == 16.0
    assert said(found, "set aside")
    assert estimate_fusion(z, **PLAIN).r[0] > 10.0
    away = z.copy()
    for sensor, spikes in enumerate(found.spikes):
        away[spikes, sensor] = np.nan
    assert found.loglik == pytest.approx(fuse(away, replace(found.params, gate=None)).loglik, rel=1e-12)
    both = walk()[:, None] + noise(1.0, 2.0)
    both[rows] += 60.0
    assert not np.intersect1d(estimate_fusion(both, momentum=0.0).spikes[0], rows).size


@pytest.mark.slow
def test_momentum_is_found_by_the_rule_of_one_signal():
    z = moving(1500, 12.0, 6.0, r=0.0, seed=8)[:, None] + noise(1.0, 2.0)
    found = estimate_fusion(z)
    assert 8.0 < found.momentum < 18.0
    assert found.r == pytest.approx([1.0, 4.0], rel=0.15)
    assert said(found, "keeps its direction")
    assert found.loglik > estimate_fusion(z, momentum=0.0).loglik
    one, alone = estimate_fusion(z[:, :1]), estimate(z[:, 0])
    assert one.momentum == pytest.approx(alone.momentum, rel=1e-5)
    assert one.r[0] == pytest.approx(alone.r, rel=1e-6)
    given = estimate_fusion(z, momentum=30.0)
    assert given.momentum == 30.0
    assert given.loglik < found.loglik
    assert estimate_fusion(walk(400)[:, None] + noise(1.0, 2.0, n=400)).momentum == 0.0


def test_of_a_momentum_as_long_as_the_record_no_end_is_said():
    ramp = np.arange(300.0)[:, None] + noise(1.0, 0.5, n=300)
    found = estimate_fusion(ramp, robust=False)
    assert found.momentum == 299.0
    assert said(found, "for about 299 samples (299 or more)")


@pytest.mark.slow
def test_too_few_readings_for_gains_are_not_known_rather_than_wrong():
    found = estimate_fusion(walk(10)[:, None] * [1.0, 2.0, 0.5] + noise(1.0, 1.0, 1.0, n=10), gains=True)
    for name in ("r_interval", "sensor_gain_interval", "offset_interval", "q_interval"):
        assert not np.isnan(getattr(found, name)).any()


def test_a_known_noise_of_another_unit_is_refused():
    found = estimate_fusion(walk(50)[:, None] + noise(1.0, 1.0, n=50), known_r=[1e40, np.nan])
    assert (found.verdict, found.params) == ("bad_unit", None)
    assert "The given r" in found.message
