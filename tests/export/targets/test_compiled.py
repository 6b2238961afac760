"""The exported C and C++, compiled here with every warning an error: the bits of our filter, double and float."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from required import not_here

from kalscope import kalman_filter
from kalscope.export.board import momentum_on_board
from kalscope.export.float32 import filter_float32, without_momentum
from kalscope.export.job import ExportJob
from kalscope.export.targets import arduino, c
from kalscope.tuning.tuning import ChannelTuning

C_MAIN = r"""
#include <stdio.h>
#include <stdlib.h>
#include "kalscope_filter.h"
int main(int argc, char **argv)
{
    const kalscope_tuning *tunings[] = {TUNINGS};
    kalscope_filter filter;
    kalscope_real z;
    kalscope_start(&filter, tunings[argc > 1 ? atoi(argv[1]) : 0]);
    while (fread(&z, sizeof z, 1, stdin) == 1) {
        z = kalscope_update(&filter, z);
        if (fwrite(&z, sizeof z, 1, stdout) != 1) return EXIT_FAILURE;
    }
    return EXIT_SUCCESS;
}
"""
CPP_MAIN = r"""
#include <stdio.h>
#include <stdlib.h>
#include "KalscopeFilter.h"
int main(int argc, char **argv) {
  const KalscopeTuning tunings[] = {TUNINGS};
  KalscopeFilter filter(tunings[argc > 1 ? atoi(argv[1]) : 0]);
  float z;
  while (fread(&z, sizeof z, 1, stdin) == 1) {
    z = filter.update(z);
    if (fwrite(&z, sizeof z, 1, stdout) != 1) return EXIT_FAILURE;
  }
  return EXIT_SUCCESS;
}
"""
CPUINFO = Path("/proc/cpuinfo")
STRICT = ("-Wall", "-Wextra", "-Werror", "-std=c99", "-pedantic", "-O2")
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
WITH_FMA = CPUINFO.is_file() and " fma " in CPUINFO.read_text()


def program(name):
    found = shutil.which(name)
    if found is None:
        not_here(f"{name} is not installed")
    return found


@pytest.fixture(scope="module")
def gcc():
    return program("gcc")


@pytest.fixture(scope="module")
def gxx():
    return program("g++")


def in_c(folder, compiler, channels, *flags):
    """Compile the exported C of these channels. Returns run(index of a channel, z), which answers in z's type."""
    job = ExportJob(channels, sample_period=0.005)
    tunings = ", ".join(f"&kalscope_tuning_{name}" for name in job.identifiers)
    return _compiled(folder, [compiler, *flags, "main.c", "kalscope_filter.c"], C_MAIN, tunings, c.files(job))


def in_cpp(folder, compiler, channels, *flags):
    """The same for the exported C++ class; z is float32."""
    job = ExportJob(channels, sample_period=0.005)
    tunings = ", ".join(f"KALSCOPE_TUNING_{name.upper()}" for name in job.identifiers)
    return _compiled(folder, [compiler, *flags, "main.cpp"], CPP_MAIN, tunings, arduino.files(job))


def _compiled(folder, command, main, tunings, texts):
    main_file = next(word for word in command if word.startswith("main."))
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="ascii")
    (folder / main_file).write_text(main.replace("TUNINGS", tunings), encoding="ascii")
    subprocess.run([*command, "-o", "filter", "-lm"], cwd=folder, check=True, capture_output=True, text=True)

    def run(channel, z):
        command = [folder / "filter", str(channel)]
        done = subprocess.run(command, input=z.tobytes(), check=True, capture_output=True)
        return np.frombuffer(done.stdout, dtype=z.dtype)

    return run


def signal(dtype):
    rng = np.random.default_rng(12)
    z = 500 + np.cumsum(rng.normal(0, 2, 5000)) + rng.normal(0, 5, 5000)
    z[rng.random(5000) < 0.02] += 900.0
    z[1000:1020] += 400.0  # a step: the gate gives in
    z[rng.random(5000) < 0.02] = np.nan
    z[:3] = np.nan
    return z.astype(dtype)


def assert_bits_of(answer, reference, dtype, channels):
    z = signal(dtype)
    for i, channel in enumerate(channels):
        np.testing.assert_array_equal(answer(i, z), reference(z, channel.params), err_msg=channel.name)


def in_double(z, params):
    return kalman_filter(z, params).x


@EITHER
def test_c_in_double_gives_the_bits_of_our_filter(tmp_path, gcc, channels):
    assert_bits_of(in_c(tmp_path, gcc, channels, *STRICT), in_double, np.float64, channels)


