"""What is told before an export, against what the float32 filter then does."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from kalscope import ChannelTuning, FilterParams, Tuning
from kalscope.errors import BadSetting
from kalscope.export.float32 import filter_float32
from kalscope.export.limits import READ_US, UPDATE_US, tuning_limits, update_us
from kalscope.export.registry import limits_of
from kalscope.filtering.classic import Butterworth, Chain, OneEuro


def device_limits(params, level, sample_period=None, channels=1):
    """The limits of so many equal channels."""
    given = {name: getattr(params, name) for name in ("q", "r", "p0", "x0", "gate", "momentum")}
    filters = [ChannelTuning(f"c{i}", "", **given) for i in range(channels)]
    return tuning_limits(filters, levels=[level] * channels, sample_period=sample_period)


GAIN, ESTIMATE, TIME = "float32 cannot settle to a gain", "float32 steps by", "an Uno needs"
REFUSED = "q must fit float32"
"""How each kind begins."""


def moves_towards_a_step(params, level, step):
    """How far x comes from `level` towards `level + step` in 3,000 samples, as a share of the step."""
    start = replace(params, p0=params.r * np.sqrt(params.q / params.r), x0=level)
    x = filter_float32(np.full(3000, level + step), start)
    return float(x[-1] - np.float32(level)) / step


def test_an_ordinary_filter_runs_on_a_board_as_shown():
    for params, period in (
        (FilterParams(0.01, 4.0), None),
        (FilterParams(0.01, 4.0), 0.005),
        (FilterParams(1.0, 0.0), None),
    ):
        assert device_limits(params, 1023.0, period) == []


def test_a_gain_that_float32_misses_is_told_with_the_constant_gain():
    (limit, *_) = device_limits(FilterParams(1e-14 * 7.0, 7.0), level=1e-3)
    assert limit.startswith(f"{GAIN} as small as 1e-07")


@pytest.mark.parametrize("momentum", [0.0, 3.0, 100.0])
@pytest.mark.parametrize("ratio", [1e-6, 1e-8, 1e-10, 1e-12, 1e-14])
def test_an_estimate_that_will_stand_still_is_told_and_no_other(ratio, momentum):
    params = FilterParams(16.0 * ratio, 16.0, momentum=momentum)
    told = any(limit.startswith(ESTIMATE) for limit in device_limits(params, level=1023.0))
    stands_still = moves_towards_a_step(params, 1023.0, 4.0) == 0.0
    assert told == stands_still


def test_without_process_noise_the_filter_stands_still_one_day():
    (limit,) = device_limits(FilterParams(0.0, 16.0), level=1023.0)
    assert limit.startswith(ESTIMATE)
    assert "after 1.3e+05 samples" in limit


def test_what_float32_cannot_hold_is_told_by_name():
    (limit,) = device_limits(FilterParams(1e-60, 1.0), level=1.0)
    assert limit.startswith(REFUSED)


def test_too_many_channels_for_the_time_of_an_uno_are_told():
    for momentum, cost in zip((0.0, 20.0), UPDATE_US, strict=True):
        params = FilterParams(0.01, 4.0, momentum=momentum)
        per_channel = (READ_US + cost) * 1e-6
        assert device_limits(params, level=1023.0, sample_period=3.01 * per_channel, channels=3) == []
        (limit,) = device_limits(params, level=1023.0, sample_period=2.99 * per_channel, channels=3)
        assert limit.startswith(TIME)


def test_what_is_no_period_or_level_is_refused():
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(BadSetting):
            device_limits(FilterParams(1.0, 1.0), level=wrong)
        with pytest.raises(BadSetting):
            device_limits(FilterParams(1.0, 1.0), level=1.0, sample_period=wrong)


def test_the_limits_of_a_fusion_are_those_of_the_filter_it_settles_into_and_its_time_that_of_its_sensors():
    fusion = ChannelTuning("level", "", 0.01, (4.0, 9.0), sensors=("a", "b"))
    assert tuning_limits((fusion,), levels=(1023.0, 1023.0)) == []
    (limit,) = tuning_limits((replace(fusion, q=1e-60),), levels=(1.0, 1.0))
    assert limit.startswith(REFUSED)
    slow = replace(fusion, q=1e-13)
    (limit,) = tuning_limits((slow,), levels=(1.0, 1.0))
    assert limit.startswith(GAIN)
    assert "A fusion has no constant gain to continue with: export c" in limit
    gained = replace(slow, q=2.5e-10, gain=(1.0, 0.001))
    (limit,) = tuning_limits((gained,), levels=(1.0, 1.0))
    assert limit.startswith(f"{ESTIMATE} 6.1e-05 at 1000,")
    costs = ((fusion, 2 * 113), (replace(fusion, gain=(1.0, 2.0)), 2 * 142), (replace(fusion, momentum=9.0), 522))
    for one, us in costs:
        needed = 1e-6 * (us + 2 * READ_US)
        assert tuning_limits((one,), levels=(1023.0, 1023.0), sample_period=1.001 * needed) == []
        (limit,) = tuning_limits((one,), levels=(1023.0, 1023.0), sample_period=0.999 * needed)
        assert re.match(f"{TIME} .* to read and fuse 2 sensors", limit)


def test_chains_are_told_their_own_time_and_what_float32_cannot_hold_of_them():
    kalman, steep = ChannelTuning("a", "", 0.01, 4.0, chain=Chain(5)), OneEuro(0.01, 1e60, 0.05)
    channels = (kalman, ChannelTuning("b", "", 1e-60, 1.0, chain=Chain(then=Butterworth(0.02))))
    needed = 1e-6 * (sum(update_us(one) for one in channels) + 2 * READ_US)
    assert update_us(kalman) > UPDATE_US[0] + 40
    assert update_us(kalman, (replace(kalman, momentum=9.0),)) > UPDATE_US[1]
    assert tuning_limits(channels, levels=(1023.0, 1023.0), sample_period=1.001 * needed) == []
    (limit,) = tuning_limits(channels, levels=(1023.0, 1023.0), sample_period=0.999 * needed)
    assert limit.endswith("Take fewer samples, and export for that period.")
    (limit,) = tuning_limits((replace(kalman, chain=Chain(3, steep)),), levels=(1023.0,))
    assert limit.startswith("One-euro must compute with numbers that float32 holds")
    (limit,) = tuning_limits((replace(kalman, q=1e-60),), levels=(1.0,))
    assert limit.startswith(REFUSED)


def test_the_notes_of_a_fusion_take_the_level_of_each_sensor_and_its_own_unit():
    fusion = ChannelTuning("level", "cm", 1e-9, (4.0, 9.0), sensors=("a", "b"), gain=(1.0, 0.5))
    tuning = Tuning((ChannelTuning("a", "V", 0.1, 1.0),), fusion=fusion)
    first, second = limits_of(tuning, None, "arduino", {"a": 3.0, "b": 600.0}.__getitem__)
    assert "at 1200," in first
    assert second.startswith("the sketch reads counts, but level is in cm")
    assert limits_of(tuning, "a", "arduino") == limits_of(replace(tuning, fusion=None), None, "arduino")
    assert limits_of(tuning, None, "c") == []
