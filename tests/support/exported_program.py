"""Programs of exported C and C++, compiled for this computer with every warning an error."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
from tests.support.required import not_here

from kalscope.export.job import ExportJob
from kalscope.export.targets import arduino, c
from kalscope.tuning.tuning import ChannelTuning

CPUINFO = Path("/proc/cpuinfo")
FUSED = ("-mfma",) if CPUINFO.is_file() and " fma " in CPUINFO.read_text() else ()
"""Lets the compiler fuse a product with a sum, where the exported code did not forbid it."""
FLAGS = ("-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-pedantic", "-Werror")

FUSION = ChannelTuning(
    "level",
    "V",
    4.0,
    (90.0, 25.0, 400.0),
    sensors=("a", "b", "c"),
    offset=(0.0, 12.5, -30.0),
    gain=(1.0, 1.05, 0.9),
    gate=9.0,
    momentum=20.0,
)

C_MAIN = """
#include <stdio.h>
enum { ROWS = 6000 };
#include "kalscope_filter.h"
int main(void)
{
    static const kalscope_tuning *const tunings[] = {TUNINGS};
    static kalscope_real z[ROWS];
    const size_t n = fread(z, sizeof z[0], ROWS, stdin);
    for (size_t i = 0; i < sizeof tunings / sizeof tunings[0]; i++) {
        kalscope_filter filter;
        kalscope_start(&filter, tunings[i]);
        for (size_t j = 0; j < n; j++) {
            const kalscope_real x = kalscope_update(&filter, z[j]);
            if (fwrite(&x, sizeof x, 1, stdout) != 1) return 1;
        }
    }
    return 0;
}
"""
CPP_MAIN = """
#include <stdio.h>
enum { ROWS = 6000 };
#include "KalscopeFilter.h"
int main() {
  static KalscopeFilter filters[] = {TUNINGS};
  static float z[ROWS];
  const size_t n = fread(z, sizeof z[0], ROWS, stdin);
  for (KalscopeFilter &filter : filters) {
    filter.update(1e6f);
    filter.restart();
    for (size_t j = 0; j < n; j++) {
      const float x = filter.update(z[j]);
      if (x == x && x != filter.x) return 2;
      if (fwrite(&x, sizeof x, 1, stdout) != 1) return 1;
    }
  }
  return 0;
}
"""


def spiky(rows, dtype=np.float64):
    """A walk in noise, with spikes, a step after which the gate gives in, and missing samples."""
    rng = np.random.default_rng(12)
    z = 500 + np.cumsum(rng.normal(0, 2, rows)) + rng.normal(0, 5, rows)
    z[rng.random(rows) < 0.02] += 900.0
    z[1000:1020] += 400.0
    z[rng.random(rows) < 0.02] = np.nan
    z[:3] = np.nan
    return z.astype(dtype)


def program(name):
    """Where a compiler or an interpreter is."""
    return shutil.which(name) or not_here(f"{name} is not installed")


def build(folder, compiler, texts, main, *flags):
    """Compile exported files with a main program; returns run(bytes) -> bytes."""
    name = "main.cpp" if compiler == "g++" else "main.c"
    for file, text in {**texts, name: main}.items():
        (folder / file).write_text(text, encoding="ascii")
    sources = [name, *(file for file in texts if file.endswith(".c"))]
    command = [program(compiler), *FLAGS, *flags, *sources, "-o", "run", "-lm"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
    return lambda data: subprocess.run([folder / "run"], input=data, check=True, capture_output=True).stdout


def in_c(folder, channels, z, *flags):
    """What the exported C makes of samples, shape (channels, n), in their type."""
    job = ExportJob(tuple(channels), sample_period=0.005)
    tunings = ", ".join(f"&kalscope_tuning_{name}" for name in job.identifiers)
    run = build(folder, "gcc", c.files(job), C_MAIN.replace("TUNINGS", tunings), *flags)
    return np.frombuffer(run(z.tobytes()), z.dtype).reshape(-1, len(z))


def in_cpp(folder, channels, z, *flags):
    """The same for the exported C++ class; z is float32."""
    job = ExportJob(tuple(channels), sample_period=0.005)
    filters = ", ".join(f"KalscopeFilter(KALSCOPE_TUNING_{name.upper()})" for name in job.identifiers)
    texts = {"KalscopeFilter.h": arduino.files(job)["KalscopeFilter.h"]}
    run = build(folder, "g++", texts, CPP_MAIN.replace("TUNINGS", filters), *flags)
    return np.frombuffer(run(z.tobytes()), z.dtype).reshape(-1, len(z))
