"""A thousand random doubles (25,000 in `make soak`) come back bit for bit through each format and its reader."""

from __future__ import annotations

import json
import math
import random
import re
import runpy
import shutil
import subprocess
import sys
import tomllib

import numpy as np
import pytest
import yaml
from effort import FUZZ
from required import REQUIRE_ALL
from waiting import PATIENCE

from kalscope import ChannelTuning, Tuning, export_tuning
from kalscope.export.names import number_text
from kalscope.tuning.file import dumps

pytestmark = pytest.mark.slow

CHANNELS = 200 * FUZZ
NAMES = ("q", "r", "p0", "x0", "gate")


def needs(program):
    """Skip where a program is missing; where all are required the test runs, and fails for want of it."""
    missing = shutil.which(program) is None and not REQUIRE_ALL
    return pytest.mark.skipif(missing, reason=f"{program} is not installed")


def random_number(rng):
    """Log-uniform over all magnitudes that a parameter may have; often an integer, sometimes subnormal."""
    kind = rng.randrange(10)
    if kind == 0:
        return float(rng.randrange(1, 10**6))
    if kind == 1:
        return 5e-324 * rng.randrange(1, 2**52)
    return min(10.0 ** rng.uniform(-300.0, 300.0) * rng.choice((1.0, rng.random() + 0.5)), 1e300)


@pytest.fixture(scope="module")
def tuning():
    rng = random.Random(20261121)
    channels = []
    for i in range(CHANNELS):
        q, r, p0, x0, gate = (random_number(rng) for _ in range(5))
        channels.append(ChannelTuning(f"c{i}", "", q, r, p0, rng.choice((x0, -x0)), gate=gate))
    return Tuning(tuple(channels), sample_period=0.01)


@pytest.fixture(scope="module")
def numbers(tuning):
    return [getattr(channel, name) for channel in tuning.channels for name in NAMES]


def identical(found, expected):
    assert len(found) == len(expected) >= 500
    assert [value.hex() for value in found] == [value.hex() for value in expected]


def test_the_numbers_are_of_all_kinds(numbers):
    assert len(numbers) == len(NAMES) * CHANNELS
    assert sum(abs(number) < sys.float_info.min for number in numbers) > len(numbers) / 20
    assert sum(number.is_integer() and abs(number) < 2**53 for number in numbers) > len(numbers) / 20
    assert max(numbers) > 1e290


def test_json_reads_them_back(tuning, numbers):
    (text,) = export_tuning(tuning, "json").values()
    keys = ("process_noise_q", "measurement_noise_r", "start_variance_p0", "start_value_x0", "outlier_gate")
    identical([entry[key] for entry in json.loads(text)["channels"] for key in keys], numbers)


def test_the_tuning_file_reads_them_back(tuning, numbers):
    """What is exported came through TOML."""
    channels = tomllib.loads(dumps(tuning))["channel"]
    identical([channel[name] for channel in channels for name in NAMES], numbers)


def test_python_reads_them_back(tuning, numbers, tmp_path):
    for name, text in export_tuning(tuning, "python").items():
        (tmp_path / name).write_text(text)
    filters = runpy.run_path(str(tmp_path / "kalscope_filter.py"))["FILTERS"].values()
    identical([getattr(f, name) for f in filters for name in ("q", "r", "p", "x", "gate")], numbers)
    params = runpy.run_path(str(tmp_path / "with_kalscope.py"))["PARAMS"].values()
    identical([getattr(p, name) for p in params for name in NAMES], numbers)


@needs("g++")
def test_bachagas_numbers_read_back_through_gcc(tuning, numbers, tmp_path):
    (text,) = export_tuning(tuning, "bachagas").values()
    rows = re.findall(r"kalman_init\((.*?)\), (\S+), 0\}", text)
    (tmp_path / "t.c").write_text(
        "#include <stdio.h>\n#include <math.h>\nstatic const double values[] = {"
        + ",\n".join(f"{init}, {gate}" for init, gate in rows)
        + "};\nint main(void) { for (unsigned i = 0; i < sizeof values / sizeof *values; i++)"
        + ' printf("%a\\n", values[i]); return 0; }\n'
    )
    subprocess.run(["gcc", "-std=c99", "-Wall", "-Werror", "t.c", "-o", "t"], check=True, cwd=tmp_path)
    out = subprocess.run([tmp_path / "t"], check=True, capture_output=True, text=True).stdout
    identical([float.fromhex(line) for line in out.split()], numbers)


