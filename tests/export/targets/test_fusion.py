"""A fused filter exported to every target that can hold it: the bits of `fuse`, and of its float32 twin."""

from __future__ import annotations

import json
import math
import runpy
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from tests.support.exported_program import FUSED, build, program
from tests.support.required import node
from tests.support.waiting import PATIENCE

from kalscope import BadSetting, ChannelTuning, FilterParams, Tuning, export_tuning, fuse
from kalscope.export.float32 import filter_float32
from kalscope.export.names import identifier

ROWS = 300


def readings(fusion):
    """What the sensors say of a walk: gaps of each, of all, and at the start; spikes; a step."""
    rng = np.random.default_rng(4)
    x = 20.0 + np.cumsum(rng.normal(0.0, 0.3, ROWS))
    x[200:] += 15.0  # the gate gives in after five of a sensor
    z = np.array(fusion.offset) + np.array(fusion.gain) * x[:, None]
    z += rng.normal(size=z.shape) * np.sqrt(fusion.r)
    z[rng.random(z.shape) < 0.03] += 40.0
    z[rng.random(z.shape) < 0.1] = np.nan
    z[[0, 1, 120, 121]] = np.nan
    z[2, 0] = np.nan
    return z


PAIR = ChannelTuning("level", "cm", 0.09, (1.0, 0.25), sensors=("sonar", "float"))
THREE = ChannelTuning("tilt", "deg", 0.09, (1.0, 16.0, 0.01), sensors=("a", "b", "c"))
EXACT = ChannelTuning("x", "", 0.09, (1e-30, 0.0), sensors=("a", "b"), p0=1.0)
CASES = {
    "two": PAIR,
    "offsets": replace(PAIR, offset=(3.0, -1.5), gate=9.0),
    "gains": replace(THREE, offset=(0.5, -3.0, 0.0), gain=(1.0, -4.1, 0.01), gate=6.0),
    "known start": replace(PAIR, p0=4.0, x0=19.0, gate=9.0),
    "first reading": replace(PAIR, p0=4.0),
    "momentum": replace(PAIR, offset=(3.0, -1.5), momentum=7.0, gate=9.0),
    "momentum, gains and start": replace(PAIR, gain=(1.25, 0.8), momentum=1e4, p0=9.0, x0=20.0),
    "momentum, first reading": replace(PAIR, momentum=0.3, p0=2.0),
    "one": ChannelTuning("only", "", 0.09, (1.0,), sensors=("a",)),
    "exact": EXACT,
    "exact, momentum": replace(EXACT, momentum=5.0),
}
EACH = pytest.mark.parametrize("case", CASES)


def tuned(fusion):
    return Tuning((ChannelTuning(fusion.sensors[0], "", 1.0, 1.0),), sample_period=0.01, fusion=fusion)


def write(files, folder):
    for name, text in files.items():
        (folder / name).write_text(text, encoding="ascii")


# ---- programs


@EACH
def test_python_gives_the_bits_of_fuse(case, tmp_path):
    write(export_tuning(tuned(CASES[case]), "python"), tmp_path)
    fusion, z = CASES[case], readings(CASES[case])
    made = runpy.run_path(str(tmp_path / "kalscope_fusion.py"))["FUSION"]
    answers = np.array([(made.update(row), made.p, *made.k) for row in np.nan_to_num(z, nan=-np.inf).tolist()])
    expected = fuse(z, fusion.params)
    np.testing.assert_array_equal(answers[:, 0], expected.x)
    np.testing.assert_array_equal(answers[:, 1], expected.p)
    np.testing.assert_allclose(answers[:, 2:] / np.array(fusion.gain), expected.k, rtol=1e-15)
    if fusion.momentum:
        assert made.velocity == expected.velocity[-1]


