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
from dataclasses import replace
from itertools import cycle
from types import SimpleNamespace

import numpy as np
import pytest
from tests.support.exported_program import FUSED, build, in_c, in_cpp, program, spiky
from tests.support.required import node
from tests.support.textbook import ByHand
from tests.support.waiting import PATIENCE

from kalscope import BadSetting, ChannelTuning, Recording, Tuning, export_tuning, kalman_filter, steady_state
from kalscope.export.board import momentum_on_board
from kalscope.export.float32 import filter_float32, without_momentum
from kalscope.export.job import ExportJob, job_of, step_of
from kalscope.export.registry import MAX_ROWS, vector_files
from kalscope.export.targets import arduino
from kalscope.filtering.classic import Butterworth, Chain, Exponential, Median, MovingAverage, Notch, OneEuro
from kalscope.filtering.kernels import transition
from kalscope.filtering.steady import step_constants

ROWS = 400


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


EXTREME = [
    (ChannelTuning("minute", "V", 1e-280, 1e-270), noisy(12, 1e-134, 1e-135)),
    (ChannelTuning("subnormal", "V", 5e-324, 1e-310), noisy(13, 0.0, 1e-155)),
    (ChannelTuning("huge", "V", 1e270, 1e280), noisy(14, 1e140, 1e140)),
    (ChannelTuning("huge gate", "V", 1e300, 1e300, gate=4.0), noisy(15, 1e150, 3e150)),
]
"""What float32 cannot hold."""


def channels_with_two_speeds():
    """The difficulties that they can have, beside one without."""
    cases = [(one, samples) for one, samples in channels_and_samples() if one.r and one.q and not one.gate]
    return cases[:1] + [
        (replace(one, name=f"{one.name} twice", fast=10.0 ** (i + 1), spikes=0.01 * (i % 2 == 0)), samples)
        for i, (one, samples) in enumerate(cases)
    ]


def channels_with_momentum():
    """The same difficulties with momenta from a third of a sample on, among some without."""
    cases = channels_and_samples()
    return cases[:2] + [
        (replace(channel, name=f"{channel.name} on", momentum=tau), samples)
        for (channel, samples), tau in zip(cases, cycle((20.0, 0.3, 1e5, 3.0, 100.0)), strict=False)
    ]


KINDS = {"five lines": channels_and_samples() + EXTREME, "momentum": channels_with_momentum()}
KINDS["two speeds"] = channels_with_two_speeds()


@pytest.fixture(scope="module", params=KINDS)
def either(request):
    """A tuning and its recording, without momentum, with it, and with two speeds; and x and k of each sample."""
    channels, samples = zip(*KINDS[request.param], strict=True)
    names, z = tuple(channel.name for channel in channels), np.array(samples).T
    recording = Recording(np.arange(ROWS) * 0.01, names, ("",) * len(names), z, 0.01)
    results = [kalman_filter(z[:, i], channel.params) for i, channel in enumerate(channels)]
    answers = np.stack([np.column_stack([one.x, one.k]) for one in results], axis=1)
    return SimpleNamespace(tuning=Tuning(channels, sample_period=0.01), recording=recording, answers=answers)


def test_our_filter_answers_as_the_textbook_bit_for_bit(either):
    """That of two speeds is in tests/filtering/test_two_speeds.py."""
    for i, one in enumerate(either.tuning.channels):
        if one.fast is None:
            start = {"p0": math.inf if one.p0 is None else one.p0, "x0": math.nan if one.x0 is None else one.x0}
            constants = step_constants(one.q, one.momentum)
            by_hand = ByHand(SimpleNamespace(r=one.r, gate=one.gate or 0.0, momentum=constants, **start), float)
            answers = [(by_hand.update(z), by_hand.k) for z in either.recording.values[:, i]]
            np.testing.assert_array_equal(answers, either.answers[:, i], err_msg=one.name)


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


def assert_same(text, either):
    """A program has answered x and k of each channel, in turn, to the last bit."""
    numbers = np.array(text.replace("NaN", "nan").split(), dtype=np.float64)
    np.testing.assert_array_equal(numbers.reshape(either.answers.shape), either.answers)


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
    rows, channels, _ = either.answers.shape
    driver = ["no_plot = true; f = fopen('raw.bin'); all_z = fread(f, [ROWS, N], 'double'); fclose(f); out = [];"]
    for i, name in enumerate(files, 1):
        driver.append(f"z = all_z(:, {i}); run('{name}'); out = [out, buff_xk, buff_Kk];")
    driver.append("f = fopen('out.bin', 'w'); fwrite(f, out, 'double'); fclose(f);")
    script = "\n".join(driver).replace("ROWS", str(rows)).replace("N]", f"{channels}]")
    run(program("octave-cli"), "--no-gui", "--norc", "--quiet", "--eval", script, cwd=tmp_path)
    out = np.fromfile(tmp_path / "out.bin", "<f8").reshape(channels, 2, rows)
    np.testing.assert_array_equal(np.moveaxis(out, 2, 0), either.answers)