@needs("gcc")
def test_c_constants_read_back_through_gcc(tuning, numbers, tmp_path):
    for name, text in export_tuning(tuning, "c").items():
        (tmp_path / name).write_text(text)
    constants = re.findall(r"extern const kalscope_tuning (\w+);", (tmp_path / "kalscope_filter.h").read_text())
    table = ",\n".join(f"&{name}" for name in constants)
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "kalscope_filter.h"\n'
        f"static const kalscope_tuning *all[] = {{{table}}};\n"
        "int main(void) { for (unsigned i = 0; i < sizeof all / sizeof *all; i++)"
        ' printf("%a %a %a %a %a\\n", all[i]->q, all[i]->r, all[i]->p0, all[i]->x0, all[i]->gate); return 0; }\n'
    )
    command = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-O0", "main.c", "kalscope_filter.c", "-o", "main"]
    subprocess.run(command, check=True, cwd=tmp_path)
    out = subprocess.run([tmp_path / "main"], check=True, capture_output=True, text=True).stdout
    identical([float.fromhex(word) for word in out.split()], numbers)


@needs("octave-cli")
def test_matlab_numbers_read_back_through_octave(tuning, numbers, tmp_path):
    """The assignments of all scripts in one, so that Octave starts once."""
    assignments = [
        line
        for text in export_tuning(tuning, "matlab").values()
        for line in text.splitlines()
        if re.match(r"(Q|R|Pk|xk|gate) = ", line)
    ]
    assert len(assignments) == len(NAMES) * CHANNELS
    body = "\n".join(f"{line}\nv({i}) = {line.split()[0]};" for i, line in enumerate(assignments, 1))
    (tmp_path / "values.m").write_text(
        f"v = zeros({len(assignments)}, 1);\n{body}\n"
        "f = fopen('out.bin', 'w'); fwrite(f, v, 'double');\nfclose(f);\n"
    )
    subprocess.run(["octave-cli", "--norc", "--quiet", "values.m"], check=True, cwd=tmp_path, timeout=PATIENCE)
    identical(np.fromfile(tmp_path / "out.bin", "<f8").tolist(), numbers)


def test_javascript_numbers_read_back(tuning, numbers):
    """As kalmanjs, below."""
    (text,) = export_tuning(tuning, "javascript").values()
    rows = re.findall(r"new KalmanFilter\(\{ q: (\S+), r: (\S+), p0: (\S+), x0: (\S+), gate: (\S+) \}\)", text)
    identical([float(word) for row in rows for word in row], numbers)


def test_kalmanjs_numbers_read_back(tuning):
    """JavaScript reads a decimal literal as IEEE says, and so does Python; node runs the module in test_targets."""
    good = Tuning(tuple(c for c in tuning.channels if c.q + c.r >= 1e-300), sample_period=0.01)
    (text,) = export_tuning(good, "kalmanjs").values()
    rows = re.findall(r"\{R: (\S+), Q: (\S+)\}\), \{x: (\S+), cov: (\S+), gate: (\S+),", text)
    expected = [getattr(c, name) for c in good.channels for name in ("q", "r", "x0", "p0", "gate")]
    identical([float(cell) for row in rows for cell in row], expected)


def test_esphome_deviations_read_back(tuning):
    """Its reader gives the very double of the square root; squared it is the variance to the last digits."""
    variances = [10.0 ** random.Random(i).uniform(-30.0, 30.0) for i in range(500)]
    channels = tuple(ChannelTuning(f"c{i}", "", v, v) for i, v in enumerate(variances))
    (text,) = export_tuning(Tuning(channels, sample_period=0.01), "esphome").values()
    sensors = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))["sensor"]
    identical([s["sources"][0]["error"] for s in sensors], [math.sqrt(v) for v in variances])
    identical([s["process_std_dev"] for s in sensors], [math.sqrt(v) / math.sqrt(0.01) for v in variances])


def test_a_number_is_never_an_integer_or_an_exponent_without_a_point(numbers):
    for number in [*numbers, 0.0, -0.0, 1.0, 1e16, 1e22, 1e-5, 5e-324, 1e300]:
        assert re.fullmatch(r"-?[0-9]+\.[0-9]+(e[-+][0-9]+)?", number_text(number))
