"""Every target runs in its own runtime, or is read by its own reader, on the shared vectors."""

from __future__ import annotations

import csv
import io
import json
import math
import random
import re
import subprocess
import sys
from dataclasses import dataclass, replace
from itertools import cycle

import numpy as np
import pytest
from tests.support.exported_program import build, program
from tests.support.required import node
from tests.support.waiting import PATIENCE

from kalscope import BadSetting, ChannelTuning, Recording, Tuning, export_tuning, kalman_filter, steady_state
from kalscope.export.job import job_of, step_of
from kalscope.export.registry import MAX_ROWS, vector_files
from kalscope.filtering.classic import Chain, Exponential
from kalscope.filtering.kernels import transition

ROWS = 400


@dataclass(frozen=True)
class Shared:
    """What all targets are checked on; arrays have shape (ROWS, channels), in the order of `tuning.channels`."""

    tuning: Tuning
    recording: Recording
    x: np.ndarray
    """Filtered values of the textbook oracle below."""
    k: np.ndarray
    """Its gains."""


def textbook(channel, z):
    """x and k after each sample: the five lines, a missing sample, the three starts and the gate.

    A second state is the velocity v, whose variance is w and its covariance with x is g: without momentum all 0.
    The textbook of two speeds is in tests/filtering/test_two_speeds.py.
    """
    if channel.fast is not None:
        result = kalman_filter(np.array(z), channel.params)
        return np.column_stack((result.x, result.k))
    e, f, q11, q12, q22, w = 0.0, 0.0, channel.q, 0.0, 0.0, 0.0
    if channel.momentum:
        e, f, q11, q12, q22 = transition(1.0, channel.q, channel.momentum)
        w = 0.5 * channel.q / channel.momentum
    x, v = (math.nan if channel.x0 is None else channel.x0), 0.0
    p, g = (math.inf if channel.p0 is None else channel.p0), 0.0
    refused, answers = 0, []
    for sample in z:
        x, v = x + f * v, e * v
        p, g, w = p + f * (2.0 * g + f * w) + q11, e * (g + f * w) + q12, e * e * w + q22
        k, s = 0.0, p + channel.r
        if math.isnan(sample):
            pass
        elif math.isinf(p):
            x, p, g, k, refused = sample, channel.r, 0.0, 1.0, 0
        elif channel.gate is not None and (sample - x) * (sample - x) > channel.gate * s and refused < 5:
            refused += 1
        else:
            k, ell = p / s, g / s
            x, v = (sample, v) if math.isnan(x) else (x + k * (sample - x), v + ell * (sample - x))
            p, g, w, refused = k * channel.r, ell * channel.r, w - ell * g, 0
        answers.append((x, k))
    return np.array(answers)


def noisy(seed, level=0.0, sigma=1.0):
    rng = random.Random(seed)
    return [level + rng.gauss(0.0, sigma) for _ in range(ROWS)]


def channels_and_samples():
    """Each channel is one difficulty."""
    holes = noisy(2, 20.0)
    for i in (0, 1, 50, 51, 52, *range(100, 140), ROWS - 1):
        holes[i] = math.nan
    jump = [*noisy(3)[:200], *noisy(3, 50.0)[200:]]
    spikes = noisy(4)
    for i in (30, 31, 90, *range(150, 162), 300):
        spikes[i] += 40.0
    gaps_and_spikes = [math.nan if i in range(152, 155) else z for i, z in enumerate(spikes)]
    late = [math.nan] * 7 + noisy(5, -3.0)[7:]
    return [
        (ChannelTuning("diffuse", "V", 0.01, 1.0), noisy(1)),
        (ChannelTuning("holes", "degC", 0.125, 1.0), holes),
        (ChannelTuning("level jump", "V", 0.001, 0.5, 1.0, 0.0), jump),
        (ChannelTuning("gate", "V", 0.01, 1.0, gate=9.0), spikes),
        (ChannelTuning("gate and holes", "V", 0.01, 1.0, 4.0, 0.5, gate=9.0), gaps_and_spikes),
        (ChannelTuning("first sample", "V", 0.3, 2.0, 5.0), late),
        (ChannelTuning("late diffuse", "V", 0.3, 2.0), late),
        (ChannelTuning("p0 zero", "V", 1.0, 100.0, 0.0, 0.0), noisy(6, sigma=40.0)),
        (ChannelTuning("q zero", "V", 0.0, 25.0, 225.0, 60.0), noisy(7, 50.0, 5.0)),
        (ChannelTuning("r zero", "V", 2.0, 0.0), noisy(8)),
        (ChannelTuning("slow", "V", 1e-9, 3.0), noisy(9)),
        (ChannelTuning("tiny", "V", 1e-14, 1e-12), noisy(10, 1e-5, 1e-6)),
        (ChannelTuning("large", "Pa", 1e8, 1e10), noisy(11, 1e5, 1e5)),
    ]


