"""Kalman filters, classic filters and chains, compiled here with every warning an error: the bits of the core."""

from __future__ import annotations

import subprocess
from dataclasses import replace

import numpy as np
import pytest
from tests.support.exported_program import FUSED, build, in_c, in_cpp, spiky

from kalscope import BadSetting, ChannelTuning, Tuning, export_tuning
from kalscope.export.board import momentum_on_board
from kalscope.export.float32 import filter_float32, without_momentum
from kalscope.export.job import ExportJob
from kalscope.export.targets import arduino
from kalscope.filtering.classic import Butterworth, Chain, Exponential, Median, MovingAverage, Notch, OneEuro
from kalscope.filtering.kernels import transition

STAGES = [*map(MovingAverage, (1, 9, 40)), *map(Exponential, (1.0, 0.013)), *map(Median, (1, 9))]
STAGES += [*map(Butterworth, (1e-4, 0.02, 0.49)), OneEuro(0.004, 0.02, 0.05), OneEuro(1e-6, 0.0, 0.3)]
STAGES += [OneEuro(1e8, 1e3, 1e-9)]
KALMAN = (
    ChannelTuning("plain", "V", 0.01, 4.0),
    ChannelTuning("gated", "V", 0.3, 20.0, 10.0, 480.0, gate=9.0),
    ChannelTuning("moving", "V", 0.01, 4.0, momentum=20.0),
    ChannelTuning("both", "V", 0.2, 9.0, 3.0, gate=12.0, momentum=3.0),
    ChannelTuning("slow", "V", 3e-15, 30.0, 1.2e-6, 0.5),
    ChannelTuning("q0", "V", 0.0, 7.0, 0.5, momentum=3.0),
    ChannelTuning("r0", "V", 0.2, 0.0, 3.0, momentum=0.01),
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


DOUBLES = spiky(1500)
DOUBLES[1100:1140], DOUBLES[1200:1205], DOUBLES[1300:] = np.nan, -0.0, 12.0
FLOATS = DOUBLES.astype(np.float32)


def assert_bits(found, channels=CHANNELS):
    """Answers of an exported program, shape (channels, n), are those of the core in their type; −0 is not 0."""
    for channel, x in zip(channels, found, strict=True):
        y = filter_float32(FLOATS, channel) if x.dtype == np.float32 else channel.filter.run(DOUBLES).x
        np.testing.assert_array_equal(x, y, err_msg=channel.name)
        np.testing.assert_array_equal(np.signbit(x[x == 0]), np.signbit(y[x == 0]), err_msg=channel.name)


def test_c_has_the_bits_of_the_core_in_double_and_in_float(tmp_path):
    z, fused = np.nan_to_num(DOUBLES, nan=np.inf), ("-std=gnu11", "-O2", *FUSED)
    for flags in (("-std=c99", "-O1"), fused):
        assert_bits(in_c(tmp_path, CHANNELS, z, *flags))
    assert_bits(in_c(tmp_path, CHANNELS, FLOATS, *fused, "-DKALSCOPE_FLOAT"))


def test_cpp_has_the_bits_of_the_core_in_float32(tmp_path, monkeypatch):
    monkeypatch.setattr(arduino, "ANALOGUE_PINS", len(CHANNELS))
    for flags in (("-std=c++11", "-O1"), ("-std=gnu++17", "-O2", *FUSED)):
        assert_bits(in_cpp(tmp_path, CHANNELS, FLOATS, *flags))


def test_python_has_the_bits_of_the_core():
    own: dict = {}
    exec(export_tuning(Tuning(CHANNELS, sample_period=0.01), "python")["kalscope_filter.py"], own)
    z = np.nan_to_num(DOUBLES, nan=np.inf).tolist()
    for channel, one in zip(CHANNELS, own["FILTERS"].values(), strict=True):
        x = [one.update(sample) for sample in z]
        np.testing.assert_array_equal(x, channel.filter.run(DOUBLES).x)  # a sort does not know -0 from 0
        assert one.x == x[-1]


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
    texts = {"KalscopeFilter.h": arduino.files(ExportJob((replace(KALMAN[0], momentum=20.0),)))["KalscopeFilter.h"]}
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
        np.testing.assert_array_equal(in_c(tmp_path, (one,), DOUBLES, "-std=c99")[0], one.filter.run(DOUBLES).x)
        with pytest.raises(subprocess.CalledProcessError) as failed:
            in_c(tmp_path, (one,), DOUBLES, "-std=c99", "-DKALSCOPE_FLOAT")
        assert f"float cannot hold the values of {one.name}" in failed.value.stderr
        with pytest.raises(BadSetting, match=f"{one.name}: .* float32"):
            arduino.files(ExportJob((one,)))