C_MAIN = r"""
#include <stdio.h>
#include "kalscope_fusion.h"
int main(void)
{
    kalscope_fusion fusion;
    kalscope_fusion_real row[KALSCOPE_SENSORS + 1], out[2]; /* the mask, then the readings */
    kalscope_fusion_start(&fusion, &kalscope_fusion_tuning_NAME);
    while (fread(row, sizeof row, 1, stdin) == 1) {
        out[0] = kalscope_fusion_update(&fusion, row + 1, row[0] < 0 ? KALSCOPE_ALL_VALID : (uint32_t)row[0]);
        out[1] = fusion.p;
        if (fwrite(out, sizeof out, 1, stdout) != 1) return 1;
    }
    return 0;
}
"""
CPP_MAIN = r"""
#include <stdio.h>
#include "KalscopeFusion.h"
int main() {
  KalscopeFusion fusion(KALSCOPE_FUSION_NAME);
  float row[KALSCOPE_SENSORS + 1], out[2];
  while (fread(row, sizeof row, 1, stdin) == 1) {
    out[0] = row[0] < 0 ? fusion.update(row + 1) : fusion.update(row + 1, (uint32_t)row[0]);
    out[1] = fusion.p;
    if (fwrite(out, sizeof out, 1, stdout) != 1) return 1;
  }
}
"""


def compiled(folder, fusion, dtype, *flags):
    """The exported C, or C++ where the flags begin with its standard: run(z, mask) gives x and p of each row."""
    cpp, name = "++" in flags[0], identifier(fusion.name)
    exported = export_tuning(tuned(fusion), "arduino" if cpp else "c")
    texts = {file: text for file, text in exported.items() if not file.endswith(".ino")}
    main = CPP_MAIN.replace("NAME", name.upper()) if cpp else C_MAIN.replace("NAME", name)
    run = build(folder, "g++" if cpp else "gcc", texts, main, *flags)
    return lambda z, mask: np.frombuffer(run(np.column_stack([mask, z]).astype(dtype).tobytes()), dtype).reshape(
        -1, 2
    )


def in_both_ways(run, z):
    """The answers where what is missing is NaN, after seeing that a mask over nonsense gives the same."""
    answers, there = run(z, np.full(len(z), -1.0)), np.isfinite(z)
    mask = there @ (1 << np.arange(z.shape[1]))
    np.testing.assert_array_equal(run(np.where(there, z, 1e9), mask), answers)
    return answers


@EACH
def test_c_gives_the_bits_of_fuse_and_in_float_those_of_its_float32_twin(case, tmp_path):
    fusion, z = CASES[case], readings(CASES[case])
    answers, expected = in_both_ways(compiled(tmp_path, fusion, np.float64, "-std=c99"), z), fuse(z, fusion.params)
    np.testing.assert_array_equal(answers, np.column_stack([expected.x, expected.p]))
    answers = in_both_ways(compiled(tmp_path, fusion, np.float32, "-std=c99", "-DKALSCOPE_FLOAT"), z)
    np.testing.assert_array_equal(answers[:, 0], filter_float32(z, fusion.params))


@EACH
def test_cpp_gives_the_bits_of_the_float32_twin_which_stays_with_fuse(case, tmp_path):
    fusion, z = CASES[case], readings(CASES[case])
    x = in_both_ways(compiled(tmp_path, fusion, np.float32, "-std=c++11", "-Wno-conversion"), z)[:, 0]
    np.testing.assert_array_equal(x, filter_float32(z, fusion.params))
    np.testing.assert_allclose(x, fuse(z, fusion.params).x, rtol=2e-5)


JAVASCRIPT_MAIN = """\
import { readFileSync } from "node:fs";
for (const [at, rows] of JSON.parse(readFileSync(0, "utf8")).entries()) {
  const { fusion } = await import(`./${at}.mjs`);
  for (const row of rows) console.log(fusion.update(row.map((z) => z ?? NaN)), fusion.p);
}
"""


def test_javascript_gives_the_bits_of_fuse(tmp_path):
    """All cases in one process."""
    rows, modules = [readings(fusion) for fusion in CASES.values()], {"main.mjs": JAVASCRIPT_MAIN}
    for at, fusion in enumerate(CASES.values()):
        (modules[f"{at}.mjs"],) = export_tuning(tuned(fusion), "javascript").values()
    write(modules, tmp_path)
    sent = json.dumps([[[None if math.isnan(z) else z for z in row] for row in z.tolist()] for z in rows])
    done = subprocess.run(
        [node(), "main.mjs"], input=sent, cwd=tmp_path, check=True, capture_output=True, text=True
    )
    words = done.stdout.replace("NaN", "nan").replace("Infinity", "inf").split()
    answers = np.array(words, dtype=np.float64).reshape(len(CASES), ROWS, 2)
    for answer, z, (case, fusion) in zip(answers, rows, CASES.items(), strict=True):
        expected = fuse(z, fusion.params)
        np.testing.assert_array_equal(answer, np.column_stack([expected.x, expected.p]), err_msg=case)


