"""Every target runs in its own runtime, or is read by its own reader, on the shared vectors."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from itertools import cycle

import numpy as np
import pytest
import yaml
from esphome import esphome
from exported_program import build, program
from required import node
from ruamel.yaml import YAML
from waiting import PATIENCE

from kalscope import BadSetting, ChannelTuning, Tuning, export_tuning, kalman_filter, steady_state
from kalscope.export.job import step_of
from kalscope.export.registry import TARGETS
from kalscope.filtering.classic import Chain, Exponential


def run(*command, stdin="", cwd=None):
    done = subprocess.run(
        [str(part) for part in command], input=stdin, capture_output=True, text=True, cwd=cwd, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def write(files, folder):
    for name, text in files.items():
        (folder / name).write_text(text, encoding="ascii")


def lines_of(recording):
    """The samples as a program reads them, one row per line; a missing one is nan, inf or -inf in turn."""
    missing = cycle(("nan", "inf", "-inf"))
    text = "".join(" ".join(map(repr, row)) + "\n" for row in recording.values.tolist())
    return re.sub("nan", lambda _: next(missing), text)


def table(text, shape):
    """The answers of a program: x and k of each channel, in turn."""
    numbers = np.array(text.split(), dtype=np.float64).reshape(shape[0], shape[1], 2)
    return numbers[..., 0], numbers[..., 1]


PYTHON_DRIVER = """\
import sys
sys.path.insert(0, sys.argv[1])
from kalscope_filter import FILTERS
for line in sys.stdin:
    for f, z in zip(FILTERS.values(), map(float, line.split())):
        print(repr(f.update(z)), repr(f.k))