def test_a_matlab_script_runs_without_samples_and_does_not_round_the_answers_to_whole_counts(tmp_path):
    channel = ChannelTuning("diffuse", "V", 0.01, 1.0)
    write(export_tuning(Tuning((channel,)), "matlab"), tmp_path)
    z = [100, 103, 101, 106, 99]
    script = "no_plot = true; kalman_diffuse; printf('%d %d ', numel(buff_xk), any(isnan(buff_xk)));"
    script += f" z = int16({z}); kalman_diffuse; printf('%.17g ', buff_xk);"
    out = run(program("octave-cli"), "--norc", "--quiet", "--eval", script, cwd=tmp_path).split()
    expected = kalman_filter(z, channel.params).x
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
    """In double; chains below have float as well, tests/device other processors."""
    files = export_tuning(either.tuning, "c")
    names = re.findall(r"extern const kalscope_tuning (\w+);", files["kalscope_filter.h"])
    start = "".join(f"kalscope_start(&f[{i}], &{name});\n" for i, name in enumerate(names))
    step = 'double z; if (scanf("%lf", &z) != 1) return 1; kalscope_update(&f[j], z);'
    step += ' printf("%.17g %.17g\\n", f[j].x, f[j].k);'
    loops = f"for (int i = 0; i < {ROWS}; i++) for (int j = 0; j < {len(names)}; j++) {{ {step} }}"
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


def test_a_vector_file_reads_back_bit_for_bit(either):
    files = vector_files(job_of(either.tuning), either.recording)
    assert len(files) == len(either.recording.names)
    for i, text in enumerate(files.values()):
        channel = either.tuning.channels[i]
        columns = read(text, *(["velocity"] if channel.momentum else []))
        np.testing.assert_array_equal(columns[:, 0], either.recording.time)
        np.testing.assert_array_equal(columns[:, 1], either.recording.values[:, i])
        np.testing.assert_array_equal(columns[:, 2:4], either.answers[:, i])
        velocity = kalman_filter(either.recording.values[:, i], channel.params).velocity
        assert not channel.momentum or np.array_equal(columns[:, 4], velocity)


def test_vectors_are_the_start_of_a_long_recording_and_one_that_does_not_fit_is_refused():
    long = Recording(np.arange(5000.0), ("a",), ("",), np.linspace(0.0, 1.0, 5000)[:, None], 1.0)
    one = ChannelTuning("another name", "", 1.0, 1.0)
    job = job_of(Tuning((one,)))
    assert len(read(vector_files(job, long)["groundtruth.csv"])) == MAX_ROWS
    with pytest.raises(BadSetting, match="channel must be one of a"):
        export_tuning(Tuning((one, replace(one, name="b"))), "json", vectors=long)
    with pytest.raises(BadSetting, match="at least one row"):
        vector_files(job, replace(long, time=long.time[:0], values=long.values[:0]))


STAGES = [*map(MovingAverage, (1, 9, 40)), *map(Exponential, (1.0, 0.013)), *map(Median, (1, 9))]
STAGES += [*map(Butterworth, (1e-4, 0.02, 0.49)), OneEuro(0.004, 0.02, 0.05), OneEuro(1e-6, 0.0, 0.3)]
STAGES += [OneEuro(1e8, 1e3, 1e-9)]
KALMAN = (
    ChannelTuning("plain", "V", 0.01, 4.0),
    ChannelTuning("gated", "V", 0.3, 20.0, 10.0, 480.0, gate=9.0),
    ChannelTuning("moving", "V", 0.01, 4.0, momentum=20.0),
    ChannelTuning("both", "V", 0.2, 9.0, 3.0, gate=12.0, momentum=3.0),
    ChannelTuning("slow", "V", 3e-15, 30.0, 1.2e-6, 0.5),
    ChannelTuning("q0", "V", 0.0, 7.0, 0.5, momentum=3.0),
    ChannelTuning("r0", "V", 0.2, 0.0, 3.0, momentum=0.01),
)
CHANNELS = (
    *KALMAN,
    *(replace(one, name=f"{one.name} behind {n}", chain=Chain(n)) for n in (3, 11) for one in KALMAN),
    *(
        ChannelTuning(f"{stage.name} {i} behind {n}", "V", 0.5, 2.0, 3.0, 7.0, momentum=4.0, chain=Chain(n, stage))
        for n in (1, 5)
        for i, stage in enumerate(STAGES)
    ),
    *(replace(one, name=f"{one.name} behind a notch", chain=Chain(notch=Notch(0.2, 0.05))) for one in KALMAN[:3]),
    ChannelTuning("all three", "V", 0.5, 2.0, chain=Chain(5, Exponential(0.1), Notch(0.05, 0.01))),
)
"""Every filter, alone and behind a median or a notch; the values of Kalman beside a classic one must not matter."""


DOUBLES = spiky(1500)
DOUBLES[1100:1140], DOUBLES[1200:1205], DOUBLES[1300:] = np.nan, -0.0, 12.0
FLOATS = DOUBLES.astype(np.float32)


