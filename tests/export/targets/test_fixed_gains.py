"""The settled filter as C and C++: the bits of its recursion, and the whole filter's values once it has settled."""

from __future__ import annotations

import shutil
import subprocess
from itertools import product

import numpy as np
import pytest
from required import not_here

from kalscope import BadSetting, ChannelTuning, Recording, Tuning, export_tuning, kalman_filter, steady_state
from kalscope.export.job import ExportJob
from kalscope.export.targets.c import fixed_gains

MAIN = """
#include <stdio.h>
#include "kalscope_fixed_gains.h"
int main(void)
{
    kalscope_fixed filters[] = {FILTERS};
    kalscope_fixed_real z, x;
    while (fread(&z, sizeof z, 1, stdin) == 1)
        for (size_t i = 0; i < sizeof filters / sizeof filters[0]; i++) {
            x = kalscope_fixed_update(&filters[i], z);
            if (fwrite(&x, sizeof x, 1, stdout) != 1) return 1;
        }
    return 0;
}
"""
STRICT = ("-Wall", "-Wextra", "-Werror", "-pedantic", "-O2")
STARTS = (None, None), (100.0, 4.0)
CHANNELS = tuple(
    ChannelTuning(f"light_{i}", "V", 0.05, 4.0, momentum=momentum, x0=x0, p0=p0)
    for i, (momentum, (x0, p0)) in enumerate(product((0.0, 0.3, 20.0, 500.0), STARTS))
)


def samples(n=4000):
    rng = np.random.default_rng(6)
    z = 100 + np.cumsum(rng.normal(size=n) / 5) + 2 * rng.normal(size=n)
    z[[0, 50, 51, 300]] = np.nan
    return z


def settled(channel, z, dtype):
    """The recursion of `FixedGains` in numpy scalars, each operation rounded to `dtype`."""
    found = fixed_gains(ExportJob((channel,)), channel)
    k, ell, e = dtype(found.k), dtype(found.l), dtype(found.e)
    x, step, out = dtype(np.nan if channel.x0 is None else channel.x0), dtype(0), []
    for sample in z.astype(dtype):
        ahead = sample if np.isnan(x) else x + step
        v = dtype(0) if np.isnan(sample) else sample - ahead
        x, step = ahead + k * v, e * step + ell * v
        out.append(x)
    return np.array(out)


def compiled(folder, channels, target, z, *flags):
    """What the exported filters of some channels answer, shape (n, channels)."""
    for name, text in export_tuning(Tuning(channels), target, fixed_gains=True).items():
        (folder / name).write_text(text, encoding="ascii")
    compiler, main = ("gcc", "main.c") if target == "c" else ("g++", "main.cpp")
    if shutil.which(compiler) is None:
        not_here(f"{compiler} is not installed")
    filters = ", ".join(f"KALSCOPE_FIXED_{channel.name.upper()}" for channel in channels)
    (folder / main).write_text(MAIN.replace("FILTERS", filters))
    subprocess.run([compiler, *STRICT, *flags, main, "-o", "main", "-lm"], cwd=folder, check=True)
    done = subprocess.run([folder / "main"], input=z.tobytes(), capture_output=True, check=True)
    return np.frombuffer(done.stdout, z.dtype).reshape(len(z), -1)


@pytest.mark.parametrize("channels", [CHANNELS[:2], CHANNELS[2:]], ids=["five lines", "momentum"])
def test_the_bits_are_those_of_the_recursion(channels, tmp_path):
    z, short = samples(2000), samples(2000).astype(np.float32)
    in_double, in_float = (
        np.column_stack([settled(channel, z, dtype) for channel in channels]) for dtype in (np.float64, np.float32)
    )
    np.testing.assert_array_equal(compiled(tmp_path, channels, "c", z, "-std=c99"), in_double)
    np.testing.assert_array_equal(
        compiled(tmp_path, channels, "c", short, "-std=c99", "-DKALSCOPE_FLOAT"), in_float
    )
    np.testing.assert_array_equal(compiled(tmp_path, channels, "arduino", short, "-std=c++11"), in_float)


@pytest.mark.parametrize("channel", CHANNELS)
def test_it_is_the_whole_filter_once_that_has_settled(channel):
    """Missing samples set the whole filter back, so they end early."""
    z = samples(6000)
    np.testing.assert_allclose(
        settled(channel, z, np.float64)[-500:], kalman_filter(z, channel.params).x[-500:], rtol=1e-9
    )


def test_a_channel_without_momentum_beside_one_with_it_keeps_its_one_gain():
    plain, other = CHANNELS[0], CHANNELS[4]
    job = ExportJob((plain, other))
    gains = fixed_gains(job, plain)
    assert (gains.k, gains.l, gains.e) == (steady_state(plain.params).gain, 0.0, 0.0)
    (text,) = export_tuning(Tuning((plain,)), "c", fixed_gains=True).values()
    assert "momentum" not in text
    assert "step" not in text


def test_what_fixed_gains_cannot_be_is_refused():
    def refused(match, target="c", vectors=None, **changes):
        settings = {"q": 1.0, "r": 1.0, **changes}
        with pytest.raises(BadSetting, match=match):
            export_tuning(Tuning((ChannelTuning("a", "", **settings),)), target, vectors=vectors, fixed_gains=True)

    refused("q of a must be above 0 for fixed gains", q=0.0)
    refused(r"the outlier gate of a must be off for fixed gains \(got 9\)", gate=9.0)
    refused(r"target must be arduino or c for fixed gains \(got python\)", target="python")
    recording = Recording(np.arange(3.0), ("a",), ("",), np.ones((3, 1)), 1.0)
    refused("test vectors must be left out with fixed gains", vectors=recording)