def extreme_channels():
    """What float32 cannot hold."""
    return [
        (ChannelTuning("minute", "V", 1e-280, 1e-270), noisy(12, 1e-134, 1e-135)),
        (ChannelTuning("subnormal", "V", 5e-324, 1e-310), noisy(13, 0.0, 1e-155)),
        (ChannelTuning("huge", "V", 1e270, 1e280), noisy(14, 1e140, 1e140)),
        (ChannelTuning("huge gate", "V", 1e300, 1e300, gate=4.0), noisy(15, 1e150, 3e150)),
    ]


def channels_with_two_speeds():
    """The difficulties that they can have, beside one without."""
    cases = [(one, samples) for one, samples in channels_and_samples() if one.r and one.q and not one.gate]
    spikes, steps = (samples for one, samples in channels_and_samples() if one.name in ("gate", "level jump"))
    kinds = [(f"{one.name} twice", 10.0 ** (i + 1), 0.0 if i % 2 else 0.01) for i, (one, _) in enumerate(cases)]
    return cases[:1] + [
        (replace(one, name=name, fast=fast, spikes=share), samples if i else (*spikes[:200], *steps[200:]))
        for i, ((one, samples), (name, fast, share)) in enumerate(zip(cases, kinds, strict=True))
    ]


def channels_with_momentum():
    """The same difficulties with momenta from a third of a sample on, among some without."""
    cases = channels_and_samples()
    return cases[:2] + [
        (replace(channel, name=f"{channel.name} on", momentum=tau), samples)
        for (channel, samples), tau in zip(cases, cycle((20.0, 0.3, 1e5, 3.0, 100.0)), strict=False)
    ]


def answered(cases):
    """The cases with what the textbook answers."""
    channels = tuple(channel for channel, _ in cases)
    z = np.array([samples for _, samples in cases]).T
    answers = np.array([textbook(*case) for case in cases])
    names = tuple(channel.name for channel in channels)
    recording = Recording(np.arange(ROWS) * 0.01, names, ("",) * len(names), z, 0.01)
    return Shared(Tuning(channels, sample_period=0.01), recording, answers[..., 0].T, answers[..., 1].T)


KINDS = {
    "five lines": lambda: channels_and_samples() + extreme_channels(),
    "momentum": channels_with_momentum,
    "two speeds": channels_with_two_speeds,
}


@pytest.fixture(scope="module", params=KINDS)
def either(request):
    """The shared vectors without momentum, with it, and with two speeds."""
    return answered(KINDS[request.param]())


@pytest.fixture(scope="module")
def shared():
    """Those without momentum."""
    return answered(KINDS["five lines"]())


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


def assert_same(text, shared):
    """A program has answered x and k of each channel, in turn, to the last bit."""
    numbers = np.array(text.replace("NaN", "nan").split(), dtype=np.float64).reshape(*shared.x.shape, 2)
    np.testing.assert_array_equal(numbers, np.stack([shared.x, shared.k], axis=-1))


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
    assert_same(out, either)


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
        assert (entry["name"], entry["steady_gain"]) == (channel.name, steady.gain)
        assert ("momentum" in entry) == (channel.momentum > 0.0)
        if named := dict(step_of(channel)):
            named["tau_samples"] = named.pop("momentum")
            both = {"velocity_gain": steady.velocity_gain, "overshoot": steady.overshoot}
            assert entry["momentum"] == named | both


