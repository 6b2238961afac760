"""Kalman filters, classic filters and chains, compiled here with every warning an error: the bits of the core."""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from tests.support.exported_program import FUSED, build, in_c, in_cpp

from kalscope import BadSetting, ChannelTuning, Tuning, export_tuning
from kalscope.export.board import momentum_on_board
from kalscope.export.float32 import filter_float32, without_momentum
from kalscope.export.job import ExportJob
from kalscope.export.targets import arduino
from kalscope.export.targets.c import numbers_of
from kalscope.filtering.classic import Butterworth, Chain, Exponential, Median, MovingAverage, Notch, OneEuro
from kalscope.filtering.kernels import transition
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
    *(replace(one, name=f"{one.name} behind a notch", chain=Chain(notch=Notch(0.2, 0.05))) for one in KALMAN[:3]),
    ChannelTuning("all three", "V", 0.5, 2.0, chain=Chain(5, Exponential(0.1), Notch(0.05, 0.01))),
)
"""Every filter, alone and behind a median or a notch; the values of Kalman beside a classic one must not matter."""


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


FILTERS = (
    ChannelTuning("plain", "V", 0.01, 4.0),
    ChannelTuning("start", "V", 1e-3, 25.0, 1000.0, 480.0),
    ChannelTuning("gated", "V", 0.3, 20.0, 10.0, gate=9.0),
    ChannelTuning("q0", "V", 0.0, 7.0, 0.5),
    ChannelTuning("r0", "V", 0.2, 0.0, 3.0),
    ChannelTuning("slow", "V", 3e-15, 30.0, 1.2e-6, 0.5),
)
MOMENTA = (20.0, 0.01, 1e5, 3.0, 50.0, 7.0)
WITH_MOMENTUM = (
    *(replace(one, momentum=momentum) for one, momentum in zip(FILTERS, MOMENTA, strict=True)),
    *FILTERS[:3:2],  # two without among them
)
SETS = {"five lines": FILTERS, "momentum": WITH_MOMENTUM, "chains": CHANNELS}
EACH = pytest.mark.parametrize("channels", SETS.values(), ids=SETS)


def in_double(channels):
    return [channel.filter.run(signal()).x for channel in channels]


def in_float(channels):
    return [filter_float32(signal(np.float32), channel) for channel in channels]


@EACH
def test_c_has_the_bits_of_the_core_in_double_and_in_float(tmp_path, channels):
    z, fused = np.nan_to_num(signal(), nan=np.inf), ("-std=gnu11", "-O2", *FUSED)
    for flags in (("-std=c99", "-O1"), fused):
        assert_bits(in_c(tmp_path, channels, z, *flags), in_double(channels), channels)
    small = in_c(tmp_path, channels, signal(np.float32), *fused, "-DKALSCOPE_FLOAT")
    assert_bits(small, in_float(channels), channels)


@EACH
def test_cpp_has_the_bits_of_the_core_in_float32(tmp_path, monkeypatch, channels):
    monkeypatch.setattr(arduino, "ANALOGUE_PINS", len(channels))
    for flags in (("-std=c++11", "-O1"), ("-std=gnu++17", "-O2", *FUSED)):
        assert_bits(in_cpp(tmp_path, channels, signal(np.float32), *flags), in_float(channels), channels)


def test_python_has_the_bits_of_the_core():
    texts = export_tuning(Tuning(CHANNELS, sample_period=0.01), "python")
    own: dict = {}
    exec(texts["kalscope_filter.py"], own)
    z = np.nan_to_num(signal(), nan=np.inf).tolist()
    found = [np.array([one.update(sample) for sample in z]) for one in own["FILTERS"].values()]
    assert_bits([x + 0.0 for x in found], [x + 0.0 for x in in_double(CHANNELS)])  # a sort does not know -0 from 0
    assert all(one.x == x[-1] for one, x in zip(own["FILTERS"].values(), found, strict=True))


def test_json_says_the_filter_and_what_it_computes_with():
    (text,) = export_tuning(Tuning(CHANNELS, sample_period=0.01), "json").values()
    document = json.loads(text)
    assert document["format"] == "kalscope-parameters-2"
    for one, channel in zip(document["channels"], CHANNELS, strict=True):
        chain = chain_in(one["chain"]) if "chain" in one else None
        assert chain == channel.chain
        last = None if chain is None else chain.then
        assert one.get("process_noise_q") == (channel.q if last is None else None)
        assert last is None or numbers_of(last).items() <= one["chain"].items()
    plain = export_tuning(Tuning(KALMAN, sample_period=0.01), "json")["kalscope_parameters.json"]
    assert json.loads(plain)["format"] == "kalscope-parameters-1"


SET_MAIN = r"""
#include <stdio.h>
#include "KalscopeFilter.h"
int main() {
  KalscopeFilter filter(KALSCOPE_TUNING_PLAIN);
  float said[2];
  while (fread(said, sizeof said, 1, stdin) == 1) {
    filter.setMomentum(said[0], said[1]);
    const KalscopeTuning &t = filter.tuning;
    const float held[] = {t.momentum, t.e, t.f, t.q11, t.q12, t.q22, t.w0};
    fwrite(held, sizeof held, 1, stdout);
  }
}
"""


@pytest.mark.parametrize("flags", [("-O2",), ("-O3", *FUSED)])
def test_the_constants_that_a_board_computes_are_those_we_predict(tmp_path, flags):
    rng = np.random.default_rng(4)
    q = 10.0 ** rng.uniform(-6, 6, 2000)
    tau = np.concatenate([[0.0, 1.0, 2.0, 1e-3, 1e5], 10.0 ** rng.uniform(-3, 5, 1995)])
    said = np.stack([q, tau], axis=1).astype(np.float32)
    texts = {"KalscopeFilter.h": arduino.files(ExportJob(WITH_MOMENTUM[:1]))["KalscopeFilter.h"]}
    run = build(tmp_path, "g++", texts, SET_MAIN, "-std=c++11", "-Wno-unused-result", *flags)
    answer = np.frombuffer(run(said.tobytes()), np.float32).reshape(-1, 7)
    expected = [list(vars(momentum_on_board(*pair) or without_momentum(pair[0])).values()) for pair in said]
    np.testing.assert_array_equal(answer, np.array(expected, dtype=np.float32))
    lasts = said[:, 1] > 0.0
    exact = np.array([transition(1.0, *pair) for pair in said[lasts].astype(float)])
    np.testing.assert_allclose(answer[lasts, 1], exact[:, 0], rtol=0.0, atol=2e-7)
    np.testing.assert_allclose(answer[lasts, 2:6], exact[:, 1:], rtol=1e-6)


def test_what_float_cannot_hold_runs_in_double_and_is_refused_by_name_in_float(tmp_path):
    steep = ChannelTuning("steep", "", 1.0, 1.0, chain=Chain(then=OneEuro(0.01, 1e60, 0.05)))
    for one in (ChannelTuning("tiny", "", 1e-60, 1e-58), steep):
        np.testing.assert_array_equal(in_c(tmp_path, (one,), signal(), "-std=c99"), in_double([one]))
        with pytest.raises(subprocess.CalledProcessError) as failed:
            in_c(tmp_path, (one,), signal(), "-std=c99", "-DKALSCOPE_FLOAT")
        assert f"float cannot hold the values of {one.name}" in failed.value.stderr
        with pytest.raises(BadSetting, match=f"{one.name}: .* float32"):
            arduino.files(ExportJob((one,)))
