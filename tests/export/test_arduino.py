"""The exported sketch and float32 on a board: against numpy's float32, what is written, refused and told before."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from tests.support.effort import FUZZ
from tests.support.textbook import ByHand

from kalscope import BadSetting, ChannelTuning, FilterParams, Tuning, steady_state
from kalscope.export.float32 import filter_float32, float32_params, float32_text
from kalscope.export.job import ExportJob, job_of
from kalscope.export.registry import STALLING_GAIN, export_tuning, limits_of
from kalscope.export.targets.arduino import files
from kalscope.filtering.classic import Butterworth, Chain, OneEuro

F = np.float32


def awkward_samples(seed, n=1500):
    """A walk that keeps its direction, with holes, spikes and a missing first sample."""
    rng = np.random.default_rng(seed)
    z = 100 * rng.normal() + np.cumsum(np.cumsum(rng.normal(size=n) / 20)) + rng.normal(size=n)
    z[rng.random(n) < 0.03] = np.nan
    z[rng.random(n) < 0.03] += 60
    z[0] = np.nan
    return z


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2 * FUZZ))
def test_it_equals_the_filter_in_float32_by_hand_to_the_bit_with_and_without_momentum(seed):
    rng = np.random.default_rng(seed)
    z = awkward_samples(seed, 600)
    q, r, p0, x0 = 10.0 ** rng.uniform(-4, 2, 4)
    kinds = (q, r), (q, r, p0), (q, r, p0, x0), (q, r, p0, None, 9.0), (0.0, r, 0.0, None, 4.0), (q, 0.0, 0.0)
    for tau in (0.0, 1e-3, 0.4, 7.0, 60.0, 1e5):
        for kind in kinds:
            held = float32_params(FilterParams(*kind, momentum=tau))
            other = ByHand(held)
            np.testing.assert_array_equal(filter_float32(z, held), [other.update(one) for one in z])


def test_text_and_float32_are_the_same_bits():
    rng = np.random.default_rng(1)
    bits = rng.integers(0x00800000, 0x7F7FFFFF, 10_000, dtype=np.uint32)
    for value in [*bits.view(F), F(0), F(1), F(-512.25), F(3e38)]:
        text = float32_text(value)
        assert text.endswith("f")
        assert "." in text or "e" in text
        assert F(text[:-1]).view(np.uint32) == value.view(np.uint32)
    assert (float32_text(F(np.inf)), float32_text(F(np.nan))) == ("INFINITY", "NAN")


@pytest.mark.parametrize(
    ("name", "params"),
    [
        *((name, {name: wrong}) for name in ("q", "r", "p0") for wrong in (1e-50, 1.1e-38, 4e38, 1e300)),
        ("q.. of q and momentum", {"q": 1e-30, "momentum": 1e5}),
        ("q22 of q and momentum", {"q": 1e30, "momentum": 1e-10}),
    ],
)
def test_what_float32_cannot_hold_is_refused_by_name(name, params):
    with pytest.raises(BadSetting, match=f"^{name} must fit float32"):
        float32_params(FilterParams(**{"q": 1.0, "r": 1.0} | params))
    with pytest.raises(BadSetting, match="shape"):
        filter_float32([[1.0]], FilterParams(1.0, [1.0, 2.0]))


@pytest.mark.slow
@pytest.mark.parametrize("momentum", [0.0, 2.0, 300.0])
def test_above_the_stalling_gain_float32_settles_within_one_percent(momentum):
    for gain, samples in ((1e-3, 20_000), (1e-5, 1_000_000), (1.1 * STALLING_GAIN, 2_000_000)):
        params = FilterParams(gain * gain / (1 - gain) * 7.0, 7.0, momentum=momentum)
        z = np.zeros(samples + 1, F)
        z[-1] = 1  # resting at 0, the answer to a single 1 is the gain
        assert filter_float32(z, params)[-1] == pytest.approx(steady_state(params).gain, rel=0.01)


@pytest.mark.parametrize("unit", ["", "counts", "ADC Counts", "LSB", "raw", "g", "°C", "mV", "%", "µT"])
def test_a_unit_that_analogread_does_not_return_stops_the_compiler_and_is_named(unit):
    tuning, in_counts = (
        Tuning((ChannelTuning("a", unit, 0.1, 1.0),)),
        unit in ("", "counts", "ADC Counts", "LSB", "raw"),
    )
    sketch = files(job_of(tuning))["kalscope_filter.ino"]
    assert ("#error" not in sketch) == in_counts
    assert sketch.count("return analogRead(PINS[channel]);") == 1
    assert ("you have written readSensor()" not in " ".join(limits_of(tuning, "arduino"))) == in_counts


LIGHT = ChannelTuning("light", "", 1.0, 1.0)


@pytest.mark.parametrize(
    ("job", "message"),
    [
        (ExportJob((replace(LIGHT, q=1e-60),)), r"^light: q must fit float32: 0, or a size from 1.2e-38 to 3.4e38"),
        (ExportJob((replace(LIGHT, q=3e38, r=3e38),)), "must fit float32, up to"),
        (ExportJob(tuple(replace(LIGHT, name=str(i)) for i in range(7))), "1 to 6 channels"),
        (ExportJob((LIGHT,), sample_period=3e3), "sample period"),
    ],
)
def test_what_float_or_a_board_cannot_hold_is_refused(job, message):
    with pytest.raises(BadSetting, match=message):
        files(job)


def test_only_a_sketch_of_channels_can_be_minimal():
    one, pair = Tuning((LIGHT,)), ChannelTuning("both", "", 1.0, (1.0, 2.0), sensors=("light", "b"))
    assert "listen" not in export_tuning(one, "arduino", minimal=True)["kalscope_filter.ino"]
    fused = replace(one, fusion=pair)
    for tuning, target, calibration in ((one, "c", False), (one, "arduino", True), (fused, "arduino", False)):
        with pytest.raises(BadSetting, match="minimal must be for arduino"):
            export_tuning(tuning, target, minimal=True, calibration=calibration)


def device_limits(params, level):
    """The limits of a channel or of fused sensors with these parameters."""
    given = {name: getattr(params, name) for name in ("q", "p0", "x0", "gate", "momentum")}
    return limits_of(Tuning((ChannelTuning("c", "", r=float(params.r), **given),)), "arduino", lambda _: level)


GAIN, ESTIMATE, REFUSED = "float32 cannot settle to a gain", "float32 steps by", "q must fit float32"
"""How each kind begins."""


@pytest.mark.parametrize("momentum", [0.0, 3.0, 100.0])
@pytest.mark.parametrize("ratio", [1e-6, 1e-8, 1e-10, 1e-12, 1e-14])
def test_an_estimate_that_will_stand_still_is_told_and_no_other(ratio, momentum):
    params = FilterParams(16.0 * ratio, 16.0, momentum=momentum)
    told = any(limit.startswith(ESTIMATE) for limit in device_limits(params, level=1023.0))
    start = replace(params, p0=params.r * np.sqrt(params.q / params.r), x0=1023.0)
    assert told == (filter_float32(np.full(3000, 1027.0), start)[-1] == 1023.0)  # no step towards 4 more


@pytest.mark.parametrize(
    ("params", "level", "told"),
    [
        (FilterParams(0.01, 4.0), 1023.0, []),
        (FilterParams(1.0, 0.0), 1023.0, []),
        (FilterParams(1e-14 * 7.0, 7.0), 1e-3, [f"{GAIN} as small as 1e-07"]),
        (FilterParams(0.0, 16.0), 1023.0, [f"{ESTIMATE}.* after 1.3e.05 samples"]),
    ],
)
def test_what_float32_misses_is_told_and_no_more(params, level, told):
    limits = device_limits(params, level)
    assert all(re.match(*pair) for pair in zip(told, limits, strict=True))


def test_a_fusion_is_told_what_the_filter_it_settles_into_cannot_do_at_the_level_and_in_the_unit_of_its_sensors():
    slow = ChannelTuning("level", "", 1e-13, (4.0, 9.0), sensors=("a", "b"))
    for fusion, words in (
        (replace(slow, q=0.01), []),
        (replace(slow, q=1e-60), [REFUSED]),
        (slow, [f"{GAIN} .* Export c, in double"]),
        (replace(slow, q=2.5e-10, gain=(1.0, 0.001)), [f"{ESTIMATE} 6.1e-05 at 1000,"]),
    ):
        limits = limits_of(Tuning((LIGHT,), fusion=fusion), "arduino", lambda _: 1.0)
        assert all(re.match(*pair) for pair in zip(words, limits, strict=True))
    tuning = Tuning((LIGHT,), fusion=replace(slow, unit="cm", q=1e-9, gain=(1.0, 0.5)))
    first, second = limits_of(tuning, "arduino", {"a": 3.0, "b": 600.0}.__getitem__)
    assert "at 1200," in first
    assert second.startswith("the sketch reads counts, but level is in cm")
    assert limits_of(tuning, "c") == []


def test_what_float32_cannot_hold_of_a_chain_is_told():
    steep, tiny = replace(LIGHT, chain=Chain(3, OneEuro(0.01, 1e60, 0.05))), replace(LIGHT, q=1e-60, chain=Chain(5))
    classic = replace(tiny, name="c", chain=Chain(then=Butterworth(0.02)))
    first, second = limits_of(Tuning((steep, replace(tiny, name="b"), classic)), "arduino")
    assert first.startswith("One-euro must compute with numbers that float32 holds")
    assert second.startswith(REFUSED)
