"""What is told before an export, against what the float32 filter then does."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from kalscope import ChannelTuning, FilterParams, Tuning
from kalscope.export.float32 import filter_float32
from kalscope.export.registry import limits_of
from kalscope.filtering.classic import Butterworth, Chain, OneEuro


def device_limits(params, level):
    """The limits of a channel or of fused sensors with these parameters."""
    given = {name: getattr(params, name) for name in ("q", "p0", "x0", "gate", "momentum")}
    return limits_of(Tuning((ChannelTuning("c", "", r=float(params.r), **given),)), "arduino", lambda _: level)


GAIN, ESTIMATE, REFUSED = "float32 cannot settle to a gain", "float32 steps by", "q must fit float32"
"""How each kind begins."""


def moves_towards_a_step(params, level, step):
    """How far x comes from `level` towards `level + step` in 3,000 samples, as a share of the step."""
    start = replace(params, p0=params.r * np.sqrt(params.q / params.r), x0=level)
    x = filter_float32(np.full(3000, level + step), start)
    return float(x[-1] - np.float32(level)) / step


def test_an_ordinary_filter_runs_on_a_board_as_shown():
    for params in (FilterParams(0.01, 4.0), FilterParams(1.0, 0.0)):
        assert device_limits(params, 1023.0) == []


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


def test_a_fusion_is_told_what_the_filter_it_settles_into_cannot_do():
    slow = ChannelTuning("level", "", 1e-13, (4.0, 9.0), sensors=("a", "b"))
    for fusion, words in (
        (replace(slow, q=0.01), []),
        (replace(slow, q=1e-60), [REFUSED]),
        (slow, [f"{GAIN} .* Export c, in double"]),
        (replace(slow, q=2.5e-10, gain=(1.0, 0.001)), [f"{ESTIMATE} 6.1e-05 at 1000,"]),
    ):
        tuning = Tuning((ChannelTuning("a", "", 1.0, 1.0),), fusion=fusion)
        limits = limits_of(tuning, "arduino", lambda _: 1.0)
        assert all(map(re.match, words, limits))
        assert len(words) == len(limits)


def test_what_float32_cannot_hold_of_a_chain_is_told():
    steep = ChannelTuning("a", "", 0.01, 4.0, chain=Chain(3, OneEuro(0.01, 1e60, 0.05)))
    tiny = ChannelTuning("b", "", 1e-60, 1.0, chain=Chain(5))
    classic = ChannelTuning("c", "", 1e-60, 1.0, chain=Chain(then=Butterworth(0.02)))
    first, second = limits_of(Tuning((steep, tiny, classic)), "arduino")
    assert first.startswith("One-euro must compute with numbers that float32 holds")
    assert second.startswith(REFUSED)


def test_the_notes_of_a_fusion_take_the_level_of_each_sensor_and_its_own_unit():
    fusion = ChannelTuning("level", "cm", 1e-9, (4.0, 9.0), sensors=("a", "b"), gain=(1.0, 0.5))
    tuning = Tuning((ChannelTuning("a", "V", 0.1, 1.0),), fusion=fusion)
    first, second = limits_of(tuning, "arduino", {"a": 3.0, "b": 600.0}.__getitem__)
    assert "at 1200," in first
    assert second.startswith("the sketch reads counts, but level is in cm")
    assert limits_of(tuning, "c") == []