def test_a_processor_that_could_fuse_a_multiplication_with_an_addition_does_not_and_hostile_names_compile(tmp_path):
    hostile = {"name": '*/ #define x\n??/"\\', "sensors": ("int", "*/ #error"), "unit": "??/"}
    fusion = replace(CASES["momentum, gains and start"], **hostile)
    z, nobody, flags = readings(fusion), np.full(ROWS, -1.0), ("-trigraphs", "-O3", *FUSED)
    x = compiled(tmp_path, fusion, np.float64, "-std=c99", *flags)(z, nobody)[:, 0]
    np.testing.assert_array_equal(x, fuse(z, fusion.params).x)
    x = compiled(tmp_path, fusion, np.float32, "-std=c++11", "-Wno-conversion", *flags)(z, nobody)[:, 0]
    np.testing.assert_array_equal(x, filter_float32(z, fusion.params))


OCTAVE = """\
f = fopen('zAT.bin'); z = fread(f, [ROWS, SENSORS], 'double'); fclose(f); run('NAME');
f = fopen('xAT.bin', 'w'); fwrite(f, buff_xk, 'double'); fclose(f);
"""


def test_octave_gives_the_bits_of_fuse(tmp_path):
    driver, scripts = "no_plot = true;\n", {}
    for at, fusion in enumerate(CASES.values()):
        ((name, text),) = export_tuning(tuned(fusion), "matlab").items()
        scripts[name := name.replace("kalman_", f"kalman_{at}_")] = text
        readings(fusion).astype("<f8").T.tofile(tmp_path / f"z{at}.bin")
        step = OCTAVE.replace("AT", str(at)).replace("ROWS", str(ROWS))
        driver += step.replace("SENSORS", str(len(fusion.sensors))).replace("NAME", name)
    driver += f"clear z; run('{next(iter(scripts))}'); printf('%d %d', numel(buff_xk), any(isnan(buff_xk)));"
    write(scripts, tmp_path)
    command = [program("octave-cli"), "--no-gui", "--norc", "--quiet", "--eval", driver]
    done = subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True, timeout=PATIENCE)
    assert done.stdout.split() == ["100", "0"]
    for at, (case, fusion) in enumerate(CASES.items()):
        x = np.fromfile(tmp_path / f"x{at}.bin", "<f8")
        np.testing.assert_array_equal(x, fuse(readings(fusion), fusion.params).x, err_msg=case)


def test_one_sensor_on_a_board_is_the_single_filter():
    z = readings(CASES["one"])
    for start in ({}, {"p0": 4.0, "x0": 19.0, "gate": 9.0}, {"p0": 4.0, "momentum": 7.0}):
        single = FilterParams(0.09, 1.0, **start)
        one = replace(CASES["one"], **start).params
        np.testing.assert_array_equal(filter_float32(z, one), filter_float32(z[:, 0], single))


# ---- what is refused


MANY = ChannelTuning("x", "", 1.0, (1.0,) * 33, sensors=tuple(map(str, range(33))))


@pytest.mark.parametrize(
    ("fusion", "target", "message"),
    [
        (MANY, "arduino", r"1 to 6 sensors \(got 33\): take fewer, or export c"),
        (MANY, "c", r"at most 32 sensors \(got 33\)"),
        (replace(PAIR, r=(1e-60, 1.0)), "arduino", r"^level: r / gain² must fit float32"),
        (replace(PAIR, q=3e38, r=(3e38, 1.0)), "arduino", r"^level: q \+ r / gain² \+ p0 must fit float32"),
    ],
)
def test_other_refusals_say_what_helps(fusion, target, message):
    with pytest.raises(BadSetting, match=message):
        export_tuning(tuned(fusion), target)


def test_c_in_float_does_not_compile_where_float_cannot_hold_the_values(tmp_path):
    with pytest.raises(subprocess.CalledProcessError) as failed:
        compiled(tmp_path, replace(PAIR, r=(1e-60, 1.0)), np.float32, "-std=c99", "-DKALSCOPE_FLOAT")
    assert "float cannot hold the values of level" in failed.value.stderr
