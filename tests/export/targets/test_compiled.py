"""The exported C and C++, compiled here with every warning an error: the bits of our filter, double and float."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from required import not_here

from kalscope import kalman_filter
from kalscope.export.float32 import filter_float32
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


def assert_bits_of(answer, reference, dtype):
    z = signal(dtype)
    for i, channel in enumerate(FILTERS):
        np.testing.assert_array_equal(answer(i, z), reference(z, channel.params), err_msg=channel.name)


def in_double(z, params):
    return kalman_filter(z, params).x


def test_c_in_double_gives_the_bits_of_our_filter(tmp_path, gcc):
    assert_bits_of(in_c(tmp_path, gcc, FILTERS, *STRICT), in_double, np.float64)


def test_c_in_float_gives_the_bits_of_the_float32_filter(tmp_path, gcc):
    assert_bits_of(in_c(tmp_path, gcc, FILTERS, *STRICT, "-DKALSCOPE_FLOAT"), filter_float32, np.float32)


def test_cpp_gives_the_bits_of_the_float32_filter(tmp_path, gxx):
    flags = ("-Wall", "-Wextra", "-Werror", "-pedantic", "-std=c++11", "-O2")
    assert_bits_of(in_cpp(tmp_path, gxx, FILTERS, *flags), filter_float32, np.float32)


@pytest.mark.skipif(not WITH_FMA, reason="this processor has no fused multiply-add")
def test_a_processor_that_could_fuse_a_multiplication_with_an_addition_does_not(tmp_path, gcc, gxx):
    fused = ("-O3", "-mfma")
    assert_bits_of(in_c(tmp_path, gcc, FILTERS, *fused, "-std=gnu11"), in_double, np.float64)
    assert_bits_of(in_cpp(tmp_path, gxx, FILTERS, *fused, "-std=gnu++17"), filter_float32, np.float32)


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
