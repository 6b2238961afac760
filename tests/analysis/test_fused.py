"""What is said of fused sensors: nothing of good ones, and the fault of each bad one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kalscope import BadSetting, FilterParams, estimate_fusion, fuse, judge_fusion, steady_state

pytestmark = pytest.mark.slow

R = np.array([0.25, 1.0, 4.0])
PARAMS = FilterParams(0.01, R)


def recorded(seed=1, sensors=3, n=3000):
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.normal(0.0, 0.1, n))
    return x[:, None] + rng.normal(size=(n, sensors)) * np.sqrt(R[:sensors])


def judged(z, **options):
    sensors = z.shape[1]
    options.setdefault("names", ["a", "b", "c"][:sensors])
    return judge_fusion(z, options.pop("params", PARAMS.only(range(sensors))), **options)


def in_turns(z):
    turns = np.arange(len(z))[:, None] % z.shape[1] == np.arange(z.shape[1])
    return np.where(turns, z, np.nan)


@pytest.mark.parametrize("sensors", [1, 2, 3])
def test_nothing_is_wrong_with_sensors_as_the_model_has_them(sensors):
    for seed in range(6):
        z = recorded(seed, sensors, n=1000)
        for one in (z, in_turns(z)):
            assert [sensor.faults for sensor in judged(one).sensors] == [()] * sensors


def test_the_errors_are_those_of_the_settled_filters():
    found = judged(recorded(), unit="°C")
    assert found.error == pytest.approx(math.sqrt(steady_state(PARAMS.as_single).p), rel=1e-6)
    for i, one in enumerate(found.sensors):
        others = [j for j in range(3) if j != i]
        assert one.error == pytest.approx(math.sqrt(steady_state(PARAMS.only([i]).as_single).p), rel=1e-3)
        without = math.sqrt(steady_state(PARAMS.only(others).as_single).p)
        assert one.error_without == pytest.approx(without, rel=1e-3)
        assert one.shares_without.sum() == pytest.approx(1.0)
    assert found.best == 0
    assert found.headline == (
        "The fused value has an error of 0.197 °C (1 σ, predicted), "
        "7.2 % less than the best single sensor, a (0.213 °C)."
    )
    assert found.sensors[0].if_it_fails == (
        "If a drops out, the error is 0.291 °C, 47 % more than with it; the fused value is then 80 % b and 20 % c.",
        "If a sticks at one value, the fused value goes 76 % of the way to it; leave it out then.",
    )


@pytest.mark.parametrize("gate", [None, 9.0])
def test_the_pull_of_a_stuck_sensor_is_where_the_fused_value_ends(gate):
    z = 0.1 * recorded(5)
    z -= z.mean(axis=1, keepdims=True)
    z[500:, 0] = 70.0
    params = FilterParams(0.01, R, gate=gate)
    end = fuse(z, params).x[1500:].mean() / 70.0
    assert judged(z, params=params).sensors[0].share == pytest.approx(end, abs=0.03)


def drifting(z):
    z[:, 1] += np.linspace(0.0, 2.0, len(z))


def sticking(z):
    z[1000:1300, 0] = 4.5


def ending(z):
    z[2000:, 2] = np.nan


def spiking(z):
    z[50::150, 1] += 40.0


def louder(z):
    z[1500:, 0] += np.random.default_rng(9).normal(0.0, 3.0, 1500)


FAULTS = [
    (drifting, "b", "drift", "b drifts against the others by 1.88 °C within the record (σ of its noise: 1.00 °C)."),
    (sticking, "a", "stuck", "a is stuck at 4.50 °C for 30 s (rows 1\u202f000 to 1\u202f299): leave it out there."),
    (ending, "c", "silent", "c has no reading for 1.67 min (rows 2\u202f000 to 2\u202f999)."),
    (spiking, "b", "spikes", "b has 20 spikes that no other sensor confirms: set an outlier gate."),
    (louder, "a", "noise", "The noise variance of a changes 14 × within the record: one r cannot fit all of it."),
]


@pytest.mark.parametrize(("spoil", "name", "fault", "sentence"), FAULTS)
def test_the_sensor_that_is_at_fault_is_named(spoil, name, fault, sentence):
    z = recorded()
    spoil(z)
    found = judged(z, unit="°C", sample_period=0.1)
    assert sentence in found.sentences
    assert ("The sensors drift apart by up to 1.88 °C" in found.headline) == (fault == "drift")
    assert fault in {one.name: one for one in found.sensors}[name].faults
    assert all(one.faults == () for one in found.sensors if one.name != name)


def test_a_drift_shows_between_sensors_in_turns_but_of_two_not_which_of_them_drifts():
    z = recorded()
    drifting(z)
    assert [one.faults for one in judged(in_turns(z)).sensors] == [(), ("drift",), ()]
    found = judged(z[:, :2])
    assert [one.faults for one in found.sensors] == [("drift",), ("drift",)]
    assert sum("a and b drift apart by" in sentence for sentence in found.sentences) == 1


def test_no_sensor_alone_is_better_than_all_however_late_it_begins():
    z = recorded(sensors=2)
    z[:1500, 0] = z[1500:, 1] = math.nan  # a alone would be judged by its own, good rows
    found = judged(z)
    assert found.error <= min(min(one.error, one.error_without) for one in found.sensors)
    assert "the same as the best single sensor, a (0.213)." in found.headline
    assert not any(one.drift for one in found.sensors)  # what b would have read later is not known


def test_few_rows_and_none_and_what_is_refused():
    assert judged(recorded(n=20)).prediction is None
    found = judged(np.empty((0, 2)))
    assert (found.error, [one.answered for one in found.sensors]) == (math.inf, [0.0, 0.0])
    assert "No sensor has a reading" in found.headline
    with pytest.raises(BadSetting, match="names must be 3"):
        judged(recorded(), names=["a"])
    with pytest.raises(BadSetting, match="column for each"):
        judge_fusion(np.zeros((5, 2)), PARAMS)
    with pytest.raises(BadSetting, match="without params"):
        judge_fusion(np.ones((50, 2)), estimate_fusion(np.ones((50, 2))))


def test_a_sensor_of_coarse_steps_is_stuck_only_where_the_others_move():
    x = np.append(np.linspace(0.0, 40.0, 2000), np.full(2000, 40.2))
    z = x[:, None] + np.random.default_rng(3).normal(0.0, 0.5, (4000, 3))
    z[:, 0] = np.round(x)
    params = FilterParams(1e-3, np.array([1.0 / 12.0, 0.25, 0.25]))
    assert judged(z, params=params).sensors[0].stuck == (0, 0)
    z[500:1900, 0] = z[500, 0]
    z[1900:, 0] += np.arange(2100) % 30 // 15
    assert judged(z, params=params).sensors[0].stuck == (475, 1900)
