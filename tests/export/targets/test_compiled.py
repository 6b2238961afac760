"""The exported C and C++, compiled here with every warning an error: the bits of our filter, double and float."""

from __future__ import annotations

import subprocess
from dataclasses import replace

import numpy as np
import pytest
from exported_program import FUSED, build, in_c, in_cpp, spiky

from kalscope import kalman_filter
from kalscope.export.board import momentum_on_board
from kalscope.export.float32 import filter_float32, without_momentum
from kalscope.export.job import ExportJob
from kalscope.export.targets import arduino, c
from kalscope.filtering.kernels import transition
from kalscope.tuning.tuning import ChannelTuning

FILTERS = (
    ChannelTuning("plain", "V", 0.01, 4.0),
    ChannelTuning("start", "V", 1e-3, 25.0, 1000.0, 480.0),
    ChannelTuning("gated", "V", 0.3, 20.0, 10.0, gate=9.0),
    ChannelTuning("q0", "V", 0.0, 7.0, 0.5),
    ChannelTuning("r0", "V", 0.2, 0.0, 3.0),
    ChannelTuning("slow", "V", 3e-15, 30.0, 1.2e-6, 0.5),
)
WITH_MOMENTUM = (
    *(
        replace(channel, momentum=momentum)
        for channel, momentum in zip(FILTERS, (20.0, 0.01, 1e5, 3.0, 50.0, 7.0), strict=True)
    ),
    FILTERS[0],
    FILTERS[2],
)
"""Each filter with a momentum, and two without among them."""
EITHER = pytest.mark.parametrize("channels", [FILTERS, WITH_MOMENTUM], ids=["five lines", "momentum"])


@EITHER
def test_c_gives_the_bits_of_our_filter_in_double_and_in_float(tmp_path, channels):
    for flags in (("-std=c99", "-O2"), ("-std=gnu11", "-O3", *FUSED)):
        for one, x in zip(channels, in_c(tmp_path, channels, spiky(5000), *flags), strict=True):
            np.testing.assert_array_equal(x, kalman_filter(spiky(5000), one.params).x, err_msg=one.name)
    z = spiky(5000, np.float32)
    for one, x in zip(channels, in_c(tmp_path, channels, z, "-std=c99", "-O2", "-DKALSCOPE_FLOAT"), strict=True):
        np.testing.assert_array_equal(x, filter_float32(z, one.params), err_msg=one.name)


@EITHER
def test_cpp_gives_the_bits_of_the_float32_filter(tmp_path, channels):
    z = spiky(5000, np.float32)
    for part in (channels[:4], channels[4:]):  # the sketch reads at most six channels
        for flags in (("-std=c++11", "-O2"), ("-std=gnu++17", "-O3", *FUSED)):
            for one, x in zip(part, in_cpp(tmp_path, part, z, *flags), strict=True):
                np.testing.assert_array_equal(x, filter_float32(z, one.params), err_msg=one.name)


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


def test_what_float_cannot_hold_stops_the_c_compiler_in_float_only(tmp_path):
    tiny, z = ChannelTuning("tiny", "", 1e-60, 1e-58), spiky(5000)
    np.testing.assert_array_equal(in_c(tmp_path, (tiny,), z, "-std=c99")[0], kalman_filter(z, tiny.params).x)
    with pytest.raises(subprocess.CalledProcessError) as failed:
        in_c(tmp_path, (tiny,), z, "-std=c99", "-DKALSCOPE_FLOAT")
    assert "float cannot hold the values of tiny" in failed.value.stderr


def test_several_channels_and_hostile_names_compile(tmp_path):
    names = ("*/ #define x", "int", "a\nb\\", "??/", "ünïcode 😀", "n" * 300, '"', "update", "start", "filter_c_h")
    channels = tuple(ChannelTuning(name, name, 0.1, 1.0) for name in names)
    texts = c.files(ExportJob(channels, source_name="*/\n#error", tool="\\\n", date="*/"))
    build(tmp_path, "gcc", texts, "int main(void) { return 0; }", "-std=c99", "-trigraphs")