@EITHER
def test_c_in_float_gives_the_bits_of_the_float32_filter(tmp_path, gcc, channels):
    run = in_c(tmp_path, gcc, channels, *STRICT, "-DKALSCOPE_FLOAT")
    assert_bits_of(run, filter_float32, np.float32, channels)


@EITHER
def test_cpp_gives_the_bits_of_the_float32_filter(tmp_path, gxx, channels):
    flags = ("-Wall", "-Wextra", "-Werror", "-pedantic", "-std=c++11", "-O2")
    for part in (channels[:4], channels[4:]):  # the sketch reads at most six channels
        assert_bits_of(in_cpp(tmp_path, gxx, part, *flags), filter_float32, np.float32, part)


@pytest.mark.skipif(not WITH_FMA, reason="this processor has no fused multiply-add")
@EITHER
def test_a_processor_that_could_fuse_a_multiplication_with_an_addition_does_not(tmp_path, gcc, gxx, channels):
    fused = ("-O3", "-mfma")
    assert_bits_of(in_c(tmp_path, gcc, channels, *fused, "-std=gnu11"), in_double, np.float64, channels)
    few = channels[:6]
    assert_bits_of(in_cpp(tmp_path, gxx, few, *fused, "-std=gnu++17"), filter_float32, np.float32, few)


SET_MAIN = r"""
#include <stdio.h>
#include "KalscopeFilter.h"
int main() {
  KalscopeFilter filter(TUNINGS);
  float said[2];
  while (fread(said, sizeof said, 1, stdin) == 1) {
    filter.setMomentum(said[0], said[1]);
    const KalscopeTuning &t = filter.tuning;
    const float held[] = {t.momentum, t.e, t.f, t.q11, t.q12, t.q22, t.w0};
    fwrite(held, sizeof held, 1, stdout);
  }
}
"""


@pytest.mark.parametrize(
    "flags",
    [
        ("-O2",),
        pytest.param(("-O3", "-mfma"), marks=pytest.mark.skipif(not WITH_FMA, reason="no fused multiply-add")),
    ],
)
def test_the_constants_that_a_board_computes_are_those_we_predict(tmp_path, gxx, flags):
    rng = np.random.default_rng(4)
    q = 10.0 ** rng.uniform(-6, 6, 2000)
    tau = np.concatenate([[0.0, 1.0, 2.0, 1e-3, 1e5], 10.0 ** rng.uniform(-3, 5, 1995)])
    files = arduino.files(ExportJob(WITH_MOMENTUM[:1]))
    command = [gxx, "-std=c++11", "-Wall", "-Wextra", "-Werror", "-Wno-unused-result", *flags, "main.cpp"]
    said = np.stack([q, tau], axis=1).astype(np.float32)
    answer = _compiled(tmp_path, command, SET_MAIN, "KALSCOPE_TUNING_PLAIN", files)(0, said.ravel())
    expected = [list(vars(momentum_on_board(*pair) or without_momentum(pair[0])).values()) for pair in said]
    np.testing.assert_array_equal(answer.reshape(-1, 7), np.array(expected, dtype=np.float32))


def test_what_float_cannot_hold_stops_the_c_compiler_in_float_only(tmp_path, gcc):
    tiny, z = ChannelTuning("tiny", "", 1e-60, 1e-58), signal(np.float64)
    np.testing.assert_array_equal(in_c(tmp_path, gcc, (tiny,), *STRICT)(0, z), kalman_filter(z, tiny.params).x)
    with pytest.raises(subprocess.CalledProcessError) as failed:
        in_c(tmp_path, gcc, (tiny,), *STRICT, "-DKALSCOPE_FLOAT")
    assert "float cannot hold the values of tiny" in failed.value.stderr


def test_several_channels_and_hostile_names_compile(gcc, tmp_path):
    names = ("*/ #define x", "int", "a\nb\\", "??/", "ünïcode 😀", "n" * 300, '"', "update", "start", "filter_c_h")
    channels = tuple(ChannelTuning(name, name, 0.1, 1.0) for name in names)
    texts = c.files(ExportJob(channels, source_name="*/\n#error", tool="\\\n", date="*/"))
    for name, text in texts.items():
        (tmp_path / name).write_text(text, encoding="ascii")
    command = [gcc, *STRICT, "-trigraphs", "-c", "kalscope_filter.c", "-o", "filter.o"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