def test_c_is_the_same_filter_under_gcc(either, tmp_path):
    """In double; tests/export/targets/test_chains.py has float and other processors."""
    files = export_tuning(either.tuning, "c")
    names = re.findall(r"extern const kalscope_tuning (\w+);", files["kalscope_filter.h"])
    start = "".join(f"kalscope_start(&f[{i}], &{name});\n" for i, name in enumerate(names))
    step = 'double z; if (scanf("%lf", &z) != 1) return 1; kalscope_update(&f[j], z);'
    step += ' printf("%.17g %.17g\\n", f[j].x, f[j].k);'
    loops = f"for (int i = 0; i < {len(either.x)}; i++) for (int j = 0; j < {len(names)}; j++) {{ {step} }}"
    head = '#include <stdio.h>\n#include "kalscope_filter.h"\n'
    main = f"{head}int main(void) {{ kalscope_filter f[{len(names)}];\n{start}{loops}\nreturn 0; }}\n"
    out = build(tmp_path, "gcc", files, main, "-std=c99", "-O2")(lines_of(either.recording).encode())
    assert_same(out.decode(), either)


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
    assert_same(out, either)


@pytest.mark.parametrize(
    ("target", "changed", "words"),
    [
        ("esphome", {"momentum": 20.0}, "support .*momentum .got esphome.: choose arduino, c,"),
        ("esphome", {"chain": Chain(5)}, "support .*a median, a notch and classic filters .got esphome"),
        ("matlab", {"chain": Chain(1, Exponential(0.125))}, "support .*choose arduino, c, python, json"),
        ("javascript", {"chain": Chain(5)}, "support .*or use the Kalman filter alone"),
        ("esphome", {"q": 1e270}, "q of temp per ms, for ESPHome, must fit float32"),
    ],
)
def test_a_target_that_lacks_a_filter_names_those_that_have_it(target, changed, words):
    temp = ChannelTuning("temp", "V", 0.01, 0.25)
    with pytest.raises(BadSetting, match=words):
        export_tuning(Tuning((replace(temp, name="plain"), replace(temp, **changed)), sample_period=0.01), target)
    with pytest.raises(BadSetting, match="sample_period of the tuning must be known"):
        export_tuning(Tuning((temp,)), "esphome")


# ---- test vectors


def read(text, *more):
    rows = list(csv.reader(io.StringIO(text)))
    assert rows[0] == ["time", "raw", "filtered", "gain", *more]
    return np.array([[float(cell) for cell in row] for row in rows[1:]])


def test_our_filter_answers_as_the_textbook_bit_for_bit(either):
    for i, channel in enumerate(either.tuning.channels):
        result = kalman_filter(either.recording.values[:, i], channel.params)
        np.testing.assert_array_equal(result.x, either.x[:, i], err_msg=channel.name)
        np.testing.assert_array_equal(result.k, either.k[:, i], err_msg=channel.name)


def test_a_vector_file_reads_back_bit_for_bit(either):
    files = vector_files(job_of(either.tuning), either.recording)
    assert len(files) == len(either.recording.names)
    for i, text in enumerate(files.values()):
        channel = either.tuning.channels[i]
        columns = read(text, *(["velocity"] if channel.momentum else []))
        np.testing.assert_array_equal(columns[:, 0], either.recording.time)
        np.testing.assert_array_equal(columns[:, 1], either.recording.values[:, i])
        np.testing.assert_array_equal(columns[:, 2], either.x[:, i])
        np.testing.assert_array_equal(columns[:, 3], either.k[:, i])
        velocity = kalman_filter(either.recording.values[:, i], channel.params).velocity
        assert not channel.momentum or np.array_equal(columns[:, 4], velocity)


def test_vectors_are_the_start_of_a_long_recording_and_one_that_does_not_fit_is_refused(shared):
    long = Recording(np.arange(5000.0), ("a",), ("",), np.linspace(0.0, 1.0, 5000)[:, None], 1.0)
    job = job_of(Tuning((ChannelTuning("another name", "", 1.0, 1.0),)))
    assert len(read(vector_files(job, long)["groundtruth.csv"])) == MAX_ROWS
    with pytest.raises(BadSetting, match="channel must be one of a"):
        export_tuning(shared.tuning, "json", vectors=long)
    with pytest.raises(BadSetting, match="at least one row"):
        vector_files(job, replace(long, time=long.time[:0], values=long.values[:0]))