def assert_bits(found, channels=CHANNELS):
    """Answers of an exported program, shape (channels, n), are those of the core in their type; −0 is not 0."""
    for channel, x in zip(channels, found, strict=True):
        y = filter_float32(FLOATS, channel) if x.dtype == np.float32 else channel.filter.run(DOUBLES).x
        np.testing.assert_array_equal(x, y, err_msg=channel.name)
        np.testing.assert_array_equal(np.signbit(x[x == 0]), np.signbit(y[x == 0]), err_msg=channel.name)


def test_c_has_the_bits_of_the_core_in_double_and_in_float(tmp_path):
    z, fused = np.nan_to_num(DOUBLES, nan=np.inf), ("-std=gnu11", "-O2", *FUSED)
    for flags in (("-std=c99", "-O1"), fused):
        assert_bits(in_c(tmp_path, CHANNELS, z, *flags))
    assert_bits(in_c(tmp_path, CHANNELS, FLOATS, *fused, "-DKALSCOPE_FLOAT"))


def test_cpp_has_the_bits_of_the_core_in_float32(tmp_path, monkeypatch):
    monkeypatch.setattr(arduino, "ANALOGUE_PINS", len(CHANNELS))
    for flags in (("-std=c++11", "-O1"), ("-std=gnu++17", "-O2", *FUSED)):
        assert_bits(in_cpp(tmp_path, CHANNELS, FLOATS, *flags))


def test_python_has_the_bits_of_the_core():
    own: dict = {}
    exec(export_tuning(Tuning(CHANNELS, sample_period=0.01), "python")["kalscope_filter.py"], own)
    z = np.nan_to_num(DOUBLES, nan=np.inf).tolist()
    for channel, one in zip(CHANNELS, own["FILTERS"].values(), strict=True):
        x = [one.update(sample) for sample in z]
        np.testing.assert_array_equal(x, channel.filter.run(DOUBLES).x)  # a sort does not know -0 from 0
        assert one.x == x[-1]


SET_MAIN = r"""
#include <stdio.h>
#include "KalscopeFilter.h"
int main() {
  KalscopeFilter filter(KALSCOPE_TUNING_PLAIN);
  float said[2];
  while (fread(said, sizeof said, 1, stdin) == 1) {
    filter.setMomentum(said[0], said[1]);
    const KalscopeTuning &t = filter.tuning;
    const float held[] = {t.momentum, t.e, t.f, t.q11, t.q12, t.q22, t.w0};
    fwrite(held, sizeof held, 1, stdout);
  }
}
"""


@pytest.mark.parametrize("flags", [("-O2",), ("-O3", *FUSED)])
def test_the_constants_that_a_board_computes_are_those_we_predict(tmp_path, flags):
    rng = np.random.default_rng(4)
    q = 10.0 ** rng.uniform(-6, 6, 2000)
    tau = np.concatenate([[0.0, 1.0, 2.0, 1e-3, 1e5], 10.0 ** rng.uniform(-3, 5, 1995)])
    said = np.stack([q, tau], axis=1).astype(np.float32)
    texts = {"KalscopeFilter.h": arduino.files(ExportJob((replace(KALMAN[0], momentum=20.0),)))["KalscopeFilter.h"]}
    run = build(tmp_path, "g++", texts, SET_MAIN, "-std=c++11", "-Wno-unused-result", *flags)
    answer = np.frombuffer(run(said.tobytes()), np.float32).reshape(-1, 7)
    expected = [list(vars(momentum_on_board(*pair) or without_momentum(pair[0])).values()) for pair in said]
    np.testing.assert_array_equal(answer, np.array(expected, dtype=np.float32))
    lasts = said[:, 1] > 0.0
    exact = np.array([transition(1.0, *pair) for pair in said[lasts].astype(float)])
    np.testing.assert_allclose(answer[lasts, 1], exact[:, 0], rtol=0.0, atol=2e-7)
    np.testing.assert_allclose(answer[lasts, 2:6], exact[:, 1:], rtol=1e-6)


def test_what_float_cannot_hold_runs_in_double_and_is_refused_by_name_in_float(tmp_path):
    steep = ChannelTuning("steep", "", 1.0, 1.0, chain=Chain(then=OneEuro(0.01, 1e60, 0.05)))
    for one in (ChannelTuning("tiny", "", 1e-60, 1e-58), steep):
        np.testing.assert_array_equal(in_c(tmp_path, (one,), DOUBLES, "-std=c99")[0], one.filter.run(DOUBLES).x)
        with pytest.raises(subprocess.CalledProcessError) as failed:
            in_c(tmp_path, (one,), DOUBLES, "-std=c99", "-DKALSCOPE_FLOAT")
        assert f"float cannot hold the values of {one.name}" in failed.value.stderr
        with pytest.raises(BadSetting, match=f"{one.name}: .* float32"):
            arduino.files(ExportJob((one,)))
