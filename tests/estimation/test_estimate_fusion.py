"""`estimate_fusion`: its laws, what several sensors cannot tell, and the noise that they share."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.support.effort import FUZZ
from tests.support.signals import moving

from kalscope import BadSetting, estimate, estimate_fusion, fuse, judge_fusion
from kalscope.errors import Cancelled
from kalscope.estimation.fusion import held_for

pytestmark = pytest.mark.slow

PLAIN = {"momentum": 0.0, "robust": False}
TRUTH = [0.25, 1.0, 2.0], [1.0, -3.0, 2.0]
"""r and offset of the record."""


def record(n=400, seed=3, q=0.1, r=TRUTH[0], offset=TRUTH[1], missing=0.0):
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.normal(0.0, math.sqrt(q), n))
    z = 20.0 + x[:, None] + offset[: len(r)] + rng.normal(0.0, 1.0, (n, len(r))) * np.sqrt(r)
    z[rng.random(z.shape) < missing] = np.nan
    return z


@pytest.mark.parametrize("momentum", ["auto", 0.0, 20.0])
def test_one_sensor_is_estimated_as_estimate_does(momentum):
    z = record(missing=0.3)[:, :1]
    dt = np.random.default_rng(1).choice([1.0, 2.0], len(z))
    found, one = estimate_fusion(z, dt=dt, momentum=momentum), estimate(z[:, 0], dt=dt, momentum=momentum)
    assert (found.q, found.r[0], found.momentum) == pytest.approx((one.q, one.r, one.momentum), rel=1e-6)
    assert found.loglik == pytest.approx(one.loglik, rel=1e-9)


def test_a_reference_is_right_and_without_one_the_offsets_add_up_to_nothing():
    z = record()
    free, named = estimate_fusion(z, **PLAIN), estimate_fusion(z, names=["a", "b", "c"], reference="b", **PLAIN)
    assert free.offset.sum() == pytest.approx(0.0, abs=1e-10)
    assert named.offset[1] == 0.0
    assert named.offset_interval[1] == pytest.approx([0.0, 0.0])
    assert np.diff(free.offset) == pytest.approx(np.diff(named.offset), abs=1e-8)
    assert any("cannot be known" in note for note in free.notes)
    assert not any("cannot be known" in note for note in named.notes)


def test_intervals_hold_the_truth_about_as_often_as_they_say():
    held = np.zeros((2, 3))
    for seed in range(24):
        found = estimate_fusion(record(n=100, seed=100 + seed), **PLAIN)
        for i, ends in enumerate((found.r_interval, found.offset_interval)):
            held[i] += (ends[:, 0] <= TRUTH[i]) & (ends[:, 1] >= TRUTH[i])
    assert np.all(np.abs(held.sum(axis=1) / 72.0 - 0.945) < 0.045)


def test_gains_are_found_where_they_are_asked_for():
    z = 5.0 + (record(n=1500, q=0.5) - 20.0) * [1.0, 2.0, -0.5]
    named = estimate_fusion(z, gains=True, reference=0, **PLAIN)
    assert named.gain == pytest.approx([1.0, 2.0, -0.5], rel=0.03)
    low, high = named.sensor_gain_interval.T
    assert np.all((low <= [1.0, 2.0, -0.5]) & (high >= [1.0, 2.0, -0.5]))
    assert named.r == pytest.approx([0.25, 4.0, 0.5], rel=0.2)
    free = estimate_fusion(z, gains=True, **PLAIN)
    assert np.prod(np.abs(free.gain)) == pytest.approx(1.0)
    assert free.gain / free.gain[0] == pytest.approx(named.gain, rel=1e-6)
    assert free.loglik == pytest.approx(named.loglik, rel=1e-9)


def test_a_pair_of_opposite_signs_keeps_its_offsets_near_its_readings():
    """The plain sum of such offsets hardly depends on the level of x, which would run away."""
    z = record(r=(0.25, 1.0), offset=(0.0, 0.0)) * [1.0, -1.0] + [0.0, 1000.0]
    found = estimate_fusion(z, gains=True, **PLAIN)
    assert found.offset[0] - found.offset[1] == pytest.approx(0.0, abs=1e-9 * 1000.0)
    assert np.abs(found.offset).max() < 1000.0
    assert np.ptp(found.offset_interval, axis=1).max() < 100.0
    assert "sum, each with the sign of its gain, is 0, and the gains so that their sizes" in found.notes[0]


def test_statsmodels_finds_the_same_maximum():
    from statsmodels.tsa.statespace.mlemodel import MLEModel

    z = record(n=300, r=(0.25, 1.0), missing=0.1)

    class Local(MLEModel):
        def __init__(self):
            super().__init__(z, k_states=1, initialization="diffuse")
            self["design"], self["transition"], self["selection"] = np.ones((2, 1)), [[1.0]], [[1.0]]

        @property
        def start_params(self):
            return [*np.log([0.5, 0.5, 0.5]).tolist(), -4.0]

        def update(self, params, **_):
            q, first, second = np.exp(params[:3])
            self["state_cov"], self["obs_cov"] = [[q]], np.diag([first, second])
            self["obs_intercept"] = [[0.0], [params[3]]]

    theirs = np.asarray(Local().fit(disp=False, maxiter=200).params)
    ours = estimate_fusion(z, reference=0, **PLAIN)
    assert np.exp(theirs[:3]) == pytest.approx([ours.q, *ours.r], rel=2e-3)
    assert theirs[3] == pytest.approx(ours.offset[1], abs=1e-3)
    assert ours.loglik == pytest.approx(fuse(z, ours.params).loglik, rel=1e-12)


def test_a_slower_sensor_is_a_sensor_with_gaps():
    z = record(n=1200)
    z[np.arange(len(z)) % 5 != 0, 2] = np.nan
    found = estimate_fusion(z, **PLAIN)
    assert found.r == pytest.approx([0.25, 1.0, 2.0], rel=0.25)
    rows = np.repeat(np.arange(len(z)), 3)  # each reading in a row of its own, at the same time
    apart = np.where(np.arange(3 * len(z))[:, None] % 3 == np.arange(3), z[rows], np.nan)
    dt = np.where(np.arange(3 * len(z)) % 3 == 0, 1.0, 0.0)
    other = estimate_fusion(apart, dt=dt, **PLAIN)
    assert other.loglik == pytest.approx(found.loglik, rel=1e-10)
    assert other.r == pytest.approx(found.r, rel=1e-6)


def test_what_does_not_fit_is_refused():
    z = record(n=20)
    wrong = [("reference", 3), ("reference", "x"), ("known_r", [1.0, 2.0]), ("known_r", [0.0, 1.0, 1.0])]
    wrong += [("known_r", ["4", "x", 1.0]), ("names", ["a", "a", "b"]), ("momentum", -1.0), ("robust", "yes")]
    for name, value in (*wrong, ("dt", np.ones(3))):
        with pytest.raises(BadSetting, match=f"{name} must "):
            estimate_fusion(z, **{name: value})
    with pytest.raises(BadSetting, match="finite"):
        estimate_fusion(np.where(z > 20.0, np.inf, z))
    with pytest.raises(Cancelled):
        estimate_fusion(z, cancelled=lambda: True)


def walk(n=1500, seed=1, q=0.1):
    return np.cumsum(np.random.default_rng(seed).normal(0.0, np.sqrt(q), n))


def noise(*sigma, n=1500, seed=2):
    return np.random.default_rng(seed).normal(0.0, 1.0, (n, len(sigma))) * sigma


def said(found, words):
    return any(words in note for note in found.notes)


def test_r_at_nought_gives_a_filter_with_the_largest_that_the_record_allows():
    x = walk(n=60, q=4.0)
    found = estimate_fusion(np.stack([x, x + noise(1.0, n=60)[:, 0]], 1), **PLAIN)
    assert (found.verdict, found.r[0]) == ("no_noise", 0.0)
    assert found.params.r[0] == found.r_interval[0, 1] > 0.0
    assert "No noise can be identified in sensor 1" in found.message


BOTH = noise(1.0, 1.0, n=50)


@pytest.mark.parametrize(
    ("z", "verdict", "words"),
    [
        (BOTH[:7], "too_few", "at least 8 are needed"),
        (np.where([True, False], BOTH, 4.0), "constant", "sensor 2 are equal"),
        (np.where([True, False], BOTH, np.nan), "too_few", "sensor 2 has too few readings (0)"),
        (walk(50)[:, None] + [0.0, 3.0], "copies", "sensor 1 and sensor 2 always move exactly alike"),
        (BOTH * 1e-170, "bad_unit", "Choose a unit"),
        (BOTH * 1e170, "bad_unit", "Choose a unit"),
    ],
)
def test_where_there_is_nothing_to_fit_the_sensor_is_named(z, verdict, words):
    found = estimate_fusion(z)
    assert (found.verdict, found.params, words in found.message) == (verdict, None, True)
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


def test_a_drifting_offset_is_noticed():
    z = walk()[:, None] + noise(0.5, 0.5, 0.5)
    assert not said(estimate_fusion(z, **PLAIN), "changes slowly")
    z[:, 1] += walk(seed=7, q=0.02)
    assert said(estimate_fusion(z, names=["a", "b", "c"], **PLAIN), "fused value and b changes slowly")


def test_spikes_of_each_sensor_are_set_aside_but_not_what_all_see():
    z = walk()[:, None] + noise(1.0, 2.0)
    rng = np.random.default_rng(5)
    rows = np.sort(rng.choice(np.arange(20, 1480), 15, replace=False))
    z[rows, 0] += 60.0
    found = estimate_fusion(z, momentum=0.0)
    assert set(rows) <= set(found.spikes[0])
    assert len(found.spikes[1]) < 3
    assert found.params.gate == 16.0
    assert found.r == pytest.approx([1.0, 4.0], rel=0.15)
    assert said(found, "set aside")
    assert estimate_fusion(z, **PLAIN).r[0] > 10.0
    away = z.copy()
    for sensor, spikes in enumerate(found.spikes):
        away[spikes, sensor] = np.nan
    assert found.loglik == pytest.approx(fuse(away, replace(found.params, gate=None)).loglik, rel=1e-12)
    both = walk()[:, None] + noise(1.0, 2.0)
    both[rows] += 60.0
    assert not np.intersect1d(estimate_fusion(both, momentum=0.0).spikes[0], rows).size


def test_momentum_is_found_by_the_rule_of_one_signal():
    z = moving(1500, 12.0, 6.0, r=0.0, seed=8)[:, None] + noise(1.0, 2.0)
    progress = []
    found = estimate_fusion(z, progress=lambda done, _: progress.append(done))
    assert progress == sorted(progress)
    assert progress[-1] == 1.0
    assert 8.0 < found.momentum < 18.0
    assert found.r == pytest.approx([1.0, 4.0], rel=0.15)
    assert said(found, "keeps its direction")
    assert found.loglik > estimate_fusion(z, momentum=30.0).loglik > estimate_fusion(z, momentum=0.0).loglik
    assert estimate_fusion(walk(400)[:, None] + noise(1.0, 2.0, n=400)).momentum == 0.0


def test_of_a_momentum_as_long_as_the_record_no_end_is_said_and_a_known_noise_of_another_unit_is_refused():
    ramp = np.arange(300.0)[:, None] + noise(1.0, 0.5, n=300)
    found = estimate_fusion(ramp, robust=False)
    assert (found.momentum, said(found, "for about 299 samples (299 or more)")) == (299.0, True)
    found = estimate_fusion(walk(50)[:, None] + BOTH, known_r=[1e40, np.nan])
    assert (found.verdict, found.params, "The given r" in found.message) == ("bad_unit", None, True)


def sensors(seed, r, *, correlation=0.0, n=500, q=0.01, tau=0.0, missing=0.0):
    """A random walk, or a signal with momentum, read by sensors of which the first two share noise."""
    g = np.random.default_rng(seed)
    x = moving(n, tau, q, r=0.0, seed=seed) if tau else np.cumsum(np.sqrt(q) * g.normal(size=n))
    covariance = np.diag(np.asarray(r, dtype=float))
    covariance[0, 1] = covariance[1, 0] = correlation * np.sqrt(r[0] * r[1])
    z = x[:, None] + g.multivariate_normal(np.arange(len(r)), covariance, size=n)
    z[g.random(z.shape) < missing] = np.nan
    return z


def test_two_sensors_that_share_noise_are_named():
    found = 0
    for seed in range(6 * FUZZ):
        r, q = ([1, 1, 0.5], [1, 4, 1], [1, 1, 0.1], [4, 1, 1, 1])[seed % 4], (1e-3, 0.1, 1.0)[seed % 3]
        shared = estimate_fusion(sensors(seed, r, correlation=0.5, q=q), momentum=0.0, robust=False).shared
        found += shared is not None and shared.sensors == (0, 1) and abs(shared.correlation - 0.5) < 0.2
    assert found >= 0.95 * 6 * FUZZ


def test_independent_sensors_share_nothing():
    false = 0
    for seed in range(8 * FUZZ):
        g = np.random.default_rng(seed)
        r = 10.0 ** g.uniform(-1.5, 1.5, 2 + seed % 3)
        options = ({"q": 0.0}, {"tau": 8.0, "q": 0.1}, {"missing": 0.3}, {"q": 1.0}, {})[seed % 5]
        z = sensors(seed, r, n=int(g.choice([100, 500, 2000])), **options)
        found = estimate_fusion(z, momentum="auto" if "tau" in options else 0.0, robust=False)
        false += found.shared is not None or found.verdict == "shared_noise"
    assert false <= 0.01 * 8 * FUZZ


@pytest.mark.parametrize("r", [[1.0, 1.0, 0.5], [1.0, 1.0, 4.0]])
def test_no_sentence_promises_what_shared_noise_takes_away(r):
    z = sensors(1, r, correlation=0.9)
    found = estimate_fusion(z, momentum=0.0, robust=False)
    assert found.verdict == "shared_noise"
    assert found.message.startswith("sensor 1 and sensor 2 share noise (correlation 0.9")
    for judged in (judge_fusion(z, found), judge_fusion(z, found.params)):
        assert "sensor 1 and sensor 2 share noise (correlation 0.9" in judged.headline
        assert "less than the best" not in " ".join(judged.sentences)
