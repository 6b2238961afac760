"""The exported C and C++, compiled here with every warning an error: the bits of our filter, double and float."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from kalscope import kalman_filter
from kalscope.export import ExportJob, arduino
from kalscope.export.c import files
from kalscope.export.float32 import filter_float32
from kalscope.tuning import ChannelTuning

C_MAIN = r"""
#include <stdio.h>
#include <stdlib.h>
#include "kalscope_filter.h"
int main(void)
{
    kalscope_filter filter;
    kalscope_real z;
    kalscope_start(&filter, &kalscope_tuning_CHANNEL);
    while (fread(&z, sizeof z, 1, stdin) == 1) {
        z = kalscope_update(&filter, z);
        if (fwrite(&z, sizeof z, 1, stdout) != 1) return EXIT_FAILURE;
    }
    return EXIT_SUCCESS;
}
"""
CPP_MAIN = r"""
#include <stdio.h>
#include "KalscopeFilter.h"
int main() {
  KalscopeFilter filter(KALSCOPE_TUNING_CHANNEL);
  float z;
  while (fread(&z, sizeof z, 1, stdin) == 1) {
    z = filter.update(z);
    if (fwrite(&z, sizeof z, 1, stdout) != 1) return 1;
  }
}
"""
CPUINFO = Path("/proc/cpuinfo")
STRICT = ("-Wall", "-Wextra", "-Werror", "-std=c99", "-pedantic", "-O2")
FILTERS = [
    ChannelTuning("plain", "V", 0.01, 4.0),
    ChannelTuning("matlab", "V", 1.0, 100.0, 0.0),
    ChannelTuning("start", "V", 1e-3, 25.0, 1000.0, 480.0),
    ChannelTuning("gated", "V", 0.3, 20.0, 10.0, gate=9.0),
    ChannelTuning("q0", "V", 0.0, 7.0),
    ChannelTuning("r0", "V", 0.2, 0.0, 3.0),
    ChannelTuning("slow", "V", 3e-15, 30.0, 1.2e-6, 0.5),
]


def program(name):
    found = shutil.which(name)
    if found is None:
        (pytest.fail if os.environ.get("KALSCOPE_REQUIRE") == "all" else pytest.skip)(f"{name} is not installed")
    return found


@pytest.fixture(scope="module")
def gcc():
    return program("gcc")


@pytest.fixture(scope="module")
def gxx():
    return program("g++")


@pytest.fixture
def run(gcc, tmp_path):
    """run(channel, z, *flags) -> what the compiled filter answers, in the type of z."""

    def run(channel, z, *flags):
        job = ExportJob((channel,), sample_period=0.005)
        for name, text in files(job).items():
            (tmp_path / name).write_text(text, encoding="ascii")
        (tmp_path / "main.c").write_text(C_MAIN.replace("CHANNEL", job.identifiers[0]))
        command = [gcc, *flags, "main.c", "kalscope_filter.c", "-o", "filter", "-lm"]
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True)
        done = subprocess.run([tmp_path / "filter"], input=z.tobytes(), check=True, capture_output=True)
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


@pytest.mark.parametrize("channel", FILTERS, ids=lambda channel: channel.name)
def test_in_double_the_bits_are_those_of_our_filter(run, channel):
    z = signal(np.float64)
    np.testing.assert_array_equal(run(channel, z, *STRICT), kalman_filter(z, channel.params).x)


@pytest.mark.parametrize("channel", FILTERS, ids=lambda channel: channel.name)
def test_in_float_the_bits_are_those_of_the_float32_filter(run, channel):
    z = signal(np.float32)
    np.testing.assert_array_equal(run(channel, z, *STRICT, "-DKALSCOPE_FLOAT"), filter_float32(z, channel.params))


def test_a_processor_that_could_fuse_a_multiplication_with_an_addition_does_not(run):
    if not CPUINFO.is_file() or " fma " not in CPUINFO.read_text():
        pytest.skip("this processor has no fused multiply-add")
    z = signal(np.float64)
    answer = run(FILTERS[3], z, "-O3", "-mfma", "-std=gnu11")
    np.testing.assert_array_equal(answer, kalman_filter(z, FILTERS[3].params).x)


def test_what_float_cannot_hold_stops_the_compiler_in_float_only(run):
    tiny, z = ChannelTuning("tiny", "", 1e-60, 1e-58), signal(np.float64)
    np.testing.assert_array_equal(run(tiny, z, *STRICT), kalman_filter(z, tiny.params).x)
    with pytest.raises(subprocess.CalledProcessError) as failed:
        run(tiny, z, *STRICT, "-DKALSCOPE_FLOAT")
    assert "float cannot hold the values of tiny" in failed.value.stderr


def test_several_channels_and_a_hostile_name_compile(gcc, tmp_path):
    channels = tuple(
        ChannelTuning(name, name, 0.1, 1.0)
        for name in ("*/ #define x", "int", "a\nb\\", "??/", "ünïcode 😀", "n" * 300, '"', "update", "filter_c_h")
    )
    texts = files(ExportJob(channels, source_name="*/\n#error", tool="\\\n", date="*/"))
    for name, text in texts.items():
        (tmp_path / name).write_text(text, encoding="ascii")
    command = [gcc, *STRICT, "-trigraphs", "-c", "kalscope_filter.c", "-o", "filter.o"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)


@pytest.mark.parametrize("flags", [("-O2",), ("-O3", "-std=gnu++17", "-march=native")], ids=["plain", "native"])
def test_the_class_gives_the_bits_of_the_float32_filter_on_any_processor(gxx, tmp_path, flags):
    z = signal(np.float32)
    for channel in FILTERS:
        job = ExportJob((channel,))
        (tmp_path / "KalscopeFilter.h").write_text(arduino.files(job)["KalscopeFilter.h"], encoding="ascii")
        (tmp_path / "main.cpp").write_text(CPP_MAIN.replace("CHANNEL", job.identifiers[0].upper()))
        command = [gxx, "-std=c++11", "-Wall", "-Wextra", "-Werror", "-pedantic", *flags, "main.cpp", "-o", "main"]
        subprocess.run(command, cwd=tmp_path, check=True)
        done = subprocess.run([tmp_path / "main"], input=z.tobytes(), check=True, capture_output=True)
        answer = np.frombuffer(done.stdout, np.float32)
        np.testing.assert_array_equal(answer, filter_float32(z, channel.params), err_msg=channel.name)
