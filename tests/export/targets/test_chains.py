"""Classic filters and chains on every target that runs them: the bits of the core, and a refusal by the others."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from exported_program import FUSED, in_c, in_cpp

from kalscope import BadSetting, ChannelTuning, Recording, Tuning, export_tuning
from kalscope.export.float32 import filter_float32
from kalscope.export.job import ExportJob
from kalscope.export.targets import arduino, c
from kalscope.export.targets.c import numbers_of
from kalscope.filtering.classic import Butterworth, Chain, Exponential, Median, MovingAverage, OneEuro
from kalscope.tuning.toml_text import chain_in

STAGES = (
    MovingAverage(1),
    MovingAverage(9),
    MovingAverage(40),
    Exponential(1.0),
    Exponential(0.013),
    Median(1),
    Median(9),
    Butterworth(1e-4),
    Butterworth(0.02),
    Butterworth(0.49),
    OneEuro(0.004, 0.02, 0.05),
    OneEuro(1e-6, 0.0, 0.3),
    OneEuro(1e8, 1e3, 1e-9),
)
KALMAN = (
    ChannelTuning("plain", "V", 0.01, 4.0),
    ChannelTuning("gated", "V", 0.3, 20.0, 10.0, 480.0, gate=9.0),
    ChannelTuning("moving", "V", 0.01, 4.0, momentum=20.0),
    ChannelTuning("both", "V", 0.2, 9.0, 3.0, gate=12.0, momentum=3.0),
    ChannelTuning("slow", "V", 3e-15, 30.0, 1.2e-6, 0.5),
)
CHANNELS = (
    *KALMAN,
    *(replace(one, name=f"{one.name} behind {n}", chain=Chain(n)) for n in (3, 11) for one in KALMAN),
    *(
        ChannelTuning(f"{stage.name} {i} behind {n}", "V", 0.5, 2.0, 3.0, 7.0, momentum=4.0, chain=Chain(n, stage))
        for n in (1, 5)
        for i, stage in enumerate(STAGES)
    ),
)
"""Every filter, alone and behind a median; beside a classic one values of a Kalman filter that must not matter."""


def signal(dtype=np.float64):
    rng = np.random.default_rng(12)
    z = 500 + np.cumsum(rng.normal(0, 2, 900)) + rng.normal(0, 5, 900)
    z[rng.random(900) < 0.03] += 900.0
    z[400:420] += 400.0
    z[rng.random(900) < 0.04] = np.nan
    z[:3] = z[600:640] = np.nan
    z[700:705] = -0.0
    z[800:] = 12.0
    return z.astype(dtype)


def assert_bits(found, expected, channels=CHANNELS):
    bits = np.uint32 if expected[0].dtype == np.float32 else np.uint64
    wrong = [
        channel.name
        for channel, x, y in zip(channels, found, expected, strict=True)
        if not np.array_equal(x.view(bits)[~np.isnan(y)], y.view(bits)[~np.isnan(y)])
        or not np.array_equal(np.isnan(x), np.isnan(y))
    ]
    assert wrong == []


@pytest.fixture(scope="module")
def in_double():
    return [channel.filter.run(signal()).x for channel in CHANNELS]


@pytest.fixture(scope="module")
def in_float():
    return [filter_float32(signal(np.float32), channel) for channel in CHANNELS]


def test_c_in_double_has_the_bits_of_the_core(tmp_path, in_double):
    assert_bits(in_c(tmp_path, CHANNELS, np.nan_to_num(signal(), nan=np.inf), "-std=c99", "-O1"), in_double)


def test_c_and_cpp_in_float_have_the_bits_of_the_core_in_float32(tmp_path, monkeypatch, in_float):
    monkeypatch.setattr(arduino, "ANALOGUE_PINS", len(CHANNELS))
    z = signal(np.float32)
    assert_bits(in_c(tmp_path, CHANNELS, z, "-std=gnu11", "-O2", *FUSED, "-DKALSCOPE_FLOAT"), in_float)
    assert_bits(in_cpp(tmp_path, CHANNELS, z, "-std=gnu++11", "-O2", *FUSED), in_float)


def test_python_has_the_bits_of_the_core(tmp_path, in_double):
    texts = export_tuning(Tuning(CHANNELS, sample_period=0.01), "python")
    own: dict = {}
    exec(texts["kalscope_filter.py"], own)
    z = np.nan_to_num(signal(), nan=np.inf).tolist()
    found = [np.array([one.update(sample) for sample in z]) for one in own["FILTERS"].values()]
    assert_bits([x + 0.0 for x in found], [x + 0.0 for x in in_double])  # a sort does not know -0 from 0
    assert all(one.x == x[-1] for one, x in zip(own["FILTERS"].values(), found, strict=True))


def test_json_says_the_filter_and_what_it_computes_with():
    (text,) = export_tuning(Tuning(CHANNELS, sample_period=0.01), "json").values()
    document = json.loads(text)
    assert document["format"] == "kalscope-parameters-2"
    for one, channel in zip(document["channels"], CHANNELS, strict=True):
        chain = chain_in(one["chain"]) if "chain" in one else None
        assert chain == channel.chain
        if chain is None or chain.then is None:
            assert one["process_noise_q"] == channel.q
        else:
            assert "process_noise_q" not in one
            numbers = numbers_of(chain.then)
            assert {name: one["chain"][name] for name in numbers} == numbers
    plain = export_tuning(Tuning(KALMAN, sample_period=0.01), "json")["kalscope_parameters.json"]
    assert json.loads(plain)["format"] == "kalscope-parameters-1"


def test_vectors_are_those_of_the_chain():
    channel = ChannelTuning("a", "V", 0.5, 2.0, chain=Chain(5, OneEuro(0.01, 0.02, 0.05)))
    recording = Recording(np.arange(900) * 0.01, ("a",), ("V",), signal()[:, None], 0.01)
    files = export_tuning(Tuning((channel,), sample_period=0.01), "c", vectors=recording)
    rows = [line.split(",") for line in files["groundtruth.csv"].splitlines()[1:]]
    np.testing.assert_array_equal([float(row[2]) for row in rows], channel.filter.run(signal()).x)
    assert all(math.isnan(float(row[3])) for row in rows)


def test_a_growth_that_float_cannot_hold_is_refused_by_name_and_runs_in_double():
    steep = ChannelTuning("steep", "", 1.0, 1.0, chain=Chain(then=OneEuro(0.01, 1e60, 0.05)))
    with pytest.raises(BadSetting, match=r"steep: One-euro must compute with numbers that float32 holds"):
        arduino.files(ExportJob((steep,)))
    assert "float cannot hold the values of steep" in c.files(ExportJob((steep,)))["kalscope_filter.c"]
