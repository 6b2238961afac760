"""A thousand random doubles (25,000 in `make soak`) come back bit for bit through each format and its reader."""

from __future__ import annotations

import random
import re
import runpy
import shutil
import subprocess
import sys

import numpy as np
import pytest
from effort import FUZZ
from required import REQUIRE_ALL
from waiting import PATIENCE

from kalscope import ChannelTuning, Tuning, export_tuning
from kalscope.export.names import number_text

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


def test_python_reads_them_back(tuning, numbers, tmp_path):
    for name, text in export_tuning(tuning, "python").items():
        (tmp_path / name).write_text(text)
    filters = runpy.run_path(str(tmp_path / "kalscope_filter.py"))["FILTERS"].values()
    identical([getattr(f, name) for f in filters for name in ("q", "r", "p", "x", "gate")], numbers)


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
    (text,) = export_tuning(tuning, "javascript").values()
    rows = re.findall(r"new KalmanFilter\(\{ q: (\S+), r: (\S+), p0: (\S+), x0: (\S+), gate: (\S+) \}\)", text)
    identical([float(word) for row in rows for word in row], numbers)


def test_a_number_is_never_an_integer_or_an_exponent_without_a_point(numbers):
    for number in [*numbers, 0.0, -0.0, 1.0, 1e16, 1e22, 1e-5, 5e-324, 1e300]:
        assert re.fullmatch(r"-?[0-9]+\.[0-9]+(e[-+][0-9]+)?", number_text(number))