"""


def test_python_is_the_same_filter_in_a_bare_interpreter(either, tmp_path):
    write(export_tuning(either.tuning, "python"), tmp_path)
    out = run(sys.executable, "-I", "-S", "-c", PYTHON_DRIVER, tmp_path, stdin=lines_of(either.recording))
    x, k = table(out, either.x.shape)
    np.testing.assert_array_equal(x, either.x)
    np.testing.assert_array_equal(k, either.k)


def test_matlab_scripts_are_the_same_filter_in_octave(either, tmp_path):
    files = export_tuning(either.tuning, "matlab")
    write(files, tmp_path)
    either.recording.values.astype("<f8").T.tofile(tmp_path / "raw.bin")
    rows, channels = either.x.shape
    driver = ["no_plot = true; f = fopen('raw.bin'); all_z = fread(f, [ROWS, N], 'double'); fclose(f); out = [];"]
    for i, name in enumerate(files, 1):
        driver.append(f"z = all_z(:, {i}); run('{name}'); out = [out, buff_xk, buff_Kk];")
    driver.append("f = fopen('out.bin', 'w'); fwrite(f, out, 'double'); fclose(f);")
    script = "\n".join(driver).replace("ROWS", str(rows)).replace("N]", f"{channels}]")
    run(program("octave-cli"), "--no-gui", "--norc", "--quiet", "--eval", script, cwd=tmp_path)
    out = np.fromfile(tmp_path / "out.bin", "<f8").reshape(channels, 2, rows)
    np.testing.assert_array_equal(out[:, 0].T, either.x)
    np.testing.assert_array_equal(out[:, 1].T, either.k)


def test_a_matlab_script_runs_without_samples_and_does_not_round_the_answers_to_whole_counts(shared, tmp_path):
    write(export_tuning(shared.tuning, "matlab", channel="diffuse"), tmp_path)
    z = [100, 103, 101, 106, 99]
    script = "no_plot = true; kalman_diffuse; printf('%d %d ', numel(buff_xk), any(isnan(buff_xk)));"
    script += f" z = int16({z}); kalman_diffuse; printf('%.17g ', buff_xk);"
    out = run(program("octave-cli"), "--norc", "--quiet", "--eval", script, cwd=tmp_path).split()
    expected = kalman_filter(z, shared.tuning.channel("diffuse").params).x
    np.testing.assert_array_equal([float(word) for word in out], [100, 0, *expected])


def test_json_holds_the_tuned_numbers_and_the_constants_of_a_momentum(either):
    (text,) = export_tuning(either.tuning, "json").values()
    document = json.loads(text, parse_constant=pytest.fail)
    assert document["sample_period_s"] == 0.01
    keys = ("process_noise_q", "measurement_noise_r", "start_variance_p0", "start_value_x0", "outlier_gate")
    for channel, entry in zip(either.tuning.channels, document["channels"], strict=True):
        numbers, steady = [entry[key] for key in keys], steady_state(channel.params)
        assert numbers == [channel.q, channel.r, channel.p0, channel.x0, channel.gate]
        assert all(type(value) is float for value in numbers if value is not None)
        assert (entry["name"], entry["steady_gain"]) == (channel.name, steady.gain)
        assert ("momentum" in entry) == (channel.momentum > 0.0)
        if named := dict(step_of(channel)):
            named["tau_samples"] = named.pop("momentum")
            assert entry["momentum"] == {
                **named,
                "velocity_gain": steady.velocity_gain,
                "overshoot": steady.overshoot,
            }


def test_c_is_the_same_filter_under_gcc(either, tmp_path):
    """In double; tests/export/targets/test_compiled.py has float and other processors."""
    files = export_tuning(either.tuning, "c")
    names = re.findall(r"extern const kalscope_tuning (\w+);", files["kalscope_filter.h"])
    start = "".join(f"kalscope_start(&f[{i}], &{name});\n" for i, name in enumerate(names))
    step = 'double z; if (scanf("%lf", &z) != 1) return 1; kalscope_update(&f[j], z);'
    step += ' printf("%a %a\\n", f[j].x, f[j].k);'
    loops = f"for (int i = 0; i < {len(either.x)}; i++) for (int j = 0; j < {len(names)}; j++) {{ {step} }}"
    head = '#include <stdio.h>\n#include "kalscope_filter.h"\n'
    main = f"{head}int main(void) {{ kalscope_filter f[{len(names)}];\n{start}{loops}\nreturn 0; }}\n"
    out = build(tmp_path, "gcc", files, main, "-std=c99", "-O2")(lines_of(either.recording).encode())
    numbers = np.array([float.fromhex(word.decode()) for word in out.split()]).reshape(*either.x.shape, 2)
    np.testing.assert_array_equal(numbers[..., 0], either.x)
    np.testing.assert_array_equal(numbers[..., 1], either.k)


JAVASCRIPT_DRIVER = """\
import { filters } from "./kalscope_filter.mjs";
import { readFileSync } from "node:fs";
const missing = { nan: null, inf: Infinity, "-inf": undefined };
for (const line of readFileSync(0, "utf8").trim().split("\\n")) {
  const z = line.split(" ").map((word) => word in missing ? missing[word] : Number(word));
  console.log(Object.values(filters).map((f, i) => `${f.update(z[i])} ${f.k}`).join(" "));
}
"""


def test_javascript_is_the_same_filter_in_node(either, tmp_path):
    write(export_tuning(either.tuning, "javascript"), tmp_path)
    (tmp_path / "main.mjs").write_text(JAVASCRIPT_DRIVER)
    out = run(node(), "main.mjs", stdin=lines_of(either.recording), cwd=tmp_path)
    x, k = table(out.replace("NaN", "nan"), either.x.shape)
    np.testing.assert_array_equal(x, either.x)
    np.testing.assert_array_equal(k, either.k)


@pytest.mark.parametrize("load", [yaml.safe_load, YAML(typ="safe", pure=True).load])
def test_esphome_numbers_make_its_filter_ours_within_float32(shared_float32, load):
    names = ["diffuse", "holes", "late diffuse", "r zero", "tiny", "large"]
    good = shared_float32.only(names)
    (text,) = export_tuning(good.tuning, "esphome").values()
    sensors = load(text)["sensor"]
    assert len(sensors) == len(names)
    for i, (sensor, channel) in enumerate(zip(sensors, good.tuning.channels, strict=True)):
        assert (sensor["platform"], sensor["type"]) == ("combination", "kalman")
        (source,) = sensor["sources"]
        assert sensor["process_std_dev"] ** 2 * 0.01 == pytest.approx(channel.q, rel=1e-15)
        assert source["error"] ** 2 == pytest.approx(channel.r, rel=1e-15)
        z = good.recording.values[:, i]
        x = esphome([sensor], z[:, None])
        np.testing.assert_allclose(x, good.x[:, i], rtol=0.0, atol=3e-6 * np.nanmax(np.abs(z)))


def test_esphome_refuses_what_it_cannot_hold(shared):
    for name in ("minute", "huge"):
        with pytest.raises(BadSetting, match=f"q of {name} per ms, for ESPHome, must fit float32"):
            export_tuning(shared.tuning, "esphome", channel=name)
    unknown = Tuning((ChannelTuning("a", "V", 1.0, 1.0),))
    with pytest.raises(BadSetting, match="sample_period of the tuning must be known"):
        export_tuning(unknown, "esphome")


@pytest.mark.parametrize(
    ("target", "channel", "words"),
    [
        (
            "esphome",
            ChannelTuning("temp", "V", 0.01, 0.25, momentum=20.0),
            "momentum .got esphome.: choose arduino, c,",
        ),
        (
            "esphome",
            ChannelTuning("temp", "V", 0.01, 0.25, chain=Chain(5)),
            "a median and classic filters .got esphome",
        ),
        (
            "matlab",
            ChannelTuning("temp", "V", 0.01, 0.25, chain=Chain(1, Exponential(0.125))),
            "choose arduino, c, python, json",
        ),
        ("javascript", ChannelTuning("temp", "V", 0.01, 0.25, chain=Chain(5)), "or use the Kalman filter alone"),
    ],
)
def test_a_target_that_lacks_a_filter_names_those_that_have_it(target, channel, words):
    plain = ChannelTuning("plain", "V", 0.01, 0.25)
    with pytest.raises(BadSetting, match=f"^target must support .*{words}"):
        export_tuning(Tuning((plain, channel), sample_period=0.01), target)


@pytest.mark.parametrize("target", [name for name, each in TARGETS.items() if each.setting is None])
def test_without_momentum_no_export_speaks_of_it(target):
    tuning = Tuning((ChannelTuning("temp", "degC", 0.01, 0.25),), sample_period=0.01)
    text = "\n".join(export_tuning(tuning, target).values())
    assert re.search("momentum|velocity|@plain", text) is None
